"""Keys of one machine (docs/keyspace.md); ``@v1`` and ``@rpc`` are matched by no wildcard."""

from __future__ import annotations

import re
from dataclasses import dataclass

from mcclient.errors import ConfigurationError

PROTOCOL_VERSION = 1
ALL_MACHINES = "mc/@v1/*/live/*"

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,62}")


def machine_and_instance(live_key: str) -> tuple[str, str]:
    """Of a server's liveliness token ``mc/@v1/{machine}/live/{instance}``."""
    chunks = live_key.split("/")
    return chunks[2], chunks[4]


@dataclass(frozen=True, slots=True)
class Keys:
    """All keys of one machine."""

    machine: str

    def __post_init__(self) -> None:
        if _NAME.fullmatch(self.machine) is None:
            raise ConfigurationError(
                "MC537",
                f"{self.machine!r} is no name of a machine",
                "names have letters, digits, '-', '_' and '.'",
            )

    @property
    def info(self) -> str:
        return f"mc/@v1/{self.machine}/info"

    def rpc(self, method: str) -> str:
        return self.info if method == "info" else f"mc/@v1/{self.machine}/@rpc/{method}"

    def lines_in(self, program: str) -> str:
        return f"mc/@v1/{self.machine}/in/{program}"

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
        return f"mc/@v1/{self.machine}/live/*"

    def client(self, client: str) -> str:
        return f"mc/@v1/{self.machine}/client/{client}"
