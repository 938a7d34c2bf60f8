"""Rows of a journal that no client is told of: an operator reads them with SQL."""

from __future__ import annotations

import contextlib
import sqlite3
from pathlib import Path
from typing import Any


def commands_in(path: Path) -> list[tuple[Any, ...]]:
    """Who ordered what: client, method, program, detail and time, the newest first."""
    statement = "SELECT client, method, program, detail, at FROM commands ORDER BY id DESC"
    with contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
        return connection.execute(statement).fetchall()
