"""Drives on a CAN bus that take a command in every cycle and report by themselves, without SYNC."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING

from mcserver.can.cob import RPDOS, Function
from mcserver.can.port import CanPort
from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from mcserver.machine.drive import CanDrive

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis


class StreamedAxis(ABC):
    """One axis in the cycle of its bus.

    Attributes:
        position, velocity: of the axis [m, rad; per second]. state, fault, detail: as `Feedback`.
        fresh: telemetry is no older than its rate allows. age, limit: of it, and from when on it is lost
            [cycles].
        short: telemetry with a wrong length.
        complaint: in which way it is not set up as the machine file says, and what to do; empty: in none.
    """

    def __init__(self, axis: Axis, limit: int) -> None:
        self.limit = limit
        self.age = 1 << 30
        self.position = axis.initial_position
        self.velocity = 0.0
        self.state = DriveState.OFF
        self.fault = DriveFault.NONE
        self.detail = 0
        self.fresh = False
        self.short = 0
        self.complaint: tuple[str, str] | None = None
        self._commanded = DriveMode.OFF
        # of the port, and where a frame's payload begins there
        self._send: Callable[[bytearray], bool] = lambda _buffer: False
        self._at = 0

    @property
    @abstractmethod
    def booted(self) -> bool:
        """Whether all that it reports has come."""

    @abstractmethod
    def open(self, port: CanPort) -> dict[int, Callable[[bytes], None]]:
        """Prepare the frames that go out; return what to call for which COB-ID."""

    @abstractmethod
    def read(self) -> None:
        """Take over what has come, once a cycle."""

    def fail(self, fault: DriveFault, detail: int = 0) -> bool:
        """Latch a fault; False: one is latched already, or nobody commands the drive (G1011)."""
        if self.fault is not DriveFault.NONE or self._commanded is DriveMode.SILENT:
            return False
        self.fault, self.detail = fault, detail
        return True

    @abstractmethod
    def step(self, commanded: DriveMode, position: float, velocity: float, torque: float) -> bool:
        """Go on by one cycle and send the command; False: it found no room."""


class StreamedDrive(CanDrive, frozen=True, tag="streamed"):
    """``[axis.drive]`` of such a drive."""

    @property
    def telemetry_ids(self) -> tuple[int, ...]:
        """COB-IDs of its telemetry; the first one's has its faults."""
        return Function.TPDO1 + self.node, Function.TPDO2 + self.node

    @property
    def foreign_ids(self) -> tuple[int, ...]:
        """COB-IDs that somebody else sends, or has it send, who is master of its bus."""
        return tuple(each + self.node for each in RPDOS)

    @property
    def question(self) -> tuple[int, bytes] | None:
        """A frame that it answers with telemetry and that changes nothing; None: it speaks by itself."""
        return None

    def axis(self, axis: Axis, cycle_s: float, silence_cycles: int) -> StreamedAxis:
        """Return its axis in the cycle; ``silence_cycles`` without telemetry are a fault."""
        raise NotImplementedError

    def fault_bits(self, telemetry: bytes) -> int | None:
        """Return the faults in the telemetry of its first COB-ID, 0: none; None: it says nothing."""
        raise NotImplementedError

    def fault_text(self, bits: int) -> str:
        """Return fault bits in words."""
        raise NotImplementedError

    def monitored(self, telemetry: bytes) -> dict[str, float]:
        """Return what else is shown of the same telemetry, by name and unit."""
        raise NotImplementedError
