"""Start parameters and exit codes of the executor's process: all that the server imports of it."""

from __future__ import annotations

import enum

import msgspec

from mcserver.machine.machine_file import Machine


class ExitCode(enum.IntEnum):
    """Exit codes of the process."""

    ASKED = 0
    BROKEN = 1
    SERVER_LOST = 3
    DRIVES = 4


class StoredReference(msgspec.Struct, frozen=True):
    """The reference of an axis, as stored by the server from one start to the next.

    Attributes:
        offset: position minus encoder reading [m or rad].
        reading: reading of the encoder now for which the reference is valid [m or rad]; None: valid at any,
            for an absolute encoder.
    """

    offset: float
    reading: float | None = None


class Start(msgspec.Struct, frozen=True):
    """The process's configuration on standard input, as MessagePack.

    Attributes:
        descriptor: of the shared memory. mailboxes: descriptor of the socket to the mailboxes of drives on
            EtherCAT; -1: the machine has none. tool: in the spindle, 0: none.
    """

    machine: Machine
    descriptor: int
    parent: int
    references: dict[int, StoredReference] = {}
    mailboxes: int = -1
    tool: int = 0
