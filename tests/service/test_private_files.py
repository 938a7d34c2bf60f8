"""Programs and who ran them are nobody else's to read on the server's computer."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from mcserver.service.arming import hash_of
from mcserver.service.kept_file import replace_file
from mcserver.service.kept_texts import KeptTexts
from tests.service.conftest import Bench


@pytest.fixture(autouse=True)
def _open_umask() -> Iterator[None]:
    before = os.umask(0o022)
    yield
    os.umask(before)


def modes(folder: Path) -> dict[str, int]:
    return {each.name: each.stat().st_mode & 0o777 for each in folder.iterdir()}


async def test_the_journal_and_all_beside_it_are_readable_by_the_owner_only(tmp_path: Path) -> None:
    bench = Bench(tmp_path / "journal.db")
    bench.service.start()
    await bench.opened("G01 X1 F100")
    found = modes(tmp_path)
    await bench.service.stop()
    assert {"journal.db", "journal.db-wal", "journal.db-shm", "journal.db-commits"} <= set(found)
    assert set(found.values()) == {0o600}
    assert set(modes(tmp_path).values()) == {0o600}


def test_kept_texts_and_small_files_are_readable_by_the_owner_only(tmp_path: Path) -> None:
    texts = KeptTexts(tmp_path / "texts")
    texts.take(hash_of("G1 X1"), 5, 0, b"G1 X1")
    replace_file(tmp_path / "offsets.json", b"{}")
    assert modes(tmp_path) == {"texts": 0o700, "offsets.json": 0o600}
    assert set(modes(tmp_path / "texts").values()) == {0o600}
