"""Texts that clients hand over by parts."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from mcserver.errors import Refused
from mcserver.service import kept_texts
from mcserver.service.arming import hash_of
from mcserver.service.kept_texts import KeptTexts

TEXT = "G1 X1\nG1 X2\nM30"
SHA = hash_of(TEXT)


@pytest.fixture
def texts(tmp_path: Path) -> KeptTexts:
    return KeptTexts(tmp_path / "texts")


def put(texts: KeptTexts, text: str = TEXT, size: int = 4) -> None:
    raw, received = text.encode(), 0
    while received < len(raw):
        received = texts.take(hash_of(text), len(raw), received, raw[received : received + size]).received


def test_a_text_is_whole_when_all_its_parts_are_there(texts: KeptTexts) -> None:
    with pytest.raises(Refused, match="MC590"):
        texts.find(SHA)
    put(texts)
    found = texts.find(SHA)
    assert (found.path.read_text(), found.lines) == (TEXT, 3)


def test_a_part_that_is_sent_again_or_too_soon_changes_nothing(texts: KeptTexts) -> None:
    raw = TEXT.encode()
    assert texts.take(SHA, len(raw), 0, raw[:4]).received == 4
    assert texts.take(SHA, len(raw), 0, raw[:4]).received == 4
    assert texts.take(SHA, len(raw), 8, raw[8:]).received == 4
    assert texts.take(SHA, len(raw), 4, raw[4:]).complete


def test_another_text_than_its_hash_says_is_refused_and_gone(texts: KeptTexts) -> None:
    with pytest.raises(Refused, match="MC590"):
        texts.take(SHA, 3, 0, b"G28")
    assert not texts.has(SHA)
    put(texts)
    assert texts.has(SHA)


def test_the_one_that_was_asked_for_longest_ago_gives_way(texts: KeptTexts) -> None:
    for number in range(kept_texts.TEXTS):
        put(texts, f"G1 X{number}")
    first = b"G1 X0"
    texts.take(hash_of("G1 X0"), len(first), 0, first)
    put(texts, "G1 Y1")
    assert texts.has(hash_of("G1 X0"))
    assert not texts.has(hash_of("G1 X1"))
    assert len(list(texts.find(hash_of("G1 Y1")).path.parent.iterdir())) == kept_texts.TEXTS


def test_a_disk_that_is_nearly_full_keeps_its_room_for_the_journal(
    texts: KeptTexts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=kept_texts.FREE_BYTES))
    with pytest.raises(Refused, match="MC591"):
        put(texts)


def test_a_text_beyond_all_bounds_is_refused_before_its_first_byte_is_kept(texts: KeptTexts) -> None:
    with pytest.raises(Refused, match="MC591"):
        texts.take(SHA, kept_texts.TEXT_BYTES + 1, 0, b"G1")


def test_what_an_earlier_start_left_goes(tmp_path: Path) -> None:
    first = KeptTexts(tmp_path / "texts")
    put(first)
    assert not KeptTexts(tmp_path / "texts").has(SHA)
    assert not (tmp_path / "texts").exists()


def test_an_end_and_a_start_remove_texts_and_nothing_else(tmp_path: Path) -> None:
    folder = tmp_path / "journal.texts"
    folder.mkdir()
    (folder / "drawing.gcode").write_text("somebody else's")
    (folder / ("a" * 64 + ".gcode")).write_text("of an earlier start")
    texts = KeptTexts(folder)
    assert [each.name for each in folder.iterdir()] == ["drawing.gcode"]
    texts.close()
    assert [each.name for each in folder.iterdir()] == ["drawing.gcode"]
