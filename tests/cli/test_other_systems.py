"""What needs no cycle runs where Linux's own modules are missing, as in Windows and macOS."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from mcserver.cli.run import run
from mcserver.errors import ConfigurationError

ROOT = Path(__file__).parents[2]

# of Linux or of Unix alone: what Python itself and its packages need of them was imported before
WITHOUT = """
import asyncio, importlib.abc, os, runpy, signal, socket, subprocess, sys

class Without(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name in {"fcntl", "grp", "pwd", "resource", "termios", "tty"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Without())
for module, names in {
    os: "sched_setscheduler sched_getscheduler SCHED_FIFO memfd_create posix_fallocate fdatasync fchmod fork",
    signal: "SIGHUP SIGKILL SIGSTOP SIGCONT SIGUSR1 SIGALRM setitimer pthread_sigmask",
    socket: "AF_CAN AF_PACKET AF_UNIX",
}.items():
    for name in names.split():
        delattr(module, name)
for name in ("fcntl", "grp", "pwd", "resource", "termios", "tty"):
    sys.modules.pop(name, None)
"""
MCSERVER = "sys.argv[0] = 'mcserver'\nrunpy.run_module('mcserver', run_name='__main__')\n"
MCCTL = "from mcclient.cli import main\nsys.argv[0] = 'mcctl'\nmain()\n"


def command(program: str, *words: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT + program, *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def test_programs_are_checked_simulated_and_drawn(tmp_path: Path) -> None:
    assert "no faults" in command(MCSERVER, "check", "examples/square.gcode")
    assert "8.361 s" in command(MCSERVER, "simulate", "examples/square.gcode")
    command(MCSERVER, "plot", "examples/square.gcode", "--output", str(tmp_path / "square.png"))
    assert (tmp_path / "square.png").stat().st_size > 10_000


@pytest.mark.parametrize("name", ["lsp", "mcp", "grammar", "machine"])
def test_editors_and_language_models_are_served(name: str) -> None:
    assert "Usage" in command(MCSERVER, name, "--help")


def test_machines_are_operated() -> None:
    assert "jog" in command(MCCTL, "--help")


def test_a_server_names_what_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    with pytest.raises(ConfigurationError, match="needs Linux") as refused:
        run()
    assert refused.value.code == "MC025"
