"""Keys of one machine in the Zenoh key space (docs/keyspace.md).

``@v1`` and ``@rpc`` are verbatim chunks: ``*`` and ``**`` never match them, so that a wide subscription or a
wide query does not reach a machine by accident.
"""

from __future__ import annotations

import re

import msgspec

VERSION_CHUNK = "@v1"
_ROOT = f"mc/{VERSION_CHUNK}"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,62}")
_WILD = re.compile(r"[*$]")


def is_name(text: str) -> bool:
    """Whether ``text`` may stand as one chunk of a key: a machine, a program, a client or an instance."""
    return _NAME.fullmatch(text) is not None


def is_wild(key_expression: str) -> bool:
    """Whether a key expression can match more than one key."""
    return _WILD.search(key_expression) is not None


def all_machines() -> str:
    """Key expression of the liveliness tokens of every machine, for discovery."""
    return f"{_ROOT}/*/live/*"


def machine_of(key: str) -> str:
    """The machine's name in any key of this key space.

    Raises:
        ValueError: the key is not one of this key space.
    """
    chunks = key.split("/")
    if len(chunks) < 4 or chunks[0] != "mc" or chunks[1] != VERSION_CHUNK or not is_name(chunks[2]):
        raise ValueError(f"{key!r} is not a key of {_ROOT}/{{machine}}/…")
    return chunks[2]


class Keys(msgspec.Struct, frozen=True):
    """All keys of one machine.

    Attributes:
        machine: its name; letters, digits, ``-``, ``_`` and ``.``, at most 63.
    """

    machine: str

    def __post_init__(self) -> None:
        if not is_name(self.machine):
            raise ValueError(f"{self.machine!r} cannot be part of a key: use letters, digits, '-', '_', '.'")

    @property
    def root(self) -> str:
        return f"{_ROOT}/{self.machine}"

    @property
    def info(self) -> str:
        return f"{self.root}/info"

    def rpc(self, method: str) -> str:
        """Key of one method; ``*`` for all of them."""
        return f"{self.root}/@rpc/{method}"

    def lines_in(self, program: str) -> str:
        """Key that a client puts lines on; ``*`` for every program."""
        return f"{self.root}/in/{program}"

    def ack(self, program: str) -> str:
        return f"{self.root}/ack/{program}"

    @property
    def event(self) -> str:
        return f"{self.root}/event"

    @property
    def telemetry_batch(self) -> str:
        return f"{self.root}/tele/batch"

    @property
    def telemetry_state(self) -> str:
        return f"{self.root}/tele/state"

    def telemetry_axis(self, index: int) -> str:
        return f"{self.root}/tele/axis/{index}"

    @property
    def emergency_stop(self) -> str:
        return f"{self.root}/estop"

    def live(self, instance: str) -> str:
        """Key of the server's liveliness token; one instance is one start of the server."""
        return f"{self.root}/live/{instance}"

    def client(self, client: str) -> str:
        """Key of a client's liveliness token; ``*`` for all of them."""
        return f"{self.root}/client/{client}"

    def last_chunk(self, key: str) -> str:
        """What stands for ``{program}``, ``{method}``, ``{client}`` in a key of this machine."""
        return key.rpartition("/")[2]
