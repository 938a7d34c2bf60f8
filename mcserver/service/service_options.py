"""What one start of a service is given: its journal, its id, and its clock."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from mcserver.service.journal_file import JournalConnection, open_journal


class ServiceOptions(msgspec.Struct, frozen=True):
    """Options of one start.

    Attributes:
        journal: the journal's file.
        instance: id of this start.
        clock: Unix time [s].
        connect: opens the journal's file. journal_thread: the journal has threads of its own.
    """

    journal: Path
    instance: str
    clock: Callable[[], float] = time.time
    connect: Callable[[Path], JournalConnection] = open_journal
    journal_thread: bool = True
