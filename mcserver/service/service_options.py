"""What one start of a service is given: its journal, its id, and its clock."""

from __future__ import annotations

import hashlib
import os
import sqlite3
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from mcserver.service.journal_file import open_journal


def state_folder() -> Path:
    """Return where journals are: systemd's ``$STATE_DIRECTORY``, else in the user's state folder (XDG)."""
    service_folder = os.environ.get("STATE_DIRECTORY")
    if service_folder:
        return Path(service_folder.partition(":")[0])
    state = os.environ.get("XDG_STATE_HOME")
    return (Path(state) if state else Path.home() / ".local" / "state") / "mcserver"


class LoadedFile(msgspec.Struct, frozen=True):
    """The machine file that a server was started with, and the SHA-256 of its text then."""

    path: Path
    sha256: str

    @classmethod
    def of(cls, path: Path) -> LoadedFile:
        """Raises OSError."""
        return cls(path.resolve(), cls.digest(path.read_bytes()))

    @staticmethod
    def digest(content: bytes) -> str:
        """Return the SHA-256 of a file's bytes, by which it is known again."""
        return hashlib.sha256(content).hexdigest()


class ServiceOptions(msgspec.Struct, frozen=True):
    """Options of one start.

    Attributes:
        journal: the journal's file.
        instance: id of this start.
        clock: Unix time [s]. monotonic: a clock that never steps [s].
        connect: opens the journal's file. journal_thread: the journal has threads of its own.
        authority: certificate of the site (PEM), whose signers may approve runs; None: nobody's.
        machine_file: that was loaded; None: a built-in machine.
    """

    journal: Path
    instance: str
    clock: Callable[[], float] = time.time
    monotonic: Callable[[], float] = time.monotonic
    connect: Callable[[Path], sqlite3.Connection] = open_journal
    journal_thread: bool = True
    authority: bytes | None = None
    machine_file: LoadedFile | None = None
