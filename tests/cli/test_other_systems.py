"""What needs no cycle runs where Linux's own modules are missing, as in Windows and macOS."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from mcserver.cli.drive_sim import drive_sim
from mcserver.cli.run import run
from mcserver.doctor import State, examine, worst
from mcserver.errors import ConfigurationError

ROOT = Path(__file__).parents[2]

# of Linux or of Unix alone: what Python itself and its packages need of them was imported before
WITHOUT = """
import asyncio, importlib.abc, mcp.server.mcpserver, mmap, os, select, signal, socket, subprocess, sys, time

# of which event loops of Unix make their own
socket.socketpair = lambda pair=socket.socketpair, family=socket.AF_UNIX: pair(family)

class Without(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name in {"fcntl", "grp", "pwd", "resource", "termios", "tty"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Without())
for module, names in {
    os: "sched_setscheduler sched_getscheduler SCHED_FIFO memfd_create posix_fallocate fdatasync fchmod fork "
    "nice pipe2 pread pwrite setpriority O_CLOEXEC getpgid getuid killpg sched_getaffinity setsid statvfs",
    select: "epoll poll",
    signal: "SIGHUP SIGKILL SIGSTOP SIGCONT SIGUSR1 SIGALRM setitimer pthread_sigmask",
    mmap: "MADV_DONTNEED PROT_READ",
    socket: "AF_CAN AF_PACKET AF_UNIX SOCK_CLOEXEC SOCK_NONBLOCK SO_REUSEPORT TCP_USER_TIMEOUT",
    time: "clock_gettime_ns CLOCK_MONOTONIC",
}.items():
    for name in names.split():
        # a Python that was built for older systems lacks some
        vars(module).pop(name, None)
for name in ("fcntl", "grp", "pwd", "resource", "termios", "tty"):
    sys.modules.pop(name, None)
"""
# each command in turn, in the one process that all this was taken from; the editor's server gets its requests
# on standard input, and their end
COMMANDS = (
    WITHOUT
    + """
import io, json
from mcclient.cli.app import run_command_line as mcctl
from mcserver.cli.app import run_command_line
for words, code in json.loads(sys.argv[1]):
    assert (mcctl(words[1:]) if words[0] == "mcctl" else run_command_line(words)) == code, words
    sys.stdout.flush()
sys.stdin = io.TextIOWrapper(io.BytesIO(sys.argv[2].encode()), encoding="utf-8")
# ends standard output, too
run_command_line(["lsp"])
"""
)
CLIENT = {"protocolVersion": "2025-03-26", "capabilities": {}, "clientInfo": {"name": "test", "version": "0"}}
AGENT = (
    {"id": 1, "method": "initialize", "params": CLIENT},
    {"method": "notifications/initialized"},
    {"id": 2, "method": "tools/list"},
)
EDITOR = (
    {"id": 1, "method": "initialize", "params": {"processId": None, "rootUri": None, "capabilities": {}}},
    {"id": 2, "method": "shutdown"},
    {"method": "exit"},
)


def lines(messages: Iterable[dict[str, object]]) -> list[str]:
    """Messages of JSON-RPC."""
    return [json.dumps({"jsonrpc": "2.0", **each}) for each in messages]


def test_what_needs_no_cycle_checks_simulates_draws_serves_editors_and_operates(tmp_path: Path) -> None:
    square = "examples/square.gcode"
    commands = [
        (["check", square], 0),
        (["simulate", square], 0),
        (["plot", square, "--output", str(tmp_path / "square.png")], 0),
        *(([name, "--help"], 0) for name in ("lsp", "grammar", "machine", "mcctl")),
        (["--version"], 0),
        (["--help"], 0),
        (["history", str(tmp_path / "history")], 3),
        (["mcctl", "status", "--connect", "tcp/127.0.0.1:9"], 5),
    ]
    editor = "".join(f"Content-Length: {len(each)}\r\n\r\n{each}" for each in lines(EDITOR))
    done = subprocess.run(
        [sys.executable, "-c", COMMANDS, json.dumps(commands), editor],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    output = done.stdout + done.stderr
    assert done.returncode == 0, output
    assert "no faults" in output
    assert "8.361 s" in output
    assert output.count("Usage") == 5
    assert "error[MC025]" in output
    assert "error[MC530]" in output
    assert '"completionProvider"' in output
    assert (tmp_path / "square.png").stat().st_size > 10_000


def test_agents_are_served_there() -> None:
    serve = WITHOUT + "from mcserver.cli.app import run_command_line\nsys.exit(run_command_line(['mcp']))"
    with subprocess.Popen(
        [sys.executable, "-c", serve], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as agent:
        assert agent.stdin is not None
        assert agent.stdout is not None
        agent.stdin.write("\n".join([*lines(AGENT), ""]))
        agent.stdin.flush()
        # whoever ends the input gets no answer to what was not answered by then
        answered = next(line for line in agent.stdout if '"id":2' in line)
        agent.stdin.close()
        assert agent.wait(60) == 0
    assert '"name":"simulate"' in answered


@pytest.mark.parametrize("command", [run, lambda: drive_sim("cartesian")])
def test_a_server_and_its_drives_name_what_they_need(
    command: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    with pytest.raises(ConfigurationError, match="needs Linux") as refused:
        command()
    assert refused.value.code == "MC025"
    assert worst(examine()) is State.MISSING
