"""What simulated drives have in common that are commanded by single frames, without CANopen."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import ClassVar

from mcserver.drive_sim.fault_injection import BadRequest, Misbehaviour, values_of
from mcserver.drive_sim.motor import Hardware, Motor

# From power to the first frame [s].
BOOT_S = 0.05
NOT_CANOPEN = ("sdo_abort", "sdo_delay", "drop_sync", "ignore_setpoints", "reverse_torque", "inputs")


class StreamedNode(ABC):
    """One drive.

    Attributes:
        wake, routes: as `Cia402Node`. kind: of the machine file. title: for people.
    """

    kind: ClassVar[str]
    title: ClassVar[str]

    def __init__(
        self,
        node: int,
        transmit: Callable[[int, bytes], None],
        hardware: Hardware | None = None,
        position: float = 0.0,
    ) -> None:
        """Make a drive that is off; ``position``: of its motor [turn]."""
        self.node = node
        self.wake = 0.0
        self.routes = 0
        self.wrong = Misbehaviour()
        self.motor = Motor(hardware or Hardware(), position)
        self._transmit_frame = transmit
        self._booting = True

    @property
    def booted(self) -> bool:
        return not self._booting

    @abstractmethod
    def switch_on(self, now: float) -> None:
        """Power comes: nothing is heard for a moment."""

    @abstractmethod
    def trip(self, code: int) -> None:
        """Go into a fault; ``code``: of a request, 0: that of a shaft that does not follow."""

    @abstractmethod
    def more(self) -> Mapping[str, object]:
        """Return what `describe` tells of this kind besides."""

    def request(self, fault: str, request: Mapping[str, object], now: float) -> None:
        """A fault on demand.

        Raises:
            BadRequest: there is no such fault, or a value does not fit.
        """
        values = values_of(request, fault)
        if fault in NOT_CANOPEN:
            raise BadRequest(f"{fault} belongs to CANopen: node {self.node} is a {self.title}")
        # its frames are its only sign of life
        if self.wrong.begin("mute" if fault == "heartbeat_stop" else fault, values):
            return
        if fault == "emcy":
            self.trip(int(values["code"]))
        elif fault == "reboot":
            self.switch_on(now)
        elif fault == "following_error":
            self.motor.jammed = not values["trip"]
            if values["trip"]:
                self.trip(0)
        else:
            self.wrong = Misbehaviour()
            self.motor.jammed = False

    def describe(self) -> dict[str, object]:
        """Return what a test may want to know of the node, beyond what the bus shows."""
        return {
            "node": self.node,
            "kind": self.kind,
            "nmt": "BOOTING" if self._booting else "OPERATIONAL",
            **self.more(),
            "turns": self.motor.position,
            "turns_per_second": self.motor.velocity,
            "faults": self.wrong.active + ["following_error"] * self.motor.jammed,
        }

    def _transmit(self, identifier: int, payload: bytes) -> None:
        if self.wrong.mute:
            return
        sent = self.wrong.tpdo(identifier, payload)
        if sent is not None:
            self._transmit_frame(identifier, sent)
