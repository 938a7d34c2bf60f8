"""``mcserver view`` from the command line."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from urllib.request import urlopen

import pytest

from mcserver.cli.app import run_command_line
from tests.cli.command import ENTRY, ROOT

LIMIT_S = 60.0
SQUARE = str(ROOT / "examples" / "square.gcode")
Capture = pytest.CaptureFixture[str]


def test_a_program_s_page_is_served_with_all_that_it_needs_until_it_is_signalled_to_end() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", ENTRY, "view", SQUARE, "--port", "0", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    try:
        assert process.stdout is not None
        answer = json.loads(process.stdout.readline())
        assert answer["ok"] is True
        with urlopen(answer["url"], timeout=LIMIT_S) as page:
            text = page.read().decode()
        assert "square.gcode on cartesian" in text
        assert 'src="http' not in text
        with urlopen(f"{answer['url']}model", timeout=LIMIT_S) as model:
            assert [part["name"] for part in json.load(model)["parts"]][-1] == "quill"
        process.send_signal(signal.SIGTERM)
        rest, narration = process.communicate(timeout=LIMIT_S)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 0
    assert rest == b""
    assert answer["url"].encode() in narration


def test_a_program_with_a_fault_is_rejected_before_anything_is_shown(tmp_path: Path, capfd: Capture) -> None:
    (tmp_path / "bad.gcode").write_text("G01 XO\n")
    assert run_command_line(["view", str(tmp_path / "bad.gcode"), "--port", "0", "--json"]) == 4
    assert "MC101" in [each["code"] for each in json.loads(capfd.readouterr().out)["diagnostics"]]


def test_a_program_has_to_be_named() -> None:
    assert run_command_line(["view", "--json"]) == 2


def test_without_the_page_s_packages_the_command_names_the_extra() -> None:
    hidden = (
        "import importlib.util as found; real = found.find_spec\n"
        "found.find_spec = lambda name, *rest: None if name == 'nicegui' else real(name, *rest)\n"
        f"{ENTRY}"
    )
    answer = subprocess.run(
        [sys.executable, "-c", hidden, "view", SQUARE],
        capture_output=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "NO_COLOR": "1"},
        timeout=LIMIT_S,
        check=False,
    )
    assert answer.returncode == 3
    assert b"mcserver[web]" in answer.stderr
