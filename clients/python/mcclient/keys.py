"""Keys of one machine (docs/keyspace.md); ``@v1`` and ``@rpc`` are matched by no wildcard."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import NamedTuple

from mcclient.errors import ConfigurationError

PROTOCOL_VERSION = 1
ALL_MACHINES = "mc/@v1/*/live/*"

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,62}")


def is_name(text: str) -> bool:
    """Return whether ``text`` may stand as one chunk of a key: a machine, a program, a client."""
    return _NAME.fullmatch(text) is not None


class Server(NamedTuple):
    """What a server's liveliness token says: one start of a machine's server, and who speaks for it.

    Attributes:
        session: the Zenoh id that its replies and samples come from; a server may change it.
    """

    machine: str
    instance: str
    session: str


def server_of(live_key: str) -> Server:
    """Read a server's liveliness token ``mc/@v1/{machine}/live/{instance}.{session}``."""
    chunks = live_key.split("/")
    instance, _, session = chunks[4].partition(".")
    return Server(chunks[2], instance, session)


def live_key(machine: str) -> str:
    """Key expression of the liveliness tokens of one machine's servers.

    Raises:
        ConfigurationError: MC537 it is no name of a machine.
    """
    if not is_name(machine):
        raise ConfigurationError(
            "MC537",
            f"{machine!r} is no name of a machine",
            "names have letters, digits, '-', '_' and '.', 63 at most",
        )
    return f"mc/@v1/{machine}/live/*"


def machine_of_call(key: str) -> str:
    """Return the machine in a method's key ``mc/@v1/{machine}/@rpc/…``."""
    return key.split("/")[2]


@dataclass(frozen=True, slots=True)
class Keys:
    """All keys of one machine, as one client uses them.

    Attributes:
        machine: its name. client: this client's id, a part of every key that it calls or sends lines on.
    """

    machine: str
    client: str

    def rpc(self, method: str) -> str:
        return f"mc/@v1/{self.machine}/@rpc/{self.client}/{method}"

    def lines_in(self, program: str) -> str:
        return f"mc/@v1/{self.machine}/in/{self.client}/{program}"

    def ack(self, program: str) -> str:
        return f"mc/@v1/{self.machine}/ack/{program}"

    @property
    def event(self) -> str:
        return f"mc/@v1/{self.machine}/event"

    @property
    def samples(self) -> str:
        return f"mc/@v1/{self.machine}/tele/batch"

    @property
    def state(self) -> str:
        return f"mc/@v1/{self.machine}/tele/state"

    @property
    def emergency_stop(self) -> str:
        return f"mc/@v1/{self.machine}/estop"

    @property
    def live(self) -> str:
        return live_key(self.machine)

    @property
    def tokens(self) -> str:
        """Key expression of the liveliness tokens of all clients."""
        return f"mc/@v1/{self.machine}/client/*"

    @property
    def token(self) -> str:
        """Of this client's liveliness token."""
        return f"mc/@v1/{self.machine}/client/{self.client}"
