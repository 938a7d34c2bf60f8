"""How the executor's process is started, and what it says of itself: all that the server needs of it."""

from __future__ import annotations

import enum

import msgspec

from mcserver.executor.stored_reference import StoredReference
from mcserver.machine.machine_file import Machine


class ProcessState(enum.IntEnum):
    """State of the executor's process, in the mailbox."""

    STARTING = 0
    RUNNING = 1
    SERVER_LOST = 2
    ENDED = 3


class ExitCode(enum.IntEnum):
    """How the process ends by itself."""

    ASKED = 0
    BROKEN = 1
    SERVER_LOST = 3
    DRIVES = 4


class Start(msgspec.Struct, frozen=True):
    """The process's configuration on standard input, as MessagePack.

    Attributes:
        descriptor: of the shared memory. mailboxes: of a socket by which the server reaches the mailboxes of
            drives on EtherCAT; -1: the machine has none. tool: in the spindle, 0: none.
    """

    machine: Machine
    descriptor: int
    parent: int
    references: dict[int, StoredReference] = {}
    mailboxes: int = -1
    tool: int = 0
