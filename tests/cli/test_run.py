"""`mcserver run`: its options, and the process from ready to stopped."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from mcserver.cli.app import run_command_line
from mcserver.cli.run import named
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import load_machine
from tests.cli.command import ENTRY, ROOT

Capture = pytest.CaptureFixture[str]


def test_a_name_replaces_that_of_the_machine_file() -> None:
    assert named(load_machine("cartesian"), "cell-7").name == "cell-7"
    assert named(load_machine("cartesian"), None).name == "cartesian"


@pytest.mark.parametrize("name", ["", "a/b", "a b", "*", "-a"])
def test_a_name_that_cannot_be_part_of_a_key_is_refused(name: str) -> None:
    with pytest.raises(ConfigurationError, match="MC017"):
        named(load_machine("cartesian"), name)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (["--machine", "no-such-machine.toml"], "MC001"),
        (["--name", "a/b"], "MC017"),
        (["--zenoh-config", "no-such-file.json5"], "MC018"),
    ],
)
def test_a_configuration_that_does_not_fit_exits_3(options: list[str], code: str, capfd: Capture) -> None:
    assert run_command_line(["run", *options]) == 3
    assert f"error[{code}]" in capfd.readouterr().err


@pytest.fixture
def server(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A server on a free port that is ready; whatever happens, it ends."""
    options = ["--listen", "tcp/127.0.0.1:0", "--journal", str(tmp_path / "journal.db"), "--name", "test-run"]
    process = subprocess.Popen(
        [sys.executable, "-c", ENTRY, "run", *options],
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    yield process
    if process.poll() is None:
        process.kill()
    process.communicate(timeout=30)


# SIGTERM: tests/e2e/test_restart.py
def test_an_interrupt_stops_the_server_in_order(server: subprocess.Popen[str]) -> None:
    assert server.stderr is not None
    said = next(line for line in server.stderr if "ready" in line)
    assert said.startswith("test-run: ready, 12 axes")
    assert ":0" not in said
    server.send_signal(signal.SIGINT)
    output, narration = server.communicate(timeout=60)
    assert server.returncode == 0
    assert output == ""
    assert "Traceback" not in narration
    assert "stopped" in narration


def test_a_port_that_is_taken_is_a_coded_error(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        done = subprocess.run(
            [
                sys.executable,
                "-c",
                ENTRY,
                "run",
                "--listen",
                endpoint,
                "--journal",
                str(tmp_path / "journal.db"),
            ],
            cwd=ROOT,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert done.returncode == 1
    assert "error[MC522]" in done.stderr
    assert "Traceback" not in done.stderr
