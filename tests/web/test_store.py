"""Uploaded programs."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcserver.errors import ServiceError
from mcserver.web import store as module
from mcserver.web.store import ProgramStore


def test_what_is_written_is_listed_read_and_deleted(tmp_path: Path) -> None:
    store = ProgramStore(tmp_path / "machine")
    assert store.list() == []
    store.write("a b.gcode", "\ufeffG01 X1 ; µ\n".encode())
    assert [each.name for each in store.list()] == ["a b.gcode"]
    assert store.read("a b.gcode") == "G01 X1 ; µ\n"
    store.delete("a b.gcode")
    store.delete("a b.gcode")
    assert store.list() == []


def test_programs_lie_in_folders_that_go_with_the_last_of_them(tmp_path: Path) -> None:
    store = ProgramStore(tmp_path)
    for name in ("part.nc", "jobs/part.nc", "jobs/old/part.nc"):
        store.write(name, name.encode())
    (tmp_path / ".runs").mkdir()
    (tmp_path / ".runs" / "no.nc").touch()
    assert {each.name for each in store.list()} == {"part.nc", "jobs/part.nc", "jobs/old/part.nc"}
    store.delete("jobs/part.nc")
    assert store.read("jobs/old/part.nc") == "jobs/old/part.nc"
    store.delete("jobs/old/part.nc")
    assert [each.name for each in tmp_path.iterdir() if each.name != ".runs"] == ["part.nc"]


@pytest.mark.parametrize(
    "name",
    [
        "../up.gcode",
        "/etc/passwd",
        "a/../b",
        "a//b",
        "a/.b/c",
        "a/b/c/d/e/f",
        "a/",
        "..",
        ".hidden",
        "",
        "a\\b",
        "a\x00b",
        "x" * 200,
        "零" * 84,
        "\ud800",
    ],
)
def test_a_name_cannot_leave_the_folder(tmp_path: Path, name: str) -> None:
    store = ProgramStore(tmp_path / "machine")
    with pytest.raises(ServiceError, match="MC061"):
        store.write(name, b"G01")
    with pytest.raises(ServiceError, match="MC061"):
        store.read(name)


def test_comments_of_older_cam_systems_are_read(tmp_path: Path) -> None:
    store = ProgramStore(tmp_path)
    store.write("part.nc", "(Fräser 6 mm, Süd)\nG1 X1\n".encode("latin-1"))
    assert store.read("part.nc") == "(Fräser 6 mm, Süd)\nG1 X1\n"


def test_what_is_not_text_or_too_large_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = ProgramStore(tmp_path)
    with pytest.raises(ServiceError, match="is no text"):
        store.write("a", b"\xff\xfe\0")
    monkeypatch.setattr(module, "MAX_PROGRAM_BYTES", 10)
    with pytest.raises(ServiceError, match="larger"):
        store.write("a", b"x" * 11)
    monkeypatch.setattr(module, "MAX_PROGRAMS", 1)
    store.write("a", b"G01")
    store.write("a", b"G02")
    with pytest.raises(ServiceError, match="kept already"):
        store.write("b", b"G01")


def test_a_disk_that_cannot_be_written_leaves_the_program_as_it_was(tmp_path: Path) -> None:
    store = ProgramStore(tmp_path)
    store.write("a", b"G01")
    (tmp_path / ".a.part").mkdir()
    with pytest.raises(ServiceError, match="MC061"):
        store.write("a", b"G02")
    assert store.read("a") == "G01"


def test_a_program_that_is_gone_is_named(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match=r"gone.gcode"):
        ProgramStore(tmp_path).read("gone.gcode")
