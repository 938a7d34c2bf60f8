"""The file that ``mcctl record`` writes here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from mcclient.cli.app import build_app
from mcclient.cli.record import Format, _file_name
from typer.testing import CliRunner


@pytest.mark.parametrize(
    ("output", "format", "name"),
    [
        (None, Format.PARQUET, "cell-1-20260314T150926Z.parquet"),
        (Path("run"), Format.CSV, "run.csv"),
        (Path("run.parquet"), Format.PARQUET, "run.parquet"),
        (Path("run.npz"), None, "run.npz"),
    ],
)
def test_a_format_names_the_file_where_nobody_has(
    output: Path | None, format: Format | None, name: str
) -> None:
    assert _file_name(output, format, "cell-1", 1773500966.0) == Path(name)


def test_a_recording_on_the_server_is_started_and_told_when_to_end(
    mcctl: Callable[..., tuple[int, str, str]],
) -> None:
    code, _, err = mcctl("record", "start", "milling", "--seconds", "90")
    assert (code, err) == (0, "cell: milling for 90.0 s recording\n")


@pytest.mark.parametrize("options", [[], ["--output", "a.csv", "--format", "parquet"], ["--format", "xls"]])
def test_what_cannot_be_meant_is_a_usage_error(options: list[str]) -> None:
    assert CliRunner().invoke(build_app(), ["record", *options]).exit_code == 2
