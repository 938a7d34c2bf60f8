"""One node as the master sees it: what it last said, and what it is taken for."""

from __future__ import annotations

import enum
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from mcserver.can.cob import Function, NmtState
from mcserver.canopen.emergency_text import Emergency, decode_emergency
from mcserver.canopen.network import PortNetwork
from mcserver.canopen.process_data import PlannedProcessData
from mcserver.canopen.sdo import NodeSdo
from mcserver.canopen.sdo_write import SdoWrite
from mcserver.canopen.settings import DriveSettings

# Heartbeats that may stay out, and the least time that counts as silence: a loaded computer reads late [s].
MISSED_HEARTBEATS = 3
LEAST_SILENCE_S = 0.5
# Telemetry and process data of drives without a heartbeat come at least so often [s].
TELEMETRY_SILENCE_S = 1.0
# Emergency messages that wait to be reported; those beyond are counted.
MAX_EMERGENCIES = 16
# Process data that are older than this are shown no more [s].
STALE_S = 1.0
STATUSWORD = 0x6041


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


@dataclass(frozen=True)
class NodeAxis:
    """One axis of a node.

    Attributes:
        settings: of the machine file. planned: its process data; None: it streams telemetry.
        writes: its configuration. kinds: short names of the types of what is monitored, by object.
    """

    settings: DriveSettings
    planned: PlannedProcessData | None = None
    writes: tuple[SdoWrite, ...] = ()
    kinds: Mapping[tuple[int, int], str] = field(default_factory=dict)


class Node:
    """A drive's node. Handlers run in the bus's thread; what they set is read by any thread.

    Args:
        axes: those of the node, its first axis first. network: of its bus.
        sdo: its client.
    """

    def __init__(self, axes: Sequence[NodeAxis], network: PortNetwork, sdo: NodeSdo) -> None:
        self.axes = tuple(axes)
        self.settings = settings = axes[0].settings
        # PDOs that the drive refused and that are not used
        self.dropped: frozenset[str] = frozenset()
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
        self.retry_at = 0.0
        self.failures = 0
        self._last_emergency: Emergency | None = None
        # by COB-ID: the newest payload, and when it came
        self._payloads: dict[int, tuple[bytes, float]] = {}
        self._heard = threading.Condition()
        node = settings.node
        if settings.has_profile:
            network.handle(Function.HEARTBEAT + node, self._on_heartbeat)
            network.handle(Function.EMCY + node, self._on_emergency)
            for axis in self.axes:
                for pdo in axis.planned.process_data.tpdos if axis.planned else ():
                    network.handle(pdo.cob_id, self._keeper(pdo.cob_id))
        else:
            for identifier in settings.streamed.telemetry_ids if settings.streamed else ():
                network.handle(identifier, self._telemetry_keeper(identifier))

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
            self.seen_at = time.monotonic()
            self._heard.notify_all()

    def _on_emergency(self, payload: bytes) -> None:
        emergency = decode_emergency(payload)
        if emergency is None:
            return
        self.emergency = emergency
        self.emergency_at = time.monotonic()
        before, self._last_emergency = self._last_emergency, emergency
        if emergency == before or (emergency.cleared and (before is None or before.cleared)):
            # repeated, or said at every reset by some devices: no news
            return
        if len(self.emergencies) == MAX_EMERGENCIES:
            self.emergencies_dropped += 1
        self.emergencies.append(emergency)

    def _keeper(self, identifier: int) -> Callable[[bytes], None]:
        """Keep process data as they come; they are looked into when somebody asks."""

        def keep(payload: bytes) -> None:
            self._payloads[identifier] = payload, time.monotonic()

        return keep

    def _telemetry_keeper(self, identifier: int) -> Callable[[bytes], None]:
        keep = self._keeper(identifier)

        def present(payload: bytes) -> None:
            keep(payload)
            with self._heard:
                self.seen_at = time.monotonic()
                self._heard.notify_all()

        return present

    # ------------------------------------------------------------ what is asked of it

    def newest(self, identifier: int) -> bytes | None:
        """The newest process data with a COB-ID; None where they are missing, or older than `STALE_S`: what
        a lost node last showed is no state of it.
        """
        payload, at = self._payloads.get(identifier, (b"", 0.0))
        return payload if payload and time.monotonic() - at <= STALE_S else None

    def statusword_of(self, axis: NodeAxis) -> int | None:
        """Return the newest statusword of an axis, or the fault bits of a drive that streams telemetry."""
        if axis.settings.streamed is not None:
            return axis.settings.streamed.fault_bits(self.telemetry)
        raw = self.raw_of(axis, STATUSWORD + axis.settings.offset, 0, 2)
        return None if raw is None else int.from_bytes(raw, "little")

    def raw_of(self, axis: NodeAxis, index: int, subindex: int, length: int) -> bytes | None:
        """Return the newest bytes of an object in an axis's process data."""
        for pdo in axis.planned.process_data.tpdos if axis.planned else ():
            at = pdo.offset(index, subindex)
            if at is None:
                continue
            payload = self.newest(pdo.cob_id)
            return payload[at : at + length] if payload and len(payload) >= at + length else None
        return None

    @property
    def telemetry(self) -> bytes:
        """The newest telemetry with a drive's status, of one that streams it; empty where none has come."""
        streamed = self.settings.streamed
        return b"" if streamed is None else self.newest(streamed.telemetry_ids[0]) or b""

    @property
    def exchanged_at(self) -> float | None:
        """When process data came last."""
        return max((at for _, at in tuple(self._payloads.values())), default=None)

    def forget_process_data(self) -> None:
        """What came before counts no more."""
        self._payloads.clear()

    @property
    def silence_limit_s(self) -> float:
        """Silence that means it is gone [s]."""
        if not self.settings.has_profile or self._unbeating:
            return TELEMETRY_SILENCE_S
        return max(LEAST_SILENCE_S, MISSED_HEARTBEATS * self.settings.heartbeat_ms / 1000.0)

    @property
    def _unbeating(self) -> bool:
        return self.settings.has_profile and self.settings.heartbeat_ms == 0

    @property
    def heard_at(self) -> float | None:
        """When its last sign of life came: its heartbeat or, of one without, its process data."""
        if self._unbeating and self.exchanged_at is not None:
            return self.exchanged_at
        return self.seen_at

    def is_silent(self, now: float) -> bool:
        """Return whether it has been silent for too long."""
        if self._unbeating and self.exchanged_at is None:
            # no cycle exchanges process data with it yet
            return False
        heard = self.heard_at
        return heard is None or now - heard > self.silence_limit_s

    def wait(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for something that a heartbeat, a boot-up or telemetry brings; whether it came."""
        with self._heard:
            return self._heard.wait_for(until, timeout_s)

    def wake(self) -> None:
        """Let waiters look again, such as when the server stops."""
        with self._heard:
            self._heard.notify_all()
