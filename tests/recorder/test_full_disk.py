"""A disk that really fills while a recording is written, and garbage in the recordings' folder."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mcserver.recorder.folder import RecordingFolder
from mcserver.recorder.messages import Answer, SaveBlackBox, StartRecording, StopRecording, Trouble
from tests.recorder.rig import Rig, column, decoded


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 256 KiB."""
    folder = tmp_path / "small"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(folder)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("only root may mount a small disk")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def noisy(rig: Rig, cycles: int) -> None:
    """Cycles that do not compress: the last digits of encoders are noise."""
    noise = np.random.default_rng(1)
    for _ in range(cycles // 100):
        rig.row.torque[:] = noise.normal(size=rig.axes)
        rig.row.actual[:] = noise.normal(size=rig.axes)
        rig.cycles(100)


def test_a_recording_on_a_full_disk_keeps_its_whole_chunks_and_says_so(small_disk: Path) -> None:
    rig = Rig(small_disk)
    rig.give(StartRecording(1, "one"))
    noisy(rig, 40_000)
    rig.give(StopRecording(2))
    reports = rig.settle()
    (trouble,) = [each for each in reports if isinstance(each, Trouble)]
    assert trouble.code == "MC582"
    assert "No space left" in trouble.message
    (kept,) = small_disk.glob("one.mcap*")
    cycles = column(decoded(kept, "/cycles"), "cycle")
    assert len(cycles) > 0
    assert np.array_equal(cycles, np.arange(cycles[0], cycles[0] + len(cycles)))


def test_what_a_full_disk_refused_is_written_once_there_is_room(small_disk: Path) -> None:
    ballast = small_disk / "ballast"
    with ballast.open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, os.statvfs(small_disk).f_bavail * 4096 - 4096)
    rig = Rig(small_disk)
    rig.cycles(2000)
    rig.give(SaveBlackBox(1))
    rig.cycles(100)
    # no more cycles while its thread writes: the box would outgrow the disk
    while not any(isinstance(each, Answer) for each in rig.reports):
        time.sleep(0.001)
        rig.turn()
    assert [each.code for each in rig.reports if isinstance(each, Trouble)] == ["MC582"]
    # the box itself is in memory
    ballast.unlink()
    rig.give(SaveBlackBox(2))
    answers = [each for each in rig.settle() if isinstance(each, Answer)]
    assert [(each.ticket, each.code) for each in answers][-1] == (2, "")
    saved = small_disk / f"{answers[-1].name}.mcap"
    assert column(decoded(saved, "/cycles"), "cycle")[0] == 0


def test_garbage_in_the_folder_is_neither_listed_nor_deleted(tmp_path: Path) -> None:
    garbage = {
        "notes.txt": b"mine",
        ".hidden.mcap": b"",
        "blackbox-.mcap.part": b"\x89MCAP0\r\nno records",
        "a b.mcap": b"\x00" * 100,
    }
    for name, content in garbage.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "folder.mcap").mkdir()
    (tmp_path / "gone.mcap").symlink_to(tmp_path / "nowhere")
    rig = Rig(tmp_path, keep=1)
    rig.cycles(500)
    for ticket in (1, 2, 3):
        rig.give(SaveBlackBox(ticket))
        rig.cycles(500)
    reports = rig.settle()
    assert [each.code for each in reports if isinstance(each, Answer)] == ["", "", ""]
    listed = RecordingFolder(tmp_path).entries(frozenset())
    boxes = [each for each in listed if each.kind == "blackbox" and each.state == "done"]
    assert len(boxes) == 1
    for name in ("notes.txt", ".hidden.mcap", "a b.mcap"):
        assert (tmp_path / name).read_bytes() == garbage[name]
    assert (tmp_path / "folder.mcap").is_dir()
