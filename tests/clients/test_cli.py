"""``mcctl``: what it prints where, and its exit codes."""

from __future__ import annotations

import json
import os
import pty
import select
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from fake_methods import FakeProgram
from fake_server import FakeServer
from mcclient import texts
from mcclient.cli import ahead

PACKAGE = Path(__file__).resolve().parents[2] / "clients" / "python"
Run = Callable[..., tuple[int, str, str]]
FAR_AWAY = "tcp/127.0.0.1:9"
READ_LIMIT_S = 60.0


def write(folder: Path, *lines: str) -> str:
    path = folder / "job.gcode"
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def test_list_names_the_machines_on_standard_output(mcctl: Run) -> None:
    code, out, _ = mcctl("list")
    assert code == 0
    assert "cell" in out
    code, out, _ = mcctl("list", "--json")
    assert json.loads(out)[0]["machine"] == "cell"


def test_status_and_programs_and_watch_once_show_the_state(mcctl: Run) -> None:
    for command in (["status"], ["watch", "--once"]):
        code, out, err = mcctl(*command)
        assert (code, err) == (0, "")
        assert "standstill" in out
        code, out, _ = mcctl(*command, "--json")
        assert json.loads(out)["state"] == "ready"
    assert mcctl("programs")[0] == 0
    assert json.loads(mcctl("programs", "--json")[1]) == []


def test_nobody_answers_is_exit_code_5(mcctl: Run) -> None:
    for command in (["status", "--json"], ["list", "--json"]):
        code, out, err = mcctl(*command, "--connect", FAR_AWAY)
        assert code == 5
        assert "error[MC530]" in err
        assert "mcserver run" in err
        assert json.loads(out)["error"]["code"] == "MC530"


def test_a_wrong_word_on_the_command_line_is_exit_code_2_and_a_wrong_endpoint_3(mcctl: Run) -> None:
    assert mcctl("override", "300")[0] == 2
    assert mcctl("nonsense")[0] == 2
    assert mcctl("jog", "7", "1")[0] == 2
    assert mcctl("run", "no-such-file.gcode")[0] == 2
    assert mcctl("run", "-", "--axes", "x")[0] == 2
    assert mcctl("status", "--connect", "nonsense")[0] == 3


def test_operators_commands_reach_the_server(mcctl: Run, server: FakeServer) -> None:
    assert mcctl("override", "50")[1] == "cell: override 50 %\n"
    assert mcctl("jog", "1", "-0.5")[1].startswith("cell: axis Y goes by -0.5 mm (program ")
    (jog,) = [request for method, request in server.requests if method == "jog"]
    assert jog["distance"] == -0.5
    for order in ("hold", "resume", "abort"):
        assert mcctl(order)[0] == 0
    assert mcctl("reset", "--axis", "1")[0] == 0
    assert server.requests[-1][1]["axes"] == [1]


def test_estop_waits_for_the_confirmation(mcctl: Run, server: FakeServer) -> None:
    code, out, _ = mcctl("estop", "--json")
    assert (code, json.loads(out)["state"]) == (0, "estop")
    assert server.state == "estop"


def test_send_runs_lines_as_one_program(mcctl: Run, server: FakeServer) -> None:
    code, out, _ = mcctl("send", "G91", "G01 X1")
    assert (code, out) == (0, "p1: finished, 2 lines done\n")
    assert [text for _, _, text in server.executed] == ["G91", "G01 X1"]


