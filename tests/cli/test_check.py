"""`mcserver check`: exit codes, diagnostics for people and for scripts."""

from __future__ import annotations

import io
import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from mcserver.cli.app import run_command_line
from tests.cli.command import EXAMPLES

Capture = pytest.CaptureFixture[str]
CHORD = "G1010\nF6000\nG02 X100 Y0 R30\n"


@pytest.fixture
def rejected(tmp_path: Path) -> str:
    path = tmp_path / "pick.gcode"
    path.write_text(CHORD)
    return str(path)


@pytest.mark.parametrize("name", ["arcs", "helix", "coordination", "square"])
def test_the_examples_have_no_faults(name: str, capfd: Capture) -> None:
    assert run_command_line(["check", str(EXAMPLES / f"{name}.gcode")]) == 0
    assert "no faults on machine cartesian" in capfd.readouterr().out


def test_a_rejected_program_exits_4_and_is_shown_as_by_a_compiler(rejected: str, capfd: Capture) -> None:
    assert run_command_line(["check", rejected]) == 4
    shown = capfd.readouterr()
    assert shown.out == ""
    assert "error[MC104]" in shown.err
    assert f"--> {rejected}:3:" in shown.err
    assert "^" in shown.err
    assert "= help:" in shown.err
    assert "is rejected: 1 error in 1 line" in shown.err


def test_json_gives_one_object_on_standard_output(rejected: str, capfd: Capture) -> None:
    assert run_command_line(["check", rejected, "--json"]) == 4
    answer = json.loads(capfd.readouterr().out)
    assert answer["ok"] is False
    assert [(each["code"], each["severity"], each["line"]) for each in answer["diagnostics"]] == [
        ("MC104", "error", 3)
    ]


def test_json_of_a_sound_program_is_ok_and_empty(capfd: Capture) -> None:
    assert run_command_line(["check", "--json", str(EXAMPLES / "arcs.gcode")]) == 0
    assert json.loads(capfd.readouterr().out) == {"ok": True, "diagnostics": []}


def test_a_dash_checks_standard_input(monkeypatch: pytest.MonkeyPatch, capfd: Capture) -> None:
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(CHORD.encode())))
    assert run_command_line(["check", "-"]) == 4
    assert "--> <stdin>:3:" in capfd.readouterr().err


def test_bytes_that_are_no_text_reject_the_program_with_their_place(tmp_path: Path, capfd: Capture) -> None:
    path = tmp_path / "p.gcode"
    path.write_bytes(b"G00 X1\nG01 \xff\0\n")
    assert run_command_line(["check", str(path), "--json"]) == 4
    diagnostic = json.loads(capfd.readouterr().out)["diagnostics"][0]
    assert (diagnostic["code"], diagnostic["line"], diagnostic["column"]) == ("MC100", 2, 6)


def test_an_empty_program_is_sound(tmp_path: Path) -> None:
    path = tmp_path / "p.gcode"
    path.write_bytes(b"")
    assert run_command_line(["check", str(path)]) == 0


def test_a_flood_of_faults_is_cut_for_people_and_whole_in_json(tmp_path: Path, capfd: Capture) -> None:
    path = tmp_path / "p.gcode"
    # each of another cause: of one cause only the first line is shown
    path.write_text("".join(f"G{number}\n" for number in range(200, 350)))
    assert run_command_line(["check", str(path), "--json"]) == 4
    shown = capfd.readouterr()
    assert len(json.loads(shown.out)["diagnostics"]) == 150
    assert shown.err.count("error[") == 100
    assert "and 50 more" in shown.err
