"""Keys of one machine in the Zenoh key space (docs/keyspace.md).

``@v1`` and ``@rpc`` are verbatim chunks, which ``*`` and ``**`` never match, so that a wide subscription or
query does not reach a machine by accident. Keys of clients' messages include the client's id, so that the
network's access rules can bind the id to a certificate or a user.
"""

from __future__ import annotations

import re

import msgspec

VERSION_CHUNK = "@v1"
_ROOT = f"mc/{VERSION_CHUNK}"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,62}")
_RPC = "@rpc"
_EMERGENCY_STOP = "estop"


def is_name(text: str) -> bool:
    """Return whether ``text`` may be one chunk of a key: a machine, a program, a client or an instance."""
    return _NAME.fullmatch(text) is not None


def everything() -> str:
    """Return the key expression of everything from machines and their clients, except calls."""
    return f"{_ROOT}/**"


def instance_of(token: str) -> str:
    """Return the instance in the key of a server's liveliness token."""
    return token.rpartition("/")[2].partition(".")[0]


class Call(msgspec.Struct, frozen=True):
    """Call requested by a query's key.

    Attributes:
        client: the caller. method: its method.
        exact: the key names the machine; False: it has a wildcard there.
    """

    client: str
    method: str
    exact: bool


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

    def rpc(self, client: str, method: str) -> str:
        """Return the key for calls of a method by a client; ``*`` for all clients, or all methods."""
        return f"{self.root}/{_RPC}/{client}/{method}"

    def lines_in(self, client: str, program: str) -> str:
        """Return the key for lines of a client's program; ``*`` for every client, or program."""
        return f"{self.root}/in/{client}/{program}"

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
        return f"{self.root}/{_EMERGENCY_STOP}"

    @property
    def servers(self) -> str:
        """Key expression of the liveliness tokens of this machine's servers."""
        return f"{self.root}/live/*"

    def live(self, instance: str, session: str) -> str:
        """Return the key of a server's liveliness token.

        Args:
            instance: one start of the server. session: Zenoh id of its session.
        """
        return f"{self.root}/live/{instance}.{session}"

    def client(self, client: str) -> str:
        """Return the key of a client's liveliness token; ``*`` for all of them."""
        return f"{self.root}/client/{client}"

    def call_of(self, key: str) -> Call | None:
        """Return client and method of a query's key expression; None if one of them is a wildcard.

        The machine may be a wildcard: whether the method allows it is checked by the caller.
        """
        prefix, _, rest = key.partition(f"/{_RPC}/")
        client, _, method = rest.partition("/")
        if not (is_name(client) and is_name(method)):
            return None
        return Call(client, method, exact=prefix == self.root)

    def stream_of(self, key: str) -> tuple[str, str] | None:
        """Return client and program from the key of a put of lines; None if the key has a wildcard."""
        client, _, program = key.removeprefix(f"{self.root}/in/").partition("/")
        return (client, program) if is_name(client) and is_name(program) else None

    def is_stop(self, key: str) -> bool:
        """Return whether a put with this key expression requests an emergency stop by name.

        ``mc/@v1/*/estop`` does, for every machine at once; ``mc/@v1/**``, which also matches the key, does
        not: nobody who writes that means to stop a site.
        """
        return key.rpartition("/")[2] == _EMERGENCY_STOP
