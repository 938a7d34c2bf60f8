"""Files of a recorder that was killed."""

from __future__ import annotations

import io
import random
from pathlib import Path

import pytest
from mcap.stream_reader import StreamReader

from mcserver.errors import UsageFault
from mcserver.recorder.folder import RecordingFolder
from mcserver.recorder.messages import StartRecording, StopRecording
from mcserver.recorder.repair import repair, repair_unfinished
from tests.recorder.rig import Rig, column, decoded


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("whole")
    rig = Rig(folder)
    rig.give(StartRecording(1, "one"))
    rig.cycles(4000)
    rig.give(StopRecording(2))
    rig.settle()
    return rig.folder.finished("one").read_bytes()


@pytest.mark.parametrize("share", [0.3, 0.5, 0.77, 0.9, 0.999])
def test_a_truncated_file_keeps_its_whole_chunks(tmp_path: Path, whole: bytes, share: float) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(share * len(whole))])
    found = repair(cut, tmp_path / "good.mcap")
    cycles = decoded(tmp_path / "good.mcap", "/cycles")
    numbers = column(cycles, "cycle").tolist()
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= int(share * 3000) - 600
    assert found.messages >= len(numbers)
    assert not found.whole


def test_a_truncated_file_opens_in_the_library_as_it_is(whole: bytes) -> None:
    records = StreamReader(io.BytesIO(whole[: len(whole) // 2]), emit_chunks=True).records
    # the schemas and channels, the machine, and three chunks with their indexes
    kinds = [type(next(records)).__name__ for _ in range(17)]
    assert kinds.count("Chunk") >= 3


def test_a_whole_file_stays_whole(tmp_path: Path, whole: bytes) -> None:
    source = tmp_path / "one.mcap"
    source.write_bytes(whole)
    found = repair(source, source)
    assert found.whole
    assert len(decoded(source, "/cycles")) == 4000


def test_flipped_bytes_never_give_wrong_cycles(tmp_path: Path, whole: bytes) -> None:
    chance = random.Random(3)
    # schemas and channels stand in front, without a checksum of their own
    first = whole.index(b"zstd")
    for number in range(20):
        damaged = bytearray(whole)
        for _ in range(3):
            damaged[chance.randrange(first, len(damaged))] ^= 1 << chance.randrange(8)
        source = tmp_path / f"{number}.mcap"
        source.write_bytes(damaged)
        repair(source, tmp_path / "good.mcap")
        numbers = column(decoded(tmp_path / "good.mcap", "/cycles"), "cycle").tolist()
        assert numbers == list(range(len(numbers)))


@pytest.mark.parametrize("content", [b"", b"G01 X10\n", b"\x89PNG\r\n\x1a\n" + bytes(100)])
def test_what_is_no_recording_is_refused(tmp_path: Path, content: bytes) -> None:
    source = tmp_path / "x.mcap"
    source.write_bytes(content)
    with pytest.raises(UsageFault, match="MC581"):
        repair(source, tmp_path / "y.mcap")
    assert not (tmp_path / "y.mcap").exists()


def test_what_a_killed_recorder_left_is_repaired_at_the_next_start(tmp_path: Path, whole: bytes) -> None:
    folder = RecordingFolder(tmp_path)
    folder.unfinished("left").write_bytes(whole[: len(whole) // 2])
    folder.unfinished("bad").write_bytes(b"garbage")
    (problem,) = repair_unfinished(folder)
    assert "bad.mcap.part" in problem
    assert {entry.name: entry.state for entry in folder.entries()} == {"left": "done", "bad": "unfinished"}
    assert len(decoded(folder.finished("left"), "/cycles")) > 500
