"""What needs no cycle runs where Linux's own modules are missing, as in Windows and macOS."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from mcserver.cli.run import run
from mcserver.doctor import State, examine, worst
from mcserver.errors import ConfigurationError

ROOT = Path(__file__).parents[2]

# of Linux or of Unix alone: what Python itself and its packages need of them was imported before
WITHOUT = """
import asyncio, importlib.abc, os, select, signal, socket, subprocess, sys

class Without(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name in {"fcntl", "grp", "pwd", "resource", "termios", "tty"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Without())
for module, names in {
    os: "sched_setscheduler sched_getscheduler SCHED_FIFO memfd_create posix_fallocate fdatasync fchmod fork "
    "nice pipe2 pread pwrite setpriority",
    select: "poll",
    signal: "SIGHUP SIGKILL SIGSTOP SIGCONT SIGUSR1 SIGALRM setitimer pthread_sigmask",
    socket: "AF_CAN AF_PACKET AF_UNIX",
}.items():
    for name in names.split():
        # a Python that was built for older systems lacks some
        vars(module).pop(name, None)
for name in ("fcntl", "grp", "pwd", "resource", "termios", "tty"):
    sys.modules.pop(name, None)
"""
# each command in turn, in the one process that all this was taken from
COMMANDS = (
    WITHOUT
    + """
import json
from mcclient.cli import main
from mcserver.cli.app import run_command_line
for words in json.loads(sys.argv[1]):
    assert run_command_line(words) == (3 if words[0] == "history" else 0), words
sys.argv = ["mcctl", "--help"]
main()
"""
)


def test_what_needs_no_cycle_checks_simulates_draws_serves_editors_and_operates(tmp_path: Path) -> None:
    square = "examples/square.gcode"
    commands = [
        ["check", square],
        ["simulate", square],
        ["plot", square, "--output", str(tmp_path / "square.png")],
        *([name, "--help"] for name in ("lsp", "mcp", "grammar", "machine")),
        ["--version"],
        ["--help"],
        ["history", str(tmp_path / "history")],
    ]
    done = subprocess.run(
        [sys.executable, "-c", COMMANDS, json.dumps(commands)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    told = done.stdout + done.stderr
    assert done.returncode == 0, told
    assert "no faults" in told
    assert "8.361 s" in told
    assert told.count("Usage") == 6
    assert "error[MC025]" in told
    assert "jog" in told
    assert (tmp_path / "square.png").stat().st_size > 10_000


def test_a_server_names_what_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    with pytest.raises(ConfigurationError, match="needs Linux") as refused:
        run()
    assert refused.value.code == "MC025"
    assert worst(examine()) is State.MISSING
