"""Zenoh's configuration of the server: options, a configuration file, and what is left to the server.

What a file says holds. An option that says something else is refused, and nothing is listened on that neither
an option nor the file names, but for the loopback default where neither says anything.
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

# "… at /home/…/net/runtime.rs:123."
_SOURCE_PLACE = re.compile(r"\s*(?:\(?\bat\s+)?\S*/\S+\.rs:\d+(?::\d+)?\.?\)?")

# What holds unless a file says otherwise. Each trades memory or a slow peer's patience for the others' time.
SETTINGS: dict[str, object] = {
    # a router that is not there yet must not keep the machine from starting, nor stop it later
    "connect/timeout_ms": 0,
    "connect/exit_on_failure": False,
    "connect/retry": {"period_init_ms": 200, "period_max_ms": 2000, "period_increase_factor": 1.5},
    # by multicast a machine would join networks by accident
    "scouting/multicast/enabled": False,
    "transport/shared_memory/enabled": False,
    "transport/link/tx/lease": LEASE_MS,
    # a full queue costs this long at most for what may be dropped …
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 100,
    # only replies are larger than a batch of 64 KiB; they wait in threads of their own
    "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": 500_000,
    # … and a client that takes no answer for this long loses its link
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,
    "qos/network": reply_qos(),
    # replies wait in queues of their own, large ones apart from those to orders; these do not wait for room
    "transport/link/tx/queue/size/interactive_high": 16,
    "transport/link/tx/queue/size/interactive_low": 16,
    # connections that say nothing: with Zenoh's 100 for 10 s, a hundred of them keep everybody else out
    "transport/unicast/accept_pending": 2000,
    "transport/unicast/accept_timeout": 2000,
}


class NetworkOptions(msgspec.Struct, frozen=True):
    """How the server is reached.

    Attributes:
        listen: endpoints to listen on, a port 0 takes a free one; None: those of the file, else the default
            on the loopback where the file connects to nothing either.
        connect: routers or peers to connect to, again and again until they are there; empty: those of the
            file.
        emergency_listen: endpoints that the emergency stop's own session listens on.
        config_file: a Zenoh configuration (JSON5), for TLS and access rules.
    """

    listen: tuple[str, ...] | None = None
    connect: tuple[str, ...] = ()
    emergency_listen: tuple[str, ...] = ()
    config_file: Path | None = None


class Reach(msgspec.Struct, frozen=True):
    """Where a server listens and what it connects to, as options and file have it together."""

    mode: str
    listen: tuple[str, ...]
    connect: tuple[str, ...]


def reach(options: NetworkOptions) -> Reach:
    """Join options and file.

    Raises:
        ConfigurationError: MC521 they contradict each other, or the file is no Zenoh configuration.
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
    """Of the session that speaks for the machine; its Zenoh id is random.

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
    """Of a session for emergency stops alone; None where nothing is connected to."""
    if not (where.connect or options.emergency_listen):
        return None
    # a link of its own, so that no full queue of other messages is before a stop
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
        # events are numbered and recovered by time stamps, and clients know by them who speaks
        "timestamping/enabled": True,
    }
    if any(has_free_port(endpoint) for endpoint in listen):
        # the only way to learn which port was taken
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
    """Return what an error of Zenoh says, without places in Zenoh's own sources."""
    return _SOURCE_PLACE.sub("", str(error)).strip().rstrip(".")


def has_free_port(endpoint: str) -> bool:
    """Return whether the endpoint asks for any free port."""
    return endpoint.rpartition(":")[2].partition("#")[0].partition("?")[0] == "0"


class _Written:
    """What a configuration file says; Zenoh's own defaults count as nothing said."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._defaults = zenoh.Config()
        self._file = self.config()

    def config(self) -> zenoh.Config:
        """Return a configuration with what the file says.

        Raises:
            ConfigurationError: MC521 it is no Zenoh configuration.
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
        """Of ``listen`` or ``connect`` in this mode; None: nothing said."""
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
