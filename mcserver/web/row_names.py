"""What people call work offsets and tools: kept by the page, beside a machine's programs."""

from __future__ import annotations

from pathlib import Path

import msgspec

from mcserver.errors import ServiceError
from mcserver.web.translation import mark

MAX_NAME = 60
MAX_NAMES = 1000


class RowNames:
    """Names by row, ``G54`` or ``T3``; for people alone.

    Args:
        path: of the JSON file that keeps them.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self.names: dict[str, str] = msgspec.json.decode(path.read_bytes(), type=dict[str, str])
        except (OSError, ValueError, RecursionError):
            # names move nothing: without a file that can be read there are none
            self.names = {}

    def name(self, row: str, name: str) -> None:
        """Give a row a name; an empty one takes it away.

        Raises:
            ServiceError: MC061 it cannot be kept.
        """
        names = {key: value for key, value in self.names.items() if key != row}
        if name.strip() and len(names) < MAX_NAMES:
            names[row] = name.strip()[:MAX_NAME]
        if names == self.names:
            return
        aside = self._path.with_name(f"{self._path.name}.part")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            aside.write_bytes(msgspec.json.encode(names))
            aside.replace(self._path)
        except OSError as error:
            raise ServiceError(
                "MC061",
                mark("the name could not be kept: {why}", why=error.strerror),
                mark("make room on the disk"),
            ) from error
        self.names = names
