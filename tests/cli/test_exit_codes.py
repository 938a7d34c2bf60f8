"""Exit codes and coded errors for whatever is typed: never a traceback."""

from __future__ import annotations

import errno
import json
from pathlib import Path

import pytest
from mcclient.errors import MotionError

from mcserver.cli.app import run_command_line
from mcserver.errors import McError
from tests.cli.command import EXAMPLES, ROOT
from tests.machine_text import axes_text

Capture = pytest.CaptureFixture[str]
ARCS = str(EXAMPLES / "arcs.gcode")


@pytest.mark.parametrize(
    "arguments",
    [
        ["nonsense"],
        ["check"],
        ["check", ARCS, "--nonsense"],
        ["check", ARCS, "another"],
        ["simulate", ARCS, "--output"],
        ["plot", ARCS],
        ["machine", "nonsense"],
    ],
)
def test_wrong_usage_exits_2(arguments: list[str], capfd: Capture) -> None:
    assert run_command_line(arguments) == 2
    assert capfd.readouterr().err != ""


@pytest.mark.parametrize("arguments", [[], ["machine"]])
def test_no_command_shows_what_there_is_and_exits_2(arguments: list[str], capfd: Capture) -> None:
    assert run_command_line(arguments) == 2
    assert "Commands" in capfd.readouterr().out


@pytest.mark.parametrize("verb", ["check", "simulate"])
def test_a_missing_program_exits_2_with_a_code_and_a_remedy(verb: str, capfd: Capture) -> None:
    assert run_command_line([verb, "no-such-file.gcode"]) == 2
    shown = capfd.readouterr()
    assert shown.out == ""
    assert "error[MC010]: there is no file no-such-file.gcode" in shown.err
    assert "= help:" in shown.err


@pytest.mark.parametrize("verb", ["check", "simulate"])
def test_a_missing_machine_exits_3(verb: str, capfd: Capture) -> None:
    assert run_command_line([verb, ARCS, "--machine", "no-such-machine.toml"]) == 3
    assert "error[MC001]" in capfd.readouterr().err


def test_an_unknown_key_of_a_machine_file_exits_3_with_the_nearest_known_one(
    tmp_path: Path, capfd: Capture
) -> None:
    path = tmp_path / "m.toml"
    path.write_text('[machine]\nname = "m"\n[motion]\npath_tolerance = 0.1\n')
    assert run_command_line(["check", ARCS, "-m", str(path)]) == 3
    shown = capfd.readouterr().err
    assert "error[MC003]" in shown
    assert "path_tolerance_mm" in shown


def test_json_answers_a_configuration_error_too(capfd: Capture) -> None:
    assert run_command_line(["check", ARCS, "-m", "no-such-machine.toml", "--json"]) == 3
    answer = json.loads(capfd.readouterr().out)
    assert (answer["ok"], answer["diagnostics"][0]["code"]) == (False, "MC001")


def test_simulate_answers_in_its_own_form_where_nothing_was_simulated(capfd: Capture) -> None:
    assert run_command_line(["simulate", "no-such-file.gcode", "--json"]) == 2
    answer = json.loads(capfd.readouterr().out)
    assert {"ok", "duration_s", "feed_length_mm", "lines", "axes", "diagnostics"} <= answer.keys()


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["simulate", ARCS, "-o", "t.txt"], "MC012"),
        (["simulate", ARCS, "-o", "no-such-folder/t.csv"], "MC013"),
        (["plot", ARCS, "-o", "p.jpeg"], "MC012"),
        (["plot", ARCS, "-o", "no-such-folder/p.png"], "MC013"),
    ],
)
def test_an_output_that_cannot_be_meant_exits_2_at_once(
    arguments: list[str], code: str, capfd: Capture
) -> None:
    assert run_command_line(arguments) == 2
    assert f"error[{code}]" in capfd.readouterr().err


def test_a_fault_of_mcserver_itself_is_one_line_that_asks_for_a_report(
    monkeypatch: pytest.MonkeyPatch, capfd: Capture
) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("0")

    monkeypatch.setattr("mcserver.cli.check.load_machine", fail)
    assert run_command_line(["check", ARCS]) == 1
    shown = capfd.readouterr().err
    assert "error[MC019]" in shown
    assert "Traceback" not in shown


@pytest.mark.parametrize(
    ("error", "lacking"),
    [
        (MemoryError(), "memory"),
        (RuntimeError("can't start new thread"), "threads"),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), "memory"),
        (OSError(errno.EAGAIN, "Resource temporarily unavailable"), "processes"),
        (OSError(errno.EMFILE, "Too many open files"), "descriptors"),
        (ExceptionGroup("of a task group", [ValueError(), MemoryError()]), "memory"),
    ],
)
def test_what_the_computer_does_not_give_is_named_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch, capfd: Capture, error: Exception, lacking: str
) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr("mcserver.cli.check.load_machine", fail)
    assert run_command_line(["check", ARCS]) == 1
    shown = capfd.readouterr().err
    assert "error[MC028]" in shown
    assert lacking in shown.splitlines()[0]
    assert "ulimit" in shown


@pytest.mark.parametrize("kind", [McError, MotionError])
def test_a_code_is_said_once_however_an_error_was_made_of_another(kind: type[Exception]) -> None:
    inner = kind("MC530", "nobody is there", "start a server")
    assert str(kind("MC530", str(inner))) == "MC530: nobody is there (start a server)"


def test_no_color_is_honoured_on_a_terminal(monkeypatch: pytest.MonkeyPatch, capfd: Capture) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("FORCE_COLOR", "1")
    run_command_line(["check", "no-such-file.gcode"])
    assert "\x1b[3" not in capfd.readouterr().err


def test_the_doctor_answers_for_people_and_for_scripts(capfd: Capture) -> None:
    assert run_command_line(["doctor", "--json"]) == 0
    answer = json.loads(capfd.readouterr().out)
    assert answer["ok"] is True
    assert {"area", "title", "state", "found", "fix"} == answer["findings"][0].keys()
    assert run_command_line(["doctor"]) == 0
    assert "looked at" in capfd.readouterr().out


def test_a_machine_is_explained(capfd: Capture) -> None:
    assert run_command_line(["machine", "check", "robot-dog"]) == 0
    shown = capfd.readouterr().out
    assert "T12: " in shown
    assert "robot-dog: 12 axes, 4 tools" in shown


def test_doubts_about_a_machine_are_warnings_and_exit_0(tmp_path: Path, capfd: Capture) -> None:
    path = tmp_path / "m.toml"
    path.write_text(f'[machine]\nname = "m"\n{axes_text(velocity=1.0, acceleration=1e6)}')
    assert run_command_line(["machine", "check", str(path)]) == 0
    assert "warning[MC020]" in capfd.readouterr().err


def test_the_version_is_said(capfd: Capture) -> None:
    assert run_command_line(["--version"]) == 0
    assert capfd.readouterr().out.startswith("mcserver ")


def test_the_tree_of_commands_is_the_documented_one() -> None:
    documented = (ROOT / "docs" / "README.md").read_text("utf-8")
    for verb in ("run", "check", "simulate", "plot", "doctor", "machine check"):
        assert f"mcserver {verb}" in documented
