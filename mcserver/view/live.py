"""A running server's telemetry, for drawing: the newest state, and nothing that piles up."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

import zenoh

from mcserver.errors import NobodyAnswers, ServiceError, UsageFault
from mcserver.net.decoding import MessageDecoder
from mcserver.net.keys import Keys
from mcserver.net.messages import MachineStatus

FOUND_WITHIN_S = 3.0
CLOSE_LIMIT_S = 3.0


class LiveStates:
    """The newest `MachineStatus` of one machine.

    Args:
        machine: its name. endpoint: of a server or router, such as ``tcp/127.0.0.1:7447``.
        clock: monotonic time [s].

    Raises:
        UsageFault: MC017 Zenoh cannot read the endpoint.
        NobodyAnswers: MC530 nothing can be reached there, or not this machine.
    """

    def __init__(
        self,
        machine: str,
        endpoint: str,
        *,
        timeout_s: float = FOUND_WITHIN_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._newest: MachineStatus | None = None
        self._arrived_at = clock()
        self._session = _open(endpoint, timeout_s)
        try:
            keys = Keys(machine)
            _find(self._session, keys, endpoint, timeout_s)
            self._decode = MessageDecoder(MachineStatus)
            self._session.declare_subscriber(
                keys.telemetry_state, zenoh.handlers.Callback(self._on_sample, indirect=False)
            )
        except BaseException:
            self.close()
            raise

    def newest(self) -> MachineStatus | None:
        """The state that came last and was not asked for yet, else None."""
        with self._lock:
            newest, self._newest = self._newest, None
        return newest

    @property
    def silent_s(self) -> float:
        """Time since a state came [s]."""
        with self._lock:
            return self._clock() - self._arrived_at

    def close(self) -> None:
        """End the link, within `CLOSE_LIMIT_S`."""
        # a thread of its own that may be left behind: closing has been seen to hang on a dead link
        ending = threading.Thread(target=self._session.close, name="view-close", daemon=True)
        ending.start()
        ending.join(CLOSE_LIMIT_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        try:
            state = self._decode(sample.payload.to_bytes())
        except ServiceError:
            # a server of another version: silence tells the same
            return
        with self._lock:
            self._newest, self._arrived_at = state, self._clock()


def _open(endpoint: str, timeout_s: float) -> zenoh.Session:
    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": round(1000 * timeout_s),
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    try:
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise UsageFault(
            "MC017", f"--connect {endpoint}: {error}", "endpoints look like tcp/127.0.0.1:7447"
        ) from error
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise NobodyAnswers(
            "MC530",
            f"nothing can be reached at {endpoint}",
            "start a server (mcserver run), or name its endpoint with --connect",
        ) from error


def _find(session: zenoh.Session, keys: Keys, endpoint: str, timeout_s: float) -> None:
    """Wait for the machine's liveliness token."""
    arrived = threading.Event()

    def on_token(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            arrived.set()

    watch = session.liveliness().declare_subscriber(
        keys.servers, zenoh.handlers.Callback(on_token, indirect=False), history=True
    )
    try:
        if not arrived.wait(timeout_s):
            raise NobodyAnswers(
                "MC530",
                f"{endpoint} is reached, but no machine {keys.machine!r} is there",
                "name its machine file with --machine: its [machine] name is the one that is looked for",
            )
    finally:
        watch.undeclare()  # type: ignore[no-untyped-call]
