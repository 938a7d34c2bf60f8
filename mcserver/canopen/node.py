"""One node as the master sees it: what it last said, and what it is taken for."""

from __future__ import annotations

import enum
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from mcserver.can.cob import Function, NmtState
from mcserver.canopen.emergency_text import Emergency, decode_emergency
from mcserver.canopen.network import PortNetwork
from mcserver.canopen.sdo import NodeSdo
from mcserver.canopen.settings import DriveSettings

# Heartbeats that may stay out, and the least time that counts as silence: a loaded computer reads late [s].
MISSED_HEARTBEATS = 3
LEAST_SILENCE_S = 0.5
# Telemetry of drives without a heartbeat comes at least so often [s].
TELEMETRY_SILENCE_S = 1.0
# Emergency messages that wait to be told; those beyond are counted.
MAX_EMERGENCIES = 16
_STATUSWORD_BYTES = 2


class Phase(enum.Enum):
    """What the master takes a node for."""

    BOOTING = "booting"  # at the server's start
    OPERATIONAL = "operational"
    LOST = "lost"  # nothing is heard of it
    RESTARTING = "restarting"  # it has rebooted and is configured again
    FAILED = "failed"  # its configuration did not succeed; tried again
    CLOSED = "closed"


@dataclass(frozen=True)
class Identity:
    """1000h and 1018h:01, :02; None where the drive does not say."""

    device_type: int | None = None
    vendor_id: int | None = None
    product_code: int | None = None


class Node:
    """A drive's node. Handlers run in the bus's thread; what they set is read by any thread.

    Args:
        settings: of the machine file. network: of its bus. sdo: None for drives without.
        clock: seconds, never stepping.
    """

    def __init__(
        self,
        settings: DriveSettings,
        network: PortNetwork,
        sdo: NodeSdo | None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.settings = settings
        self.sdo = sdo
        self.phase = Phase.BOOTING
        self.identity = Identity()
        # why it is FAILED, and what it did without at its configuration
        self.failure = ""
        self.remarks: tuple[str, ...] = ()
        self.nmt: NmtState | None = None
        self.boot_ups = 0
        self.emergency: Emergency | None = None
        self.emergency_at = 0.0
        self.emergencies: deque[Emergency] = deque(maxlen=MAX_EMERGENCIES)
        self.emergencies_dropped = 0
        self.tell_at = 0.0
        self.seen_at: float | None = None
        self.status: bytes = b""
        self.retry_at = 0.0
        self.failures = 0
        self._in_emergency = False
        self._clock = clock
        self._heard = threading.Condition()
        node = settings.node
        if sdo is not None:
            network.handle(Function.HEARTBEAT + node, self._on_heartbeat)
            network.handle(Function.EMCY + node, self._on_emergency)
            network.handle(Function.TPDO1 + node, self._on_status)
        else:
            network.handle(Function.TPDO1 + node, self._on_telemetry)
            network.handle(Function.TPDO2 + node, self._on_presence)

    # ------------------------------------------------------------ what it says

    def _on_heartbeat(self, payload: bytes) -> None:
        if len(payload) != 1:
            return
        try:
            # bit 7 is the toggle bit of node guarding
            state = NmtState(payload[0] & 0x7F)
        except ValueError:
            return
        with self._heard:
            if state is NmtState.BOOT_UP:
                self.boot_ups += 1
            self.nmt = state
            self.seen_at = self._clock()
            self._heard.notify_all()

    def _on_emergency(self, payload: bytes) -> None:
        emergency = decode_emergency(payload)
        if emergency is None:
            return
        self.emergency = emergency
        self.emergency_at = self._clock()
        if emergency.cleared and not self._in_emergency:
            # said at every reset by some devices, and no news
            return
        self._in_emergency = not emergency.cleared
        if len(self.emergencies) == MAX_EMERGENCIES:
            self.emergencies_dropped += 1
        self.emergencies.append(emergency)

    def _on_status(self, payload: bytes) -> None:
        if len(payload) >= _STATUSWORD_BYTES:
            self.status = payload[:_STATUSWORD_BYTES]

    def _on_telemetry(self, payload: bytes) -> None:
        self._on_status(payload)
        self._on_presence(payload)

    def _on_presence(self, _payload: bytes) -> None:
        with self._heard:
            self.seen_at = self._clock()
            self._heard.notify_all()

    # ------------------------------------------------------------ what is asked of it

    @property
    def statusword(self) -> int | None:
        """The newest word of its first TPDO: the statusword, or a Servosila drive's fault bits."""
        return int.from_bytes(self.status, "little") if self.status else None

    @property
    def silence_limit_s(self) -> float | None:
        """Silence that means it is gone [s]; None: it is not watched."""
        if self.sdo is None:
            return TELEMETRY_SILENCE_S
        if self.settings.heartbeat_ms == 0:
            return None
        return max(LEAST_SILENCE_S, MISSED_HEARTBEATS * self.settings.heartbeat_ms / 1000.0)

    def is_silent(self, now: float) -> bool:
        """Whether it has been silent for too long."""
        limit = self.silence_limit_s
        return limit is not None and (self.seen_at is None or now - self.seen_at > limit)

    def wait(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Waits for something that a heartbeat, a boot-up or telemetry brings; whether it came."""
        with self._heard:
            return self._heard.wait_for(until, timeout_s)

    def wake(self) -> None:
        """Lets waiters look again, such as when the server stops."""
        with self._heard:
            self._heard.notify_all()
