"""What happens to a process whose standard streams are full, closed or gone."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.command import EXAMPLES, ROOT, command

ARCS = str(EXAMPLES / "arcs.gcode")


def test_a_full_disk_at_standard_output_is_a_coded_error() -> None:
    with Path("/dev/full").open("wb") as full:
        done = command("check", ARCS, "--json", stdout=full)
    assert done.returncode == 1
    assert b"error[MC015]" in done.stderr
    assert b"Traceback" not in done.stderr
    assert b"Exception ignored" not in done.stderr


def test_a_reader_that_has_gone_ends_the_command_quietly() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = command("check", ARCS, "--json", stdout=writing)
    finally:
        os.close(writing)
    assert done.returncode == 1
    assert done.stderr == b""


@pytest.mark.parametrize("redirection", [">&-", "<&-"])
def test_a_closed_stream_gives_no_traceback(redirection: str) -> None:
    program = "-" if redirection == "<&-" else ARCS
    script = f'exec "$0" -c "from mcserver.cli.app import main; main()" check {program} --json {redirection}'
    done = subprocess.run(
        ["bash", "-c", script, sys.executable],
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=100,
        check=False,
    )
    assert done.returncode in (1, 2)
    assert b"error[MC01" in done.stderr
    assert b"Traceback" not in done.stderr


def test_a_program_comes_through_a_pipe() -> None:
    done = command("check", "-", "--json", stdin=None, input=b"G1010\nG00 X1\n")
    assert (done.returncode, done.stdout) == (0, b'{"ok":true,"diagnostics":[]}\n')
