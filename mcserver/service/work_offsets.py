"""The work coordinate systems of a machine: kept from program to program, and over a restart (D-62)."""

from __future__ import annotations

import logging
from pathlib import Path

import msgspec

from mcserver.errors import ServiceError
from mcserver.gcode.profiles.frame import Frame, Offsets
from mcserver.service.kept_file import replace_file

log = logging.getLogger(__name__)


class WorkOffsets:
    """The systems that the last program left behind.

    Args:
        path: of the file that keeps them, JSON: system → axis → m or rad.

    Attributes:
        systems: origins by the number of the system, 1 for G54.
        failure: why they could not be kept; empty: they are.

    Raises:
        ServiceError: MC529 the file is there and cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.failure = ""
        self.systems: dict[int, Offsets] = {}
        try:
            self.systems = dict(msgspec.json.decode(path.read_bytes(), type=dict[int, dict[int, float]]))
        except FileNotFoundError:
            pass
        except (OSError, ValueError, RecursionError) as error:
            # programs that start from other offsets than the last ones move somewhere else
            raise ServiceError(
                "MC529",
                f"the work offsets in {path} cannot be read: {error}",
                "restore the file, or move it away and set the offsets again with mcctl zero",
            ) from error

    def frame(self) -> Frame | None:
        """Return the frame that a program starts in; None where no system was ever set."""
        return Frame(systems=self.systems) if self.systems else None

    def keep(self, frame: Frame) -> None:
        """Keep the systems of a program; a file that cannot be written leaves them in memory."""
        if frame.systems == self.systems:
            return
        self.systems = dict(frame.systems)
        try:
            replace_file(self._path, msgspec.json.encode(self.systems))
            self.failure = ""
        except OSError as error:
            self.failure = f"the work offsets could not be kept in {self._path}: {error}"
            log.error("MC529: %s", self.failure)
