"""Rows of a journal that no client is told of: an operator reads them with SQL."""

from __future__ import annotations

import contextlib
import sqlite3
from pathlib import Path
from typing import Any

import msgspec

from mcserver.service.reports import LineReport


def commands_in(path: Path) -> list[tuple[Any, ...]]:
    """Who ordered what: client, method, program, detail and time, the newest first."""
    return _rows(path, "SELECT client, method, program, detail, at FROM commands ORDER BY id DESC")


def reports_in(path: Path, program: str) -> list[LineReport]:
    """Times of the lines of a program that have ended, in order."""
    rows = _rows(path, "SELECT blob FROM reports WHERE program=? ORDER BY id", program)
    return [report for (blob,) in rows for report in msgspec.msgpack.decode(blob, type=list[LineReport])]


def _rows(path: Path, statement: str, *values: str) -> list[tuple[Any, ...]]:
    with contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
        return connection.execute(statement, values).fetchall()
