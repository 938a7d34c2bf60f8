"""Probing cycles: each finds what it is named after, and sets the zero or the tool there."""

from __future__ import annotations

import pytest

from mcserver.machine.button_section import Button, filled
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.probing_cycles import probing_cycles
from mcserver.simulation.simulation import simulate
from tests.machine_text import axes_text

PLANES = "simulated_at = { X = 30, Y = 20, Z = -5 }"
NUMBERS = {
    "travel": 60.0,
    "feed": 600.0,
    "slow": 60.0,
    "back": 1.0,
    "diameter": 4.0,
    "width": 20.0,
    "clear": 6.0,
    "inset": 8.0,
    "depth": 2.0,
    "thickness": 1.5,
    "setter": -40.0,
}


def mill(probe: str = f"[probe]\n{PLANES}", profile: str = "cnc", axes: int = 3) -> Machine:
    text = f'[machine]\nname = "mill"\n[dialect]\nprofile = "{profile}"\n{probe}\n'
    text += "[[cutter]]\nnumber = 1\nlength_mm = 10\n"
    return parse_machine(text + axes_text(range(axes)))


def cycle(name: str, machine: Machine) -> Button:
    return {each.name: each for each in probing_cycles(machine)}[name]


def ends(text: str, machine: Machine) -> list[float]:
    found = simulate(text, machine)
    assert found.exit_code == 0, found.report
    return [found.report["axes"][str(index)]["position"] for index in range(3)]


@pytest.mark.parametrize("sign", ["+", "−"])
def test_an_edge_lies_the_radius_of_the_stylus_behind_the_contact(sign: str) -> None:
    machine = mill()
    start, expected = ("G0 X5\n", 30.0 + 2.0) if sign == "+" else ("G0 X70\n", 30.0 - 2.0)
    text = start + filled(cycle(f"Edge X, going {sign}", machine).text, NUMBERS)
    # back where it began, and then at the zero that it set
    assert ends(text, machine)[0] == pytest.approx(float(start[4:]), abs=1e-6)
    assert ends(text + "G1 X0", machine)[0] == pytest.approx(expected, abs=1e-3)


def test_the_top_lies_the_thickness_of_the_plate_below_the_contact() -> None:
    machine = mill()
    text = filled(cycle("Top", machine).text, NUMBERS) + "G1 Z0"
    assert ends(text, machine)[2] == pytest.approx(-6.5, abs=1e-3)


def test_a_corner_is_found_from_above_it_and_the_tool_ends_there_at_the_height_of_the_start() -> None:
    machine = mill("[probe]\nsimulated_at = { X = 30, Y = 20 }")
    text = "G0 X31 Y21 Z3\n" + filled(cycle("Corner left front", machine).text, NUMBERS)
    assert ends(text, machine) == pytest.approx([32.0, 22.0, 3.0], abs=1e-3)
    assert ends(text + "G0 X1 Y-1", machine) == pytest.approx([33.0, 21.0, 3.0], abs=1e-3)


def test_what_the_way_down_meets_beside_a_corner_is_a_fault() -> None:
    probe = "[probe]\ninput = 0\n[[input]]\nnumber = 0\nname = 'touch'\n"
    text = "G0 X31 Y21\n" + filled(cycle("Corner left front", mill(probe)).text, NUMBERS)
    down = next(at for at, each in enumerate(text.split("\n"), 1) if "G38.3" in each)
    (line,) = (each for each in simulate(text, mill(probe)).report["lines"] if each["line"] == down)
    met = f"simulated = [{{ at_s = {(line['start_s'] + line['end_s']) / 2}, value = true }}]\n"
    found = simulate(text, mill(probe + met))
    assert found.exit_code != 0
    assert "MC457" in str(found.report)


@pytest.mark.parametrize("name", ["Centre of a hole", "Centre of a boss"])
def test_a_centre_lies_in_the_middle_between_its_contacts(name: str) -> None:
    # no plane: contact is where a touch ends, as far on one side as on the other
    machine = mill("[probe]\ninput = 0\n[[input]]\nnumber = 0\nname = 'touch'")
    text = "G0 X7 Y-3 Z2\n" + filled(cycle(name, machine).text, NUMBERS) + "G0 X1 Y1"
    assert ends(text, machine) == pytest.approx([8.0, -2.0, 2.0], abs=1e-3)


def test_a_tool_has_the_length_at_which_its_tip_touches_the_setter() -> None:
    machine = mill("[probe]\nsimulated_at = { Z = -15 }")
    text = "T1 M6\n" + filled(cycle("Tool length", machine).text, NUMBERS) + "G43 H1\nG0 Z0"
    # contact with the spindle at -15 above a setter at -40: 25 mm
    assert ends(text, machine)[2] == pytest.approx(25.0, abs=1e-3)


def test_machines_without_a_probe_or_without_programs_that_compute_have_none() -> None:
    assert not probing_cycles(mill(probe=""))
    assert not probing_cycles(mill(profile="printer"))
    assert {each.name for each in probing_cycles(mill("[probe]\nsimulated_at = { X = 1 }", axes=1))} == {
        "Edge X, going +",
        "Edge X, going −",
    }


def test_each_cycle_asks_for_what_its_text_needs_and_for_nothing_else() -> None:
    for each in probing_cycles(mill()):
        numbers = {argument.name: argument.first for argument in each.argument}
        assert "{" not in filled(each.text, numbers)
        assert all(argument.low <= argument.first <= argument.high for argument in each.argument)
        assert all(f"{{{name}}}" in each.text for name in numbers)


def test_cycles_in_macro_b_end_where_those_of_linuxcnc_do() -> None:
    linuxcnc, fanuc = mill(), mill(f'macros = "fanuc"\n[probe]\n{PLANES}')
    start = "G10 L2 P1 X3 Y4 Z1\nT1 M6\nG0 X5 Y5 Z10\n"
    for name in ("Edge X, going +", "Top", "Corner left front", "Tool length"):
        here, there = (
            ends(start + filled(cycle(name, each).text, NUMBERS) + "G43\nG1 X0 Z7", each)
            for each in (linuxcnc, fanuc)
        )
        assert here == there
