"""Options of one start of a service: journal, id and clock."""

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
    """Return the folder of journals: systemd's ``$STATE_DIRECTORY``, or in the user's state folder (XDG)."""
    service_folder = os.environ.get("STATE_DIRECTORY")
    if service_folder:
        return Path(service_folder.partition(":")[0])
    state = os.environ.get("XDG_STATE_HOME")
    return (Path(state) if state else Path.home() / ".local" / "state") / "mcserver"


class LoadedFile(msgspec.Struct, frozen=True):
    """The machine file of this start of the server, and the SHA-256 of its text then."""

    path: Path
    sha256: str

    @classmethod
    def of(cls, path: Path) -> LoadedFile:
        """Read a file. Raises OSError."""
        return cls(path.resolve(), cls.digest(path.read_bytes()))

    @staticmethod
    def digest(content: bytes) -> str:
        """Return the SHA-256 of a file's bytes, to recognize it later."""
        return hashlib.sha256(content).hexdigest()


class ServiceOptions(msgspec.Struct, frozen=True):
    """Options of one start.

    Attributes:
        journal: the journal's file.
        instance: id of this start.
        clock: Unix time [s]. monotonic: a clock that never steps [s].
        connect: opens the journal's file. journal_thread: whether the journal has its own threads.
        authority: certificate of the site (PEM), whose signers may approve runs; None: nobody may.
        machine_file: loaded one; None: a built-in machine.
    """

    journal: Path
    instance: str
    clock: Callable[[], float] = time.time
    monotonic: Callable[[], float] = time.monotonic
    connect: Callable[[Path], sqlite3.Connection] = open_journal
    journal_thread: bool = True
    authority: bytes | None = None
    machine_file: LoadedFile | None = None
