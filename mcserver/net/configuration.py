"""Configure the server's Zenoh sessions from options, a configuration file, and the server's settings.

The file has precedence. An option that contradicts it is refused, and the server listens only where an option
or the file says, or on the default at loopback if neither does.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import msgspec
import zenoh

from mcserver.errors import ConfigurationError
from mcserver.net.qos import reply_qos

DEFAULT_LISTEN = ("tcp/127.0.0.1:7447",)
LEASE_MS = 2000

# place in Zenoh's sources, such as "… at /home/…/net/runtime.rs:123."
_SOURCE_PLACE = re.compile(r"\s*(?:\(?\bat\s+)?\S*/\S+\.rs:\d+(?::\d+)?\.?\)?")

# Settings unless the file has them. Each trades memory, or patience with a slow peer, for others' latency.
SETTINGS: dict[str, object] = {
    # a missing router must not keep the machine from starting, nor stop it later
    "connect/timeout_ms": 0,
    "connect/exit_on_failure": False,
    "connect/retry": {"period_init_ms": 200, "period_max_ms": 2000, "period_increase_factor": 1.5},
    # with multicast a machine would join networks by accident
    "scouting/multicast/enabled": False,
    "transport/shared_memory/enabled": False,
    "transport/link/tx/lease": LEASE_MS,
    # longest wait at a full queue for messages that may be dropped
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 100,
    # only replies exceed a batch of 64 KiB; they wait in their own threads
    "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": 500_000,
    # a client that accepts no answer for this long loses its link
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,
    "qos/network": reply_qos(),
    # replies have their own queues, large ones apart from answers to commands; these do not wait for room
    "transport/link/tx/queue/size/interactive_high": 16,
    "transport/link/tx/queue/size/interactive_low": 16,
    # silent connections: with Zenoh's default of 100 for 10 s, a hundred of them keep everybody else out
    "transport/unicast/accept_pending": 2000,
    "transport/unicast/accept_timeout": 2000,
}


class NetworkOptions(msgspec.Struct, frozen=True):
    """Endpoints of the server.

    Attributes:
        listen: endpoints to listen on, port 0 for a free one; None: those of the file, or if the file does
            not connect either, the default at loopback.
        connect: routers or peers to connect to, retried until they are there; empty: those of the file.
        emergency_listen: endpoints of the emergency stop's own session.
        config_file: a Zenoh configuration (JSON5), for TLS and access rules.
    """

    listen: tuple[str, ...] | None = None
    connect: tuple[str, ...] = ()
    emergency_listen: tuple[str, ...] = ()
    config_file: Path | None = None


class Reach(msgspec.Struct, frozen=True):
    """Where a server listens and connects, from options and file together."""

    mode: str
    listen: tuple[str, ...]
    connect: tuple[str, ...]


def reach(options: NetworkOptions) -> Reach:
    """Combine options and file.

    Raises:
        ConfigurationError: MC521 they contradict each other, or the file is not a Zenoh configuration.
    """
    written = _Written(options.config_file)
    mode = written.mode or "peer"
    connect = _joined("--connect", options.connect or None, written.endpoints("connect", mode))
    listen = _joined("--listen", options.listen, written.endpoints("listen", mode))
    if mode == "client":
        if listen:
            raise _contradiction(
                f"{options.config_file} makes the server a Zenoh client, which cannot listen on "
                f"{', '.join(listen)}",
                'leave the endpoint out, or take mode: "peer"',
            )
        listen = ()
    elif listen is None:
        connects_by_file = connect is not None and options.config_file is not None
        listen = () if connects_by_file else DEFAULT_LISTEN
    return Reach(mode, listen, connect or ())


def main_configuration(options: NetworkOptions, where: Reach) -> zenoh.Config:
    """Return the configuration of the machine's session; its Zenoh id is random.

    Raises:
        ConfigurationError: MC521.
    """
    written = _Written(options.config_file)
    if written.says("id"):
        raise _contradiction(
            f"{options.config_file} gives a Zenoh id, but each session of the server needs a new one",
            "leave `id` out",
        )
    return _configuration(written, where.mode, where.listen, where.connect)


def emergency_configuration(options: NetworkOptions, where: Reach) -> zenoh.Config | None:
    """Return the configuration of a session for emergency stops only; None if nothing is connected to."""
    if not (where.connect or options.emergency_listen):
        return None
    # a separate link, so that a stop never waits in a full queue
    mode = "peer" if where.mode == "router" else where.mode
    return _configuration(_Written(options.config_file), mode, options.emergency_listen, where.connect)


def _configuration(
    written: _Written, mode: str, listen: Sequence[str], connect: Sequence[str]
) -> zenoh.Config:
    settings: dict[str, object] = {key: value for key, value in SETTINGS.items() if not written.says(key)}
    settings |= {
        "mode": mode,
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        # events are numbered and recovered by time stamps, which also tell clients who sends
        "timestamping/enabled": True,
    }
    if any(has_free_port(endpoint) for endpoint in listen):
        # the only way to find out which free port was taken
        settings["adminspace/enabled"] = True
    try:
        config = written.config()
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise ConfigurationError(
            "MC521",
            f"Zenoh refuses the configuration: {plain(error)}",
            "endpoints look like tcp/127.0.0.1:7447",
        ) from error
    return config


def plain(error: Exception) -> str:
    """Return the message of a Zenoh error, without places in Zenoh's sources."""
    return _SOURCE_PLACE.sub("", str(error)).strip().rstrip(".")


def has_free_port(endpoint: str) -> bool:
    """Return whether the endpoint requests a free port."""
    return endpoint.rpartition(":")[2].partition("#")[0].partition("?")[0] == "0"


class _Written:
    """Settings of a configuration file, without Zenoh's own defaults."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._defaults = zenoh.Config()
        self._file = self.config()

    def config(self) -> zenoh.Config:
        """Return a configuration with the file's settings.

        Raises:
            ConfigurationError: MC521 it is not a Zenoh configuration.
        """
        if self._path is None:
            return zenoh.Config()
        try:
            return zenoh.Config.from_file(self._path)
        except (zenoh.ZError, OSError, ValueError) as error:
            raise ConfigurationError(
                "MC521",
                f"{self._path} is no Zenoh configuration: {plain(error)}",
                "mcserver security init makes one: docs/security.md",
            ) from error

    def says(self, key: str) -> bool:
        return self._path is not None and self._file.get_json(key) != self._defaults.get_json(key)

    @property
    def mode(self) -> str | None:
        return json.loads(self._file.get_json("mode")) if self.says("mode") else None

    def endpoints(self, which: str, mode: str) -> tuple[str, ...] | None:
        """Return the ``listen`` or ``connect`` endpoints for this mode; None if the file has none."""
        key = f"{which}/endpoints"
        if not self.says(key):
            return None
        found = json.loads(self._file.get_json(key))
        if isinstance(found, dict):
            found = found.get(mode)
        return None if found is None else tuple(str(each) for each in found)


def _joined(
    option: str, given: tuple[str, ...] | None, written: tuple[str, ...] | None
) -> tuple[str, ...] | None:
    if given is not None and written is not None and set(given) != set(written):
        raise _contradiction(
            f"{option} {' '.join(given)} contradicts the Zenoh configuration, which has "
            f"{', '.join(written) or 'none'}",
            f"leave {option} out, or take the endpoints out of the file",
        )
    return given if given is not None else written


def _contradiction(message: str, hint: str) -> ConfigurationError:
    return ConfigurationError("MC521", message, hint)