def test_send_of_a_file_says_how_a_file_is_run(
    mcctl: Run, server: FakeServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("p.gcode", "G28", "G38.2"):
        (tmp_path / name).write_text("G01 X1\n")
    code, _, err = mcctl("send", "p.gcode")
    assert (code, "p.gcode is a file" in err, "mcctl run p.gcode" in err) == (2, True, True)
    assert server.executed == []
    assert mcctl("send", "G28", "G38.2")[0] == 0


def test_switches_of_the_operator_reach_each_call_of_a_run(
    mcctl: Run, server: FakeServer, tmp_path: Path
) -> None:
    assert mcctl("run", write(tmp_path, "/G01 X1"), "--block-delete", "--no-optional-stop")[0] == 0
    asked = {method: request for method, request in server.requests if "block_delete" in request}
    assert {(each["block_delete"], each["optional_stop"]) for each in asked.values()} == {(True, False)}
    assert asked.keys() == {"check", "simulate", "open"}


def test_a_run_asks_what_is_answered_at_once_before_what_may_take_minutes(
    mcctl: Run, server: FakeServer, tmp_path: Path
) -> None:
    # where access rules forbid it nothing is answered at all
    assert mcctl("run", write(tmp_path, "G01 X1"))[0] == 0
    assert [request["text"] for method, request in server.requests if method == "check"] == ["", "G01 X1\n"]


def test_a_rejected_line_is_shown_with_a_caret_and_is_exit_code_4(mcctl: Run) -> None:
    code, out, err = mcctl("send", "G01 X1", "BAD X2")
    assert (code, out) == (4, "")
    assert (
        "error[MC101]: an unknown code\n --> send:2:1\n2 | BAD X2\n  | ^^^\n  = help: use a known one" in err
    )
    code, out, _ = mcctl("send", "--json", "BAD")
    assert json.loads(out)["diagnostics"][0]["column"] == 1


def test_run_streams_a_file_and_says_how_it_went_on_standard_error(
    mcctl: Run, server: FakeServer, tmp_path: Path
) -> None:
    code, out, err = mcctl("run", write(tmp_path, *(f"G01 X{n}" for n in range(3000))))
    assert (code, out) == (0, "")
    assert "job.gcode: finished, 3000 lines" in err
    assert len(server.executed) == 3000
    assert server.programs["p1"].name == "job.gcode"


def test_run_gives_one_json_object(mcctl: Run, tmp_path: Path) -> None:
    code, out, _ = mcctl("run", write(tmp_path, "G01 X1"), "--json", "--axes", "0-1")
    answer = json.loads(out)
    assert (code, answer["ok"], answer["state"], answer["done"]) == (0, True, "finished", 1)


def test_run_looks_for_faults_first_and_moves_nothing(mcctl: Run, server: FakeServer, tmp_path: Path) -> None:
    server.check_diagnostics = [
        {"code": "MC104", "message": "too long", "line": 2, "column": 5, "end_column": 9}
    ]
    file = write(tmp_path, "G01 X1", "G02 X100")
    code, out, err = mcctl("run", file)
    assert (code, out) == (4, "")
    assert "2 | G02 X100\n  |     ^^^^" in err
    assert server.programs == {}
    assert mcctl("run", file, "--no-check")[0] == 0


@pytest.mark.parametrize("faulty", [True, False])
def test_run_hands_a_long_file_over_and_checks_it_first(
    mcctl: Run, server: FakeServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, faulty: bool
) -> None:
    monkeypatch.setattr(ahead, "SHORT_BYTES", 10)
    monkeypatch.setattr(texts, "PART_BYTES", 8)
    if faulty:
        server.check_diagnostics = [{"code": "MC104", "message": "too long", "line": 2, "column": 5}]
    code, _, err = mcctl("run", write(tmp_path, "G01 X1", "G02 X100"))
    assert b"".join(server.texts).split() == [b"G01", b"X1", b"G02", b"X100"]
    assert len(server.texts) > 1
    assert "checking 2 lines" in err
    assert code == (4 if faulty else 0)
    assert ("2 | G02 X100" in err) is faulty
    assert (server.programs == {}) is faulty


def test_run_tells_a_line_rejected_on_the_way_and_what_ran_before(
    mcctl: Run, server: FakeServer, tmp_path: Path
) -> None:
    code, out, err = mcctl("run", write(tmp_path, "G01 X1", "BAD", "G01 X2"), "--json")
    assert code == 4
    assert err.count("error[MC101]") == 1
    assert "2 | BAD" in err
    assert json.loads(out)["diagnostics"][0]["line"] == 2
    assert [number for _, number, _ in server.executed] == [1]


def test_a_fault_while_running_is_exit_code_1(mcctl: Run, tmp_path: Path) -> None:
    code, out, err = mcctl("run", write(tmp_path, "G01 X1", "FAULT"), "--json")
    assert code == 1
    assert "error[MC401]: axis 2 has a fault" in err
    assert json.loads(out)["error"]["line"] == 2


def test_run_from_a_line_gives_the_lines_before_for_their_modal_state(
    mcctl: Run, server: FakeServer, tmp_path: Path
) -> None:
    code, _, said = mcctl("run", write(tmp_path, "G91", "G01 X1 F5", "X2", "X3"), "--from-line", "3")
    assert code == 0
    assert "finished, 2 lines in " in said
    opened = next(request for method, request in server.requests if method == "open")
    assert (opened["start_line"], opened["before"]) == (3, ["G91", "G01 X1 F5"])
    assert [(number, text) for _, number, text in server.executed] == [(3, "X2"), (4, "X3")]


def process(server: FakeServer, *arguments: str, **options: object) -> subprocess.Popen[str]:
    environment = {**os.environ, "MC_CONNECT": server.endpoint, "NO_COLOR": "1", "PYTHONPATH": str(PACKAGE)}
    return subprocess.Popen(
        [sys.executable, "-m", "mcclient", *arguments],
        env=environment,
        text=True,
        **options,  # type: ignore[call-overload]
    )


def test_run_reads_standard_input_for_a_dash(server: FakeServer) -> None:
    child = process(server, "run", "-", stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    _, err = child.communicate("G01 X1\r\nG01 X2", timeout=READ_LIMIT_S)
    assert child.returncode == 0, err
    assert [text for _, _, text in server.executed] == ["G01 X1", "G01 X2"]


def test_an_interrupt_without_a_terminal_aborts_the_program(server: FakeServer, tmp_path: Path) -> None:
    server.runs_by_itself = False
    child = process(
        server, "run", write(tmp_path, "G01 X1"), stdin=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    server.wait_until(lambda: server.calls["close"] == 1, 20.0)
    child.send_signal(signal.SIGINT)
    _, err = child.communicate(timeout=READ_LIMIT_S)
    assert child.returncode == 1
    assert "interrupted: aborting" in err
    assert server.programs["p1"].state == "aborted"


def test_an_interrupt_at_a_terminal_asks_and_a_second_one_aborts(server: FakeServer, tmp_path: Path) -> None:
    server.runs_by_itself = False
    controller, terminal = pty.openpty()
    child = process(
        server, "run", write(tmp_path, "G01 X1"), stdin=terminal, stderr=terminal, stdout=terminal
    )
    os.close(terminal)
    try:
        server.wait_until(lambda: server.calls["close"] == 1, 20.0)
        child.send_signal(signal.SIGINT)
        _read_until(controller, "[h]old")
        # the answer to the hold is all that tells of it
        server.lose["ack"] = 1
        os.write(controller, b"h\n")
        server.wait_until(lambda: server.programs["p1"].state == "held", 20.0)
        _read_until(controller, "holding")
        child.send_signal(signal.SIGINT)
        _read_until(controller, "[r]esume")
        child.send_signal(signal.SIGINT)
        _read_until(controller, "aborted")
        assert child.wait(20) == 1
    finally:
        child.kill()
        child.wait(20)
        os.close(controller)
    assert server.programs["p1"].state == "aborted"


def _read_until(descriptor: int, wanted: str) -> None:
    seen = ""
    while wanted not in seen:
        readable, _, _ = select.select([descriptor], [], [], READ_LIMIT_S)
        assert readable, f"{wanted!r} has not come after {seen!r}"
        seen += os.read(descriptor, 4096).decode(errors="replace")


def test_the_console_keeps_one_program_and_shows_each_lines_fate(server: FakeServer) -> None:
    typed = "G91\nG01 X1 F5\nBAD\nX2\n:override 40\n:status\n:nonsense\n:quit\nX3\n"
    child = process(server, "console", stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    out, _ = child.communicate(typed, timeout=READ_LIMIT_S)
    assert [text for _, _, text in server.executed] == ["G91", "G01 X1 F5", "X2"]
    assert len(server.programs) == 1
    assert "2 accepted" in out
    assert "2 done in 0.100 s" in out
    assert "3 | BAD\n  | ^^^" in out
    assert "override 40 %" in out
    assert "standstill" in out
    assert child.returncode == 2


def test_the_console_begins_a_new_program_after_a_fault(server: FakeServer) -> None:
    child = process(server, "console", stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    out, _ = child.communicate("FAULT\nG01 X1\n", timeout=READ_LIMIT_S)
    assert "error[MC401]" in out
    assert "a new program, p2" in out
    assert child.returncode == 1
    assert [text for _, _, text in server.executed] == ["G01 X1"]


def test_step_mode_runs_a_line_for_each_enter(server: FakeServer, tmp_path: Path) -> None:
    child = process(
        server,
        "run",
        "--step",
        write(tmp_path, "G01 X1", "G01 X2"),
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    _, err = child.communicate("\n\n", timeout=READ_LIMIT_S)
    assert child.returncode == 0, err
    assert "1 | G01 X1" in err
    assert len(server.executed) == 2


def with_the_sdk_alone(script: str) -> subprocess.CompletedProcess[str]:
    """Run Python that finds the SDK's package and no other of this tree."""
    return subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": str(PACKAGE)},
        capture_output=True,
        text=True,
        timeout=READ_LIMIT_S,
        check=False,
    )


def test_without_its_extra_mcctl_says_what_to_install() -> None:
    hide = (
        "import importlib.util as u, sys; real = u.find_spec\n"
        "u.find_spec = lambda name, *rest: None if name == 'rich' else real(name, *rest)\n"
        "from mcclient.cli import main; main()"
    )
    done = with_the_sdk_alone(hide)
    assert done.returncode == 3
    assert "pip install 'mcclient[cli]'" in done.stderr


def test_the_sdk_alone_needs_neither_typer_nor_rich_nor_the_server() -> None:
    script = (
        "import sys, mcclient, mcclient.sync, mcclient.recording\n"
        "print(sorted({'typer', 'rich', 'prompt_toolkit', 'mcserver'} & set(sys.modules)))"
    )
    done = with_the_sdk_alone(script)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "[]\n"


def test_names_of_programs_and_clients_are_never_obeyed_by_the_terminal(
    mcctl: Run, server: FakeServer
) -> None:
    attack = "x\x1b[2J\x1b]0;owned\x07\u202egnp\nprogram finished"
    server.programs["p1"] = FakeProgram("p1", attack, attack, [0], 1, "stop", False, state="held")
    for command in (["status"], ["programs"], ["watch", "--once"], ["fleet", "--once"]):
        code, out, err = mcctl(*command)
        assert code == 0
        assert not {"\x1b", "\u202e", "\x07"} & set(out + err), command
        assert "x\\x1b[2J" in out
        code, out, _ = mcctl(*command, "--json")
        assert attack in json.dumps(json.loads(out), ensure_ascii=False) or json.dumps(attack) in out
        assert not {"\x1b", "\u202e"} & set(out)
