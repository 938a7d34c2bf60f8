"""The benchmarks' own arithmetic; no test depends on how fast anything is."""

from __future__ import annotations

import importlib

import pytest

from tests.bench.__main__ import SECTIONS, main, table_of
from tests.bench.figures import Figure, percentile


@pytest.mark.parametrize("name", SECTIONS)
def test_every_section_has_a_measure(name: str) -> None:
    assert callable(importlib.import_module(f"tests.bench.{name}").measure)


def test_the_ratio_is_measured_over_floor() -> None:
    assert Figure("a", 3.0, "s", 2.0).ratio == 1.5
    assert Figure("a", 3.0, "s").ratio is None


def test_a_percentile_is_one_of_the_values() -> None:
    assert percentile([3.0, 1.0, 2.0, 4.0], 0.5) == 3.0
    assert percentile([3.0, 1.0], 1.0) == 3.0


def test_a_table_has_a_row_for_each_figure() -> None:
    assert table_of([Figure("a", 1.0, "s"), Figure("b", 12345.6, "lines/s", 2.0, "x", "y")]).row_count == 2


def test_a_section_that_breaks_is_said_and_does_not_stop_the_rest(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> list[Figure]:
        raise FileNotFoundError("no such part")

    monkeypatch.setattr("tests.bench.squares.measure", fail)
    assert main(["squares"]) == 0
    assert "not available: FileNotFoundError: no such part" in capsys.readouterr().out


def test_an_unknown_section_lists_those_there_are(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["nonsense"]) == 2
    assert "parsing" in capsys.readouterr().err
