"""How each kept program ran last, and when: kept by the page, beside a machine's programs."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

import msgspec

log = logging.getLogger(__name__)

MOST = 1000


class LastRun(msgspec.Struct, frozen=True):
    """The end of a run.

    Attributes:
        state: as of a job. ended_at: Unix time. seconds: from its start on. user: who started it.
    """

    state: str
    ended_at: float
    seconds: float
    user: str


class LastRuns:
    """Last runs by the program's name; for people alone.

    Args:
        path: of the JSON file that keeps them.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._runs: dict[str, LastRun] = msgspec.json.decode(path.read_bytes(), type=dict[str, LastRun])
        except (OSError, ValueError, RecursionError):
            self._runs = {}

    @property
    def runs(self) -> Mapping[str, LastRun]:
        return self._runs

    def note(self, name: str, run: LastRun) -> None:
        """Keep how a program ended; a disk that keeps nothing stops no program."""
        self._runs.pop(name, None)
        self._runs[name] = run
        while len(self._runs) > MOST:
            self._runs.pop(next(iter(self._runs)))
        aside = self._path.with_name(f"{self._path.name}.part")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            aside.write_bytes(msgspec.json.encode(self._runs))
            aside.replace(self._path)
        except OSError as error:
            log.warning("last runs are not kept: %s", error)
