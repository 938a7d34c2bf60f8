"""``simulate --stops``: holds, aborts and emergency stops stay clear from every cycle, or a line is named."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from mcserver.cli.app import run_command_line
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import parse_machine
from mcserver.simulation.simulation import simulate_lines
from tests.clearance.machines import MILL, TOOL, VISE, block, mill, shaped_mill, soft_mill
from tests.clearance.stopping import brute_force, judged, planted_loss, random_program


# so near do they come, which shows that a stop that left its way would be seen [mm]
@pytest.mark.parametrize(("seed", "near"), [(1, 9.0), (3, 1.1)])
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


@pytest.mark.parametrize("seed", [1, 23, 33, 58])
def test_what_an_axis_touches_that_runs_on_without_its_drive_is_told(seed: int) -> None:
    planted = planted_loss(seed, random_program(seed), soft_mill, "tool", 900)
    assert planted is not None
    assert planted.told


def test_a_lost_drive_is_told_where_its_axis_may_touch_or_leave_its_travel() -> None:
    travel = "max_position = 150.0\nmax_acceleration"
    lines = ["G1010", "G1 X100 F12000", "G1 X0"]

    def lost(text: str, *more: str) -> dict[str, Any]:
        machine = parse_machine("\n".join((text, TOOL, *more)))
        found = judged(lines, machine)
        assert found.exit_code == 0
        return {**found.report["clearance"]["lost_drives"], "told": found.report["diagnostics"]}

    # 200 mm/s run on by 100 mm at a tenth of 2000 mm/s², and by 10 mm with a brake
    post = block("post", (180.0, 0.0, 130.0), 20.0)
    [near] = lost(MILL, post)["told"]
    assert (near["code"], near["severity"], near["line"]) == ("MC325", "warning", 2)
    assert "axis 0 is lost" in near["message"]
    braked = lost(MILL.replace("{ kind", "{ brake = true, kind"), post)
    assert braked["clear"]
    assert braked["told"] == []
    [by] = [each["by"] for each in braked["runs_on"] if each["axis"] == 0]
    assert by == pytest.approx(10.0, abs=0.01)
    far = block("post", (0.0, 0.0, 9000.0), 1.0)
    [beyond] = lost(MILL.replace("max_acceleration", travel, 1), far)["told"]
    assert beyond["code"] == "MC326"
    assert "beyond its travel" in beyond["message"]


def test_the_command_says_that_stops_stay_clear(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    machine, program = tmp_path / "mill.toml", tmp_path / "a.gcode"
    machine.write_text("\n".join((MILL, TOOL, VISE)))
    program.write_text("G1010\nG1 Z60 F6000\nG0 X150\n")
    command = ["simulate", str(program), "--machine", str(machine), "--stops"]
    assert run_command_line(command) == 0
    shown = capfd.readouterr()
    assert "emergency stops stay clear" in shown.out
    assert "may run on where their drive is lost: 0 by" in shown.out
    assert "so do axes whose drive is lost" in shown.out
    assert run_command_line([*command, "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["clearance"]["stops"]
    program.write_text("G1010\nG0 Z20\nG0 X150\n")
    assert run_command_line(command) == 1
    assert "MC320" in capfd.readouterr().err


def test_stops_of_a_machine_without_bodies_cannot_be_judged() -> None:
    with pytest.raises(ConfigurationError, match="names no bodies"):
        judged(["G1010"], parse_machine(MILL))
