"""Sync commits to disk in a separate thread, so that no commit waits for a sync or a checkpoint."""

from __future__ import annotations

import contextlib
import os
import sqlite3
import threading
import time
from collections.abc import Callable
from pathlib import Path

from mcserver.service.journal_file import refusing_unusable

SYNC_PERIOD_S = 0.25
CHECKPOINT_PERIOD_S = 5.0


class DiskSync:
    """Syncs a database's write-ahead log, and checkpoints it into the database.

    Args:
        path: of the database, which is open in WAL mode.
        on_sync: called in this thread before each sync; its result is called after a successful one.

    Raises:
        ServiceError: MC520 it cannot be opened a second time.
    """

    def __init__(self, path: Path, on_sync: Callable[[], Callable[[], None]]) -> None:
        self._on_sync = on_sync
        self._since: float | None = None
        self._wanted = threading.Event()
        self._closing = threading.Event()
        with refusing_unusable(path):
            self._connection = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
            # a checkpoint syncs the log before it and the database after it, as needed to survive a power cut
            self._connection.execute("PRAGMA synchronous=NORMAL")
            # also opens the log
            self._connection.execute("PRAGMA user_version").fetchone()
            self._log = os.open(f"{path}-wal", os.O_RDONLY | os.O_CLOEXEC)
        self._thread = threading.Thread(target=self._run, name="journal-sync", daemon=True)
        self._thread.start()

    @property
    def lasts_s(self) -> float:
        """Duration of the present sync or checkpoint so far [s]; 0 without one."""
        since = self._since
        return 0.0 if since is None else time.monotonic() - since

    def committed(self) -> None:
        """Schedule a sync within `SYNC_PERIOD_S`; from any thread."""
        self._wanted.set()

    def close(self, timeout_s: float) -> None:
        """Sync the rest and close; after the writer has closed, so that this is the last checkpoint."""
        self._closing.set()
        self._wanted.set()
        self._thread.join(timeout_s)

    def _run(self) -> None:
        checkpoint = time.monotonic()
        with contextlib.closing(self._connection):
            closing = False
            while not closing:
                self._wanted.wait()
                self._wanted.clear()
                closing = self._closing.is_set()
                self._since = now = time.monotonic()
                synced = self._on_sync()
                with contextlib.suppress(OSError):
                    os.fdatasync(self._log)
                    synced()
                if now - checkpoint >= CHECKPOINT_PERIOD_S:
                    checkpoint = now
                    with contextlib.suppress(sqlite3.Error):
                        self._connection.execute("PRAGMA wal_checkpoint(PASSIVE)")
                self._since = None
                self._closing.wait(SYNC_PERIOD_S)
        os.close(self._log)
