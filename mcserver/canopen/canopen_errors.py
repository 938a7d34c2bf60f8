"""Faults of the service path, each with the node, the axis and the object concerned.

Codes::

    MC008  an EDS or DCF file that cannot be understood
    MC550  a node does not answer at boot-up
    MC551  another device than the machine file says
    MC552  a configuration that the drive, or the standard, has no place for
    MC553  the drive refused an object (SDO abort)
    MC554  the drive did not answer an SDO in time
    MC555  the node did not become operational
    MC556  the drive sent an emergency message (event)
    MC557  the drive's heartbeat stays out (event)
    MC558  the drive has rebooted (event)
    MC559  an SDO request that is refused here
"""

from __future__ import annotations

from mcserver.errors import RuntimeFault


class DriveError(RuntimeFault):
    """A fault of one drive; ``details`` go into the reply of a remote call."""

    def __init__(
        self, code: str, message: str, hint: str = "", *, axis: int | None = None, **details: object
    ) -> None:
        super().__init__(code, message, hint, axis=axis)
        self.details = details


class Stopped(Exception):
    """Work with nodes is given up: the server stops while they boot, or nobody waits for it any more."""


def object_text(index: int, subindex: int) -> str:
    """Return an object as the standard's documents write it: ``60C2h:01``."""
    return f"{index:04X}h:{subindex:02X}"
