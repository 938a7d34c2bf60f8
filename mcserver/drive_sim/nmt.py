"""The NMT slave: states, boot-up message, heartbeat producer and consumers (CiA 301, 7.2.8 and 7.3.2)."""

from __future__ import annotations

import math
from collections.abc import Callable

from mcserver.can.cob import Function, NmtCommand, NmtState
from mcserver.drive_sim.dictionary import ObjectStore
from mcserver.drive_sim.sdo_abort import Abort, SdoAbort

NEVER = math.inf
# From a reset to the boot-up message [s].
BOOT_S = 0.02
UNIT_S = 1e-3


class HeartbeatConsumer:
    """Watches other nodes by 1016h; a watch begins with a node's first heartbeat."""

    def __init__(self, store: ObjectStore, on_change: Callable[[], None]) -> None:
        self._entries = [store.entry(0x1016, subindex) for subindex in (1, 2)]
        for entry in self._entries:
            entry.check = self._check
            entry.action = self._changed
        self._on_change = on_change
        self._deadlines: dict[int, float] = {}

    def times(self) -> dict[int, float]:
        """Watched nodes and their times [s]."""
        values = [entry.value for entry in self._entries]
        return {value >> 16 & 0x7F: (value & 0xFFFF) * UNIT_S for value in values if value & 0xFFFF}

    def forget(self) -> None:
        """No heartbeat has been heard."""
        self._deadlines.clear()

    def heard(self, node: int, now: float) -> None:
        """A heartbeat came."""
        time_s = self.times().get(node)
        if time_s is not None:
            self._deadlines[node] = now + time_s

    def poll(self, now: float) -> tuple[int | None, float]:
        """Return a node that has just been lost, and when to ask again."""
        for node, deadline in self._deadlines.items():
            if now >= deadline:
                del self._deadlines[node]
                return node, now
        return None, min(self._deadlines.values(), default=NEVER)

    def _changed(self, _value: int) -> None:
        self.forget()
        self._on_change()

    def _check(self, value: int) -> None:
        node, time_ms = value >> 16 & 0xFF, value & 0xFFFF
        if time_ms and not 1 <= node <= 127:
            raise SdoAbort(Abort.INVALID_VALUE)


class NmtSlave:
    """One node's state. `state` is None while it boots and is silent."""

    def __init__(
        self,
        node: int,
        store: ObjectStore,
        transmit: Callable[[int, bytes], None],
        on_reset: Callable[[bool], None],
        on_change: Callable[[NmtState | None, NmtState | None], None],
    ) -> None:
        """``on_reset(whole)``: the application too, or the communication alone; ``on_change(old, new)``."""
        self._node = node
        self._transmit = transmit
        self._on_reset = on_reset
        self._on_change = on_change
        self._period = store.entry(0x1017)
        self._period.action = self._restart_heartbeat
        self.state: NmtState | None = None
        self.boot_s = BOOT_S
        self.beats = True
        self._boot_at = NEVER
        self._beat_at = NEVER

    @property
    def operational(self) -> bool:
        return self.state is NmtState.OPERATIONAL

    @property
    def talks(self) -> bool:
        """Whether SDO, SYNC and EMCY are used."""
        return self.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL)

    def command(self, message: bytes, now: float) -> None:
        """An NMT message; what is not for this node, or unknown, is left out."""
        if len(message) != 2 or message[1] not in (0, self._node) or self.state is None:
            return
        command = message[0]
        if command == NmtCommand.START:
            self.enter(NmtState.OPERATIONAL)
        elif command == NmtCommand.STOP:
            self.enter(NmtState.STOPPED)
        elif command == NmtCommand.ENTER_PRE_OPERATIONAL:
            self.enter(NmtState.PRE_OPERATIONAL)
        elif command == NmtCommand.RESET_NODE:
            self.reset(now, whole=True)
        elif command == NmtCommand.RESET_COMMUNICATION:
            self.reset(now, whole=False)

    def reset(self, now: float, whole: bool = True) -> None:
        """Begin to boot, the application too or the communication alone."""
        self.enter(None)
        self._on_reset(whole)
        self._beat_at = NEVER
        self._boot_at = now + self.boot_s

    def enter(self, state: NmtState | None) -> None:
        """Go to a state, and say so to the node."""
        old, self.state = self.state, state
        if old is not state:
            self._on_change(old, state)

    def poll(self, now: float) -> float:
        """Boot-up message and heartbeats that are due; when to ask again."""
        if now >= self._boot_at:
            self._boot_at = NEVER
            self._transmit(Function.HEARTBEAT + self._node, bytes((NmtState.BOOT_UP,)))
            self.enter(NmtState.PRE_OPERATIONAL)
            self._restart_heartbeat(self._period.value)
        if now >= self._beat_at and self.state is not None:
            period = self._period.value * UNIT_S
            # beats that were missed are not made up for
            self._beat_at = max(self._beat_at + period, now + 0.5 * period)
            if self.beats:
                self._transmit(Function.HEARTBEAT + self._node, bytes((self.state,)))
        return min(self._boot_at, self._beat_at)

    def _restart_heartbeat(self, period_ms: int) -> None:
        """The first heartbeat of a new time comes at once."""
        self._beat_at = 0.0 if period_ms and self.state is not None else NEVER
