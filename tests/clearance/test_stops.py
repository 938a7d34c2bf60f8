"""``simulate --stops``: holds, aborts and emergency stops stay clear from every cycle, or a line is named."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mcserver.cli.app import run_command_line
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import parse_machine
from mcserver.simulation.simulation import simulate_lines
from tests.clearance.machines import MILL, TOOL, VISE, mill, shaped_mill
from tests.clearance.stopping import brute_force, judged


# so near do they come, which shows that a stop that left its way would be seen [mm]
@pytest.mark.parametrize(("seed", "near"), [(1, 9.0), (2, 1.5), (3, 1.1)])
def test_what_is_found_clear_by_a_hair_stays_clear_whenever_it_is_stopped(seed: int, near: float) -> None:
    assert 0.98 <= brute_force(seed, 4) < near


def test_stops_of_shaped_axes_stay_clear_beside_the_path_too() -> None:
    assert 0.98 <= brute_force(2, 4, shaped_mill) < 1.5


def test_a_rapid_that_is_clear_alone_and_not_when_it_is_stopped_is_named() -> None:
    # X and Z come past the corner of the vise together; a hold on the way lets each stop in its own time
    lines = ["G1010", "G0 X150 Z45", "G0 X260 Z-20"]
    machine = mill(VISE)
    assert simulate_lines(
        lambda: iter(["G1010", "G1 X150 Z45 F6000", "G1 X260 Z45"]), machine, stops=True
    ).report["ok"]
    found = judged(lines, machine)
    assert [(each["code"], each["line"]) for each in found.report["diagnostics"]] == [("MC320", 3)]
    assert found.exit_code == 1


def test_feed_lines_are_judged_alike_with_stops_and_without() -> None:
    machine = mill(VISE)
    for lines, faulty in (
        (["G1010", "G1 Z20 F6000", "G1 X150"], 3),
        (["G1010", "G1 Z60 F6000", "G1 X150"], 0),
    ):
        for stops in (False, True):
            found = simulate_lines(lambda lines=lines: iter(lines), machine, stops=stops)  # type: ignore[misc]
            assert [each["line"] for each in found.report["diagnostics"]] == ([faulty] if faulty else [])


def test_the_command_says_that_stops_stay_clear(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    machine, program = tmp_path / "mill.toml", tmp_path / "a.gcode"
    machine.write_text("\n".join((MILL, TOOL, VISE)))
    program.write_text("G1010\nG1 Z60 F6000\nG0 X150\n")
    command = ["simulate", str(program), "--machine", str(machine), "--stops"]
    assert run_command_line(command) == 0
    assert "emergency stops stay clear" in capfd.readouterr().out
    assert run_command_line([*command, "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["clearance"]["stops"]
    program.write_text("G1010\nG0 Z20\nG0 X150\n")
    assert run_command_line(command) == 1
    assert "MC320" in capfd.readouterr().err


def test_stops_of_a_machine_without_bodies_cannot_be_judged() -> None:
    with pytest.raises(ConfigurationError, match="names no bodies"):
        judged(["G1010"], parse_machine(MILL))
