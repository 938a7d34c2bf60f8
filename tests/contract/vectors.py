"""Reads `clients/contract`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[2] / "clients" / "contract"


def read(name: str) -> Any:
    return json.loads((FOLDER / name).read_text("utf-8"))


def names(folder: str) -> list[str]:
    return sorted(path.stem for path in (FOLDER / folder).glob("*.json"))


GARBAGE = read("garbage.json")["refused"]
