"""Doubts about machine files that are valid."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from mcserver.cli.app import run_command_line
from mcserver.machine.axis import axis_name
from mcserver.machine.machine_file import BUILT_IN, load_machine, parse_machine
from mcserver.machine.plausibility import find_doubts, find_tool_faults
from tests.machine_text import axes_text


def _codes(axis: str, drive: str = "", kind: str = "ideal") -> list[str]:
    axes = axes_text(acceleration=1000.0, keys=axis, drive=kind, drive_keys=drive)
    return [doubt.code for doubt in find_doubts(parse_machine(f'[machine]\nname = "m"\n{axes}'))]


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_machines_are_beyond_doubt(name: str) -> None:
    machine = load_machine(name)
    assert find_doubts(machine) + find_tool_faults(machine) == []


def test_a_jerk_that_is_no_limit_earns_a_warning() -> None:
    assert _codes("max_jerk = 5e6") == ["MC020"]


def test_a_tolerance_finer_than_the_encoder_earns_a_warning() -> None:
    assert _codes("in_position = 0.001", "encoder_resolution = 0.01") == ["MC021"]


def test_a_tolerance_of_one_count_earns_no_warning() -> None:
    assert _codes("in_position = 0.01", "encoder_resolution = 0.01") == []


def test_a_tolerance_wider_than_the_following_error_earns_a_warning() -> None:
    assert _codes("in_position = 0.5\nmax_following_error = 0.1") == ["MC023"]


def test_a_bus_drive_on_an_interface_that_is_not_here_earns_a_warning() -> None:
    drive = 'bus = "can99"\nnode = 1\ncounts_per_motor_rev = 4096'
    assert "MC022" in _codes("units_per_motor_rev = 10.0", drive, "cia402")


@pytest.mark.parametrize(("index", "name"), [(0, "X"), (5, "C"), (6, "[6]"), (63, "[63]")])
def test_axes_are_named_as_in_programs(index: int, name: str) -> None:
    assert axis_name(index) == name


def _dog_leg(folder: Path, *tools: str, knee: float = -90.0) -> str:
    """A machine file with the robot dog's front left leg."""
    text = '[machine]\nname = "leg"\n[kinematics]\nurdf = "robot-dog.urdf"\n'
    text += "".join(f"[[tool]]\n{tool}\n" for tool in tools)
    for index, start in enumerate((0.0, 40.0, knee)):
        keys = f"initial_position = {start}"
        text += axes_text((index,), rotary=True, keys="max_jerk = 1e9", drive="simulated", drive_keys=keys)
    file = folder / "leg.toml"
    file.write_text(text, "utf-8")
    return str(file)


FITTING = 'number = 3\nframe = "front_left_foot"\naxes = [0, 1, 2]'
MISSPELT = 'number = 4\nframe = "front_left_fot"\naxes = [0, 1, 2]'
TOO_SHORT = 'number = 5\nframe = "front_left_foot"\naxes = [0, 1]'


def test_every_tool_that_does_not_fit_is_listed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = _dog_leg(tmp_path, FITTING, MISSPELT, TOO_SHORT)
    assert run_command_line(["machine", "check", file, "--json"]) == 3
    answer = json.loads(capsys.readouterr().out)
    errors = [each for each in answer["diagnostics"] if each["severity"] == "error"]
    assert answer["ok"] is False
    assert [(each["code"], each["tool"]) for each in errors] == [("MC301", 4), ("MC301", 5)]
    assert "did you mean 'front_left_foot'?" in errors[0]["hint"]


def test_doubts_about_axes_are_listed_beside_faults_of_tools(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["machine", "check", _dog_leg(tmp_path, MISSPELT), "--json"]) == 3
    codes = [each["code"] for each in json.loads(capsys.readouterr().out)["diagnostics"]]
    assert codes == ["MC301", "MC020", "MC020", "MC020"]


def test_a_start_past_a_joint_limit_is_an_error_of_the_machine(tmp_path: Path) -> None:
    (fault,) = find_tool_faults(load_machine(_dog_leg(tmp_path, FITTING, knee=-5.0)))
    assert (fault.code, fault.severity, fault.axis) == ("MC301", "error", 2)


def test_without_pinocchio_the_package_to_install_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    assert run_command_line(["machine", "check", "arm6"]) == 3
    said = capsys.readouterr().err
    assert "error[MC301]" in said
    assert "pip install pin scipy" in said
