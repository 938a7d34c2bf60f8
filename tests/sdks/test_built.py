"""A build is done once for its sources."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.sdks.built import build_once


class Builder:
    """Counts its builds, each of which makes a file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.source = folder / "source"
        self.source.mkdir()
        (self.source / "one.ts").write_text("1", "utf-8")
        self.output = folder / "made.js"
        self.builds = 0
        self.fails = False

    def build(self) -> None:
        self.builds += 1
        if self.fails:
            raise AssertionError("a mistake in the source")
        self.output.write_text("made", "utf-8")

    def ask(self) -> int:
        build_once("it", [self.source], [self.output], self.build, self.folder / "notes")
        return self.builds


@pytest.fixture
def builder(tmp_path: Path) -> Builder:
    return Builder(tmp_path)


def test_what_is_built_of_the_same_sources_is_not_built_again(builder: Builder) -> None:
    assert [builder.ask(), builder.ask()] == [1, 1]


def test_a_changed_a_new_and_a_missing_source_are_built(builder: Builder) -> None:
    builder.ask()
    # of the same length, within the same tick of the file system's clock
    (builder.source / "one.ts").write_text("2", "utf-8")
    assert builder.ask() == 2
    (builder.source / "two.ts").write_text("2", "utf-8")
    assert builder.ask() == 3
    (builder.source / "two.ts").unlink()
    assert builder.ask() == 4


def test_an_output_that_is_away_is_made_again(builder: Builder) -> None:
    builder.ask()
    builder.output.unlink()
    assert builder.ask() == 2


def test_a_build_that_failed_is_tried_again(builder: Builder) -> None:
    builder.ask()
    builder.fails = True
    (builder.source / "one.ts").write_text("2", "utf-8")
    for _ in range(2):
        with pytest.raises(AssertionError, match="a mistake"):
            builder.ask()
    # the outputs of before are not of these sources, and those of before are not theirs any more
    (builder.source / "one.ts").write_text("1", "utf-8")
    builder.fails = False
    assert builder.ask() == 4
