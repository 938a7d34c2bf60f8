"""`mcserver simulate` and `mcserver plot` from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mcserver.cli.app import run_command_line
from tests.cli.command import EXAMPLES

Capture = pytest.CaptureFixture[str]
SQUARE = str(EXAMPLES / "square.gcode")


@pytest.fixture
def short(tmp_path: Path) -> str:
    path = tmp_path / "short.gcode"
    path.write_text("G1010\nG94 F6000\nG01 X10\nG01 Y5\n")
    return str(path)


def test_block_delete_and_optional_stop_are_as_asked_for(tmp_path: Path, capfd: Capture) -> None:
    path = tmp_path / "switched.gcode"
    path.write_text("G1010\nF6000\n/G01 X10 Y\nG01 Z5 M01\n")
    assert run_command_line(["check", str(path)]) == 4
    assert run_command_line(["check", str(path), "--block-delete"]) == 0
    path.write_text("G1010\nF6000\n/G01 X10\nG01 Z5 M01\nG01 Z9\n")
    capfd.readouterr()
    found = {}
    for options in ([], ["--block-delete"], ["--no-optional-stop"]):
        assert run_command_line(["simulate", str(path), "--json", *options]) == 0
        found[" ".join(options)] = json.loads(capfd.readouterr().out)
    assert [found[each]["axes"]["0"]["position"] for each in found] == [10.0, 0.0, 10.0]
    # without the pause the motion goes on through it
    assert found["--no-optional-stop"]["duration_s"] < found[""]["duration_s"]


def test_json_is_one_object_of_the_documented_form(short: str, capfd: Capture) -> None:
    assert run_command_line(["simulate", short, "--json"]) == 0
    answer = json.loads(capfd.readouterr().out)
    assert answer.keys() >= {"ok", "duration_s", "feed_length_mm", "lines", "axes", "diagnostics"}
    assert answer["ok"] is True
    assert answer["feed_length_mm"] == pytest.approx(15.0)
    assert [each["line"] for each in answer["lines"]] == [3, 4]
    assert answer["lines"][0].keys() >= {
        "line",
        "start_s",
        "end_s",
        "requested_s",
        "stretched_by",
        "bound_by",
    }
    assert answer["axes"]["0"] == {
        "position": pytest.approx(10.0, abs=0.01),
        "min": 0.0,
        "max": 10.0,
        "unit": "mm",
    }


def test_assertions_that_do_not_hold_are_faults_at_their_lines(short: str, capfd: Capture) -> None:
    assert run_command_line(["simulate", short, "--assert", "duration most=0.001", "--json"]) == 1
    answer = json.loads(capfd.readouterr().out)
    assert [each["code"] for each in answer["diagnostics"]] == ["MC330"]
    assert answer["assertions"][0]["holds"] is False
    assert run_command_line(["simulate", short, "--assert", "duration most=100"]) == 0
    assert "1 assertion: the run keeps to all" in capfd.readouterr().out
    assert run_command_line(["simulate", short, "--assert", "for ever"]) == 2
    assert "MC331" in capfd.readouterr().err


def test_the_difference_to_another_program_is_told(short: str, tmp_path: Path, capfd: Capture) -> None:
    assert run_command_line(["simulate", short, "--against", short]) == 0
    assert "the same setpoints, to the bit" in capfd.readouterr().out
    other = tmp_path / "other.gcode"
    other.write_text("G1010\nG94 F600\nG01 X1\n")
    assert run_command_line(["simulate", short, "--against", str(other)]) == 0
    shown = capfd.readouterr().out
    assert "the other program takes" in shown
    assert "path of X Y Z" in shown
    other.write_text("G01 X1O")
    assert run_command_line(["simulate", short, "--against", str(other)]) == 1
    assert "MC332" in capfd.readouterr().err


def test_people_get_a_table_of_lines_and_axes(short: str, capfd: Capture) -> None:
    assert run_command_line(["simulate", short]) == 0
    shown = capfd.readouterr().out
    assert "G01 X10" in shown
    assert "feed path 15.0 mm" in shown


def test_a_rejected_program_simulates_nothing_and_writes_nothing(tmp_path: Path, capfd: Capture) -> None:
    program, output = tmp_path / "p.gcode", tmp_path / "t.csv"
    program.write_text("G1010\nG01 X10\n")
    assert run_command_line(["simulate", str(program), "--json", "-o", str(output)]) == 4
    answer = json.loads(capfd.readouterr().out)
    assert (answer["ok"], answer["lines"], answer["duration_s"]) == (False, [], 0.0)
    assert answer["diagnostics"][0]["line"] == 2
    assert not output.exists()


def test_a_fault_while_running_exits_1_with_what_ran_before_it(tmp_path: Path, capfd: Capture) -> None:
    program = tmp_path / "p.gcode"
    program.write_text("G1010 P0\nF6000\nG01 X10\nG01 Y10\n")
    assert run_command_line(["simulate", str(program), "--json"]) == 1
    answer = json.loads(capfd.readouterr().out)
    assert answer["ok"] is False
    assert [each["line"] for each in answer["lines"]][:1] == [3]
    assert answer["diagnostics"][0]["line"] == 4


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_a_recording_has_a_row_for_each_cycle_and_a_column_for_each_axis(
    short: str, suffix: str, tmp_path: Path
) -> None:
    output = tmp_path / f"t.{suffix}"
    assert run_command_line(["simulate", short, "--output", str(output)]) == 0
    if suffix == "csv":
        header = output.read_text().split("\n", 1)[0].split(",")
        assert header == [
            "time_s",
            "line",
            *[f"{what}_{i}" for i in range(12) for what in ("setpoint", "actual")],
        ]
        table = np.loadtxt(output, delimiter=",", skiprows=1)
        time, setpoint = table[:, 0], table[:, 2::2]
    else:
        with np.load(output) as arrays:
            time, setpoint = arrays["time_s"], arrays["setpoint"]
    assert np.diff(time) == pytest.approx(0.001, abs=1e-9)
    assert setpoint[0].tolist() == [0.0] * 12
    assert setpoint[:, :2].max(axis=0) == pytest.approx([10.0, 5.0])


@pytest.mark.parametrize(("suffix", "begins"), [("png", b"\x89PNG"), ("html", b"<!doctype html>")])
def test_plot_draws_what_simulate_computes(short: str, suffix: str, begins: bytes, tmp_path: Path) -> None:
    output = tmp_path / f"p.{suffix}"
    assert run_command_line(["plot", short, "-o", str(output)]) == 0
    assert output.read_bytes().startswith(begins)


def test_plot_rejects_what_check_rejects(tmp_path: Path, capfd: Capture) -> None:
    program = tmp_path / "p.gcode"
    program.write_text("G01 XO F10\n")
    assert run_command_line(["plot", str(program), "-o", str(tmp_path / "p.png")]) == 4
    assert "error[MC101]" in capfd.readouterr().err


def test_the_square_example_keeps_its_corners_where_it_stops(tmp_path: Path) -> None:
    output = tmp_path / "t.npz"
    assert run_command_line(["simulate", SQUARE, "-o", str(output)]) == 0
    with np.load(output) as arrays:
        path = arrays["setpoint"][:, :2]
    assert np.linalg.norm(path - [100.0, 100.0], axis=1).min() <= 0.001
