"""Parquet files of the history on their way to an object store, by fsspec (extra ``store``)."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

import fsspec

from mcserver.errors import ConfigurationError

log = logging.getLogger(__name__)


class HistoryStore:
    """Where the files of a folder are moved to, such as ``s3://bucket/history``.

    Raises:
        ConfigurationError: MC086 the address cannot be meant, or its package is missing.
    """

    def __init__(self, address: str) -> None:
        try:
            self._files, self._base = fsspec.url_to_fs(address)
        except (ImportError, ValueError, OSError) as error:
            raise ConfigurationError(
                "MC086",
                f"{address} cannot be written to: {error}",
                "such as s3://BUCKET/FOLDER, with pip install s3fs",
            ) from error

    def move(self, folder: Path) -> None:
        """Move every file that is there; what cannot be moved stays for the next time."""
        for path in sorted(folder.glob("*/day=*/*.parquet")):
            try:
                # a whole file or none: stores show nothing before its end
                self._files.put_file(str(path), f"{self._base}/{path.relative_to(folder).as_posix()}")
            # each store has errors of its own
            except Exception as error:
                log.warning("the history is not moved to %s: %s", self._base, error)
                return
            path.unlink()

    async def keep_moving(self, folder: Path, period_s: float) -> None:
        """Move files again and again, beside the loop, until it is cancelled."""
        while True:
            await asyncio.to_thread(self.move, folder)
            await asyncio.sleep(period_s)
