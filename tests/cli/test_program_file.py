"""Reading programs: every way in which a file can fail has a code and a remedy."""

from __future__ import annotations

import io
from pathlib import Path
from types import SimpleNamespace

import pytest

from mcserver.cli import program_file
from mcserver.cli.exit_codes import UsageFault
from mcserver.cli.program_file import read_program
from mcserver.cli.program_text import load_program


def test_a_file_is_read_as_bytes(tmp_path: Path) -> None:
    path = tmp_path / "p.gcode"
    path.write_bytes(b"G01 X1\r\n")
    assert read_program(str(path)) == b"G01 X1\r\n"


def test_a_dash_reads_standard_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(b"G00 X1")))
    assert read_program("-") == b"G00 X1"


def test_a_closed_standard_input_is_a_usage_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", None)
    with pytest.raises(UsageFault, match="MC010"):
        read_program("-")


@pytest.mark.parametrize("name", ["missing.gcode", "missing/p.gcode", "nul\0name"])
def test_what_is_not_there_is_a_usage_fault(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageFault, match="MC010"):
        read_program(str(tmp_path / name))


def test_a_folder_is_no_program(tmp_path: Path) -> None:
    with pytest.raises(UsageFault, match=r"MC010.*is a folder"):
        read_program(str(tmp_path))


def test_an_endless_file_is_refused_at_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(program_file, "MAX_PROGRAM_BYTES", 4096)
    with pytest.raises(UsageFault, match="MC011"):
        read_program("/dev/zero")


def test_bytes_that_are_no_text_are_faults_of_the_program(tmp_path: Path) -> None:
    path = tmp_path / "p.gcode"
    path.write_bytes(b"G00 X1\nG01 \xff\0\n")
    program = load_program(str(path))
    assert [(each.code, each.line) for each in program.faults] == [("MC100", 2)]
    assert program.lines[1] == "G01 \u00ff\0"
