"""Zones in a work system: where its zero is kept, in simulations and while programs run."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from mcserver.clearance.scene import Scene
from mcserver.errors import ConfigurationError
from mcserver.gcode.profiles.frame import Frame
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.planning.start_state import StartState, changes_between
from mcserver.simulation.preview import preview
from mcserver.simulation.simulation import simulate_lines
from tests.clearance.cells import Start, fault_of, place
from tests.clearance.machines import mill
from tests.machine_text import axes_text

EXAMPLES = Path(__file__).parents[2] / "examples"
CNC = '[dialect]\nprofile = "cnc"\n'
# the zone begins 35 mm behind the zero of G55, the tool has a radius of 5 mm, the margin is 1 mm
CLAMP = """
[[zone]]
name = "clamp"
work = "G55"
size_mm = [30.0, 400.0, 400.0]
at_mm = [50.0, 0.0, 0.0]
"""
INTO = ["G90 G94", "G1 X200 F6000"]


def shop(*more: str) -> str:
    return "\n".join((CLAMP, CNC, *more))


def trunnion(more: str) -> Machine:
    text = (EXAMPLES / "trunnion-mill.toml").read_text("utf-8")
    return parse_machine(f"{text}\n{more}", folder=EXAMPLES)


def codes(lines: list[str], *, stops: bool = False) -> list[tuple[str, int]]:
    found = simulate_lines(lambda: iter(lines), mill(shop()), stops=stops)
    errors = [each for each in found.report["diagnostics"] if each["severity"] == "error"]
    return [(each["code"], each["line"]) for each in errors]


@pytest.mark.parametrize("stops", [False, True])
def test_a_zone_is_where_the_zero_of_its_system_is_whatever_system_is_in_force(stops: bool) -> None:
    assert codes(["G90 G94", "G1 X20 F6000"], stops=stops) == []
    assert codes(INTO, stops=stops) == [("MC321", 2)]
    # out of the way
    assert codes(["G10 L2 P2 X300", *INTO], stops=stops) == []
    # neither another system, nor G52, G92 or a tool's length moves it
    for line in ("G10 L2 P1 X300", "G52 X-300", "G92 X300"):
        assert codes([line, "G53 G0 Z90", "G53 G1 X200 F6000"], stops=stops) == [("MC321", 3)]


@pytest.mark.parametrize("stops", [False, True])
def test_a_line_that_moves_the_zero_takes_the_zone_along_from_there_on(stops: bool) -> None:
    out_and_back = ["G90 G94", "G10 L2 P2 X300", "G1 X200 F6000", "G10 L2 P2 X200", "G1 X250"]
    assert codes(out_and_back, stops=stops) == [("MC321", 5)]


def test_a_turned_system_turns_its_zones() -> None:
    # a quarter to the left: what was behind the zero along X is behind it along Y
    assert codes(["G10 L2 P2 R90", *INTO]) == []
    assert codes(["G10 L2 P2 R90", "G90 G94", "G1 Y200 F6000"]) == [("MC321", 3)]


def test_a_zone_on_a_table_goes_with_it() -> None:
    table = '[[body]]\nname = "table"\nshape = "box"\nsize_mm = [500.0, 300.0, 10.0]\n'
    table += "at_mm = [0.0, 0.0, -300.0]\ncarried_by = [0]\nopposite = true\n"
    spindle = '[[body]]\nname = "nose"\nshape = "sphere"\nradius_mm = 5.0\n'
    spindle += "at_mm = [0.0, 100.0, 0.0]\ncarried_by = [2]\n"
    text = f'{table}{spindle}{CLAMP}on = "table"\nbodies = ["nose"]\n{CNC}'
    found = simulate_lines(lambda: iter(INTO), mill(text))
    # the nose stands at X0, and the clamp comes to it as the table goes to X-
    assert [(each["code"], each["line"]) for each in found.report["diagnostics"]] == [("MC321", 2)]


def test_a_zone_on_a_link_of_the_urdf_turns_with_it() -> None:
    # the table of a trunnion, which the tool's chain goes down before it goes up to the spindle
    zone = '[[zone]]\nname = "clamp"\non = "table"\nsize_mm = [40.0, 40.0, 60.0]\nat_mm = [60.0, 0.0, 30.0]\n'
    machine = trunnion(f'{zone}bodies = ["spindle"]\n')
    for turn, into, beside in ((0, 60, -60), (180, -60, 60)):
        for x, expected in ((into, [("MC321", 3)]), (beside, [])):
            lines = ["G90 G94", f"G1 C{turn} F6000", f"G1 X{x} Z-445 F6000"]
            found = simulate_lines(lambda lines=lines: iter(lines), machine)
            assert [(each["code"], each["line"]) for each in found.report["diagnostics"]] == expected
    with pytest.raises(ConfigurationError, match="no link 'tabel'") as refusal:
        Scene(trunnion(zone.replace('"table"', '"tabel"')))
    assert refusal.value.code == "MC323"


async def test_a_server_keeps_out_of_a_zone_where_its_zero_is_now(start: Start) -> None:
    cell = start(mill(shop()))
    program = await cell.run(*INTO)
    assert fault_of(program) == ("MC321", 2)
    assert place(cell, 0) == pytest.approx(29.0, abs=0.3)
    assert (await cell.run("G10 L2 P2 X300")).state == "finished"
    # a jog and another program have heard of it
    assert (await cell.ended(await cell.jog(0, 100.0))).state == "finished"
    assert (await cell.run("G90 G94", "G1 X300 F6000")).state == "finished"
    assert (await cell.run("G10 L2 P2 X400")).state == "finished"
    assert fault_of(await cell.ended(await cell.jog(0, 200.0)))[0] == "MC321"
    assert place(cell, 0) == pytest.approx(429.0, abs=0.3)


async def test_a_zero_that_another_program_moves_takes_the_zone_into_the_way_of_one_that_runs(
    start: Start,
) -> None:
    cell = start(mill(shop(axes_text([3]))))
    assert (await cell.run("G10 L2 P2 X500")).state == "finished"
    running = await cell.begin("G90 G94", "G1 X400 F600", axes=[0, 1, 2])
    await cell.until(lambda: place(cell, 0) > 20.0)
    assert (await cell.run("G10 L2 P2 X200", axes=[3])).state == "finished"
    assert fault_of(await cell.ended(running)) == ("MC321", 2)
    assert place(cell, 0) <= 229.05


async def test_a_zone_that_is_moved_around_the_tool_lets_it_out_and_no_deeper(start: Start) -> None:
    cell = start(mill(shop()))
    # the tool is 5 mm off the zone's middle
    assert (await cell.run("G10 L2 P2 X-45")).state == "finished"
    assert fault_of(await cell.run("G90 G94", "G1 X3 F600")) == ("MC321", 2)
    assert place(cell, 0) == pytest.approx(0.0, abs=0.05)
    assert (await cell.run("G90 G94", "G1 X-100 F600")).state == "finished"
    assert fault_of(await cell.run("G90 G94", "G1 X0 F600")) == ("MC321", 2)


def test_a_zero_that_was_moved_since_is_named_where_an_approval_rests_on_it() -> None:
    machine = mill(shop())
    before = StartState.of(machine)
    moved = msgspec.structs.replace(before, frame=Frame(systems={2: {0: 0.3}}))
    [change] = changes_between(machine, before, moved, axes=(0,), inputs=frozenset(), tolerance={0: 1e-5})
    assert "G55" in change


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (CLAMP, "no zone of this machine is in G55: the profile reference has no work systems"),
        (shop().replace("G55", "G60"), "zone[0].work"),
        (
            shop().replace('work = "G55"', 'work = "G55"\non = "table"'),
            "there is no body 'table' to carry it",
        ),
        (shop().replace('work = "G55"', "work = 55"), "zone[0].work"),
    ],
)
def test_a_work_system_that_is_not_there_is_refused(text: str, message: str) -> None:
    with pytest.raises(MachineFileRejected) as refused:
        mill(text)
    assert message in str(refused.value)


def test_a_run_is_judged_with_the_zero_of_its_request() -> None:
    machine = mill(shop())
    seen = preview("\n".join(INTO), machine, StartState.of(machine), (0,))
    assert [each["code"] for each in seen.report["diagnostics"]] == ["MC321"]
