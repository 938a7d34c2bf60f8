"""``[axis.drive]`` of the machine file: keys of every kind of drive, and values derived from other keys.

Each kind is a type that answers others' questions about it. Those of drives on a CAN bus are in folders of
`mcserver.drives` (see `mcserver.machine.families`). Their travel per count is given in one of two ways, and
completed to both: ``counts_per_motor_rev`` with the axis's ``units_per_motor_rev``, or ``encoder``, ``gear``
and ``feed``, the objects 608Fh, 6091h and 6092h of CiA 402.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Self

import msgspec
from msgspec import Meta

from mcserver.can.cob import GREATEST_NODE, LEAST_NODE
from mcserver.machine.constraints import Count, Damping, Milliseconds, NotNegative, Positive

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis
    from mcserver.machine.bus_load import Share
    from mcserver.machine.sections import AxisSection

# Default time without commands after which a drive acts by itself [ms, cycles].
COMMAND_TIMEOUT_MS = 100
COMMAND_TIMEOUT_CYCLES = 10
# Share by which two statements of the same travel may differ.
SAME = 1e-6
# Inertia of a simulated motor whose file has none [kg·m²].
SIMULATED_INERTIA = 0.01
Refusal = Callable[[str, str, str], None]  # key, what, hint


class Drive(msgspec.Struct, frozen=True, tag_field="kind", tag="simulated"):
    """A simulated drive; its keys in a drive on a bus are for that drive's simulation.

    Attributes:
        initial_position: [mm, deg]. bandwidth_hz: of the servo loop.
        encoder_resolution: [mm, deg], 0: continuous.
        heartbeat_timeout_s: time without setpoints after which the drive stops. brake: holds without power.
        friction_decel: [mm/s², deg/s²]. inertia: at the motor [kg·m²]. max_torque: 0: not limited [N·m].
        home_switch: range in which the home switch is active, index_at: a position of the encoder's index,
            which it has once per motor turn, hard_stops: ends of the mechanics; all by the encoder [mm, deg].
        flexible_hz: natural frequency of the load on a spring at the motor; the encoder is at the load;
            0: rigid. flexible_damping: its damping ratio [1].
        other_kinds_keys_are_idle: keys of other kinds are ignored, so that a machine can be tried without its
            drives by changing ``kind`` alone. agreed: fields without a key.
        has_inertia: its position is not simply its setpoint.
        has_switches: its state includes the home switch.
        has_pins: its digital inputs and outputs can be the machine's (60FDh, 60FEh).
    """

    initial_position: float = 0.0
    bandwidth_hz: Positive = 40.0
    encoder_resolution: NotNegative = 0.0
    heartbeat_timeout_s: Positive = 0.1
    brake: bool = False
    friction_decel: NotNegative = 0.0
    inertia: NotNegative = 0.01
    max_torque: NotNegative = 0.0
    home_switch: tuple[float, float] | None = None
    index_at: float | None = None
    hard_stops: tuple[float, float] | None = None
    flexible_hz: NotNegative = 0.0
    flexible_damping: Damping = 0.05
    other_kinds_keys_are_idle: ClassVar[bool] = True
    agreed: ClassVar[frozenset[str]] = frozenset()
    has_inertia: ClassVar[bool] = True
    has_switches: ClassVar[bool] = True
    has_pins: ClassVar[bool] = False

    @property
    def kind(self) -> str:
        """Kind as in the machine file."""
        return str(self.__struct_config__.tag)

    @property
    def profiled(self) -> bool:
        """Whether it makes its own profiles: it moves to points, and follows no path."""
        return False

    @property
    def homes(self) -> bool:
        """Whether it can home itself."""
        return True

    @property
    def takes_torques(self) -> bool:
        """Whether it takes the torque of the motion besides its targets, or instead of them."""
        return False

    def has_mode(self, mode: int) -> bool:  # noqa: ARG002
        """Return whether the machine file has what a `mcserver.drives.bus.DriveMode` requires."""
        return True

    def complete(
        self,
        axis: AxisSection,
        cycle_s: float,  # noqa: ARG002
        bad: Refusal,  # noqa: ARG002
    ) -> tuple[Self, float | None]:
        """Derive values from other keys, and refuse contradictory ones.

        Returns:
            The drive, and the section's resulting ``units_per_motor_rev`` [mm, deg].
        """
        return self, axis.units_per_motor_rev

    def beside(self, folder: Path) -> Self:  # noqa: ARG002
        """Return the drive with file names relative to the machine file's folder resolved."""
        return self


class IdealDrive(Drive, frozen=True, tag="ideal"):
    """A drive whose actual position is its setpoint."""

    has_inertia: ClassVar[bool] = False


class CanDrive(Drive, frozen=True, tag="can"):
    """A drive on a CAN bus, or with CiA 402 on EtherCAT.

    Attributes:
        encoder: increments per motor revolutions (608Fh). gear: motor per shaft revolutions (6091h).
        feed: travel [mm, deg] per shaft revolutions (6092h). invert: the motor turns against the axis.
        velocity_counts_per_motor_rev: units of 60FFh and 606Ch per motor turn a second; 0: increments.
        rated_torque: 1000 ‰ of 6071h and 6077h, or 0 if torques are not used [N·m].
        command_timeout_ms: time without commands after which the drive acts by itself (1400h:5).
        synchronous: it acts at SYNC, and its node is monitored by heartbeats.
        borrowed_key: key of `borrowed_node`.
    """

    borrowed_key: ClassVar[str] = "pdo_node"
    other_kinds_keys_are_idle: ClassVar[bool] = False
    has_switches: ClassVar[bool] = False
    synchronous: ClassVar[bool] = False
    inertia: NotNegative = 0.0
    bus: str = ""
    node: Annotated[
        int, Meta(ge=LEAST_NODE, le=GREATEST_NODE, description="give the drive's node number")
    ] = 0
    counts_per_motor_rev: Annotated[int, Meta(ge=0)] = 0
    encoder: (
        Annotated[tuple[Count, Count], Meta(description='two whole numbers above 0; turn with "invert"')]
        | None
    ) = None
    gear: (
        Annotated[tuple[Count, Count], Meta(description='two whole numbers above 0; turn with "invert"')]
        | None
    ) = None
    feed: (
        Annotated[tuple[Positive, Positive], Meta(description='two numbers above 0; turn with "invert"')]
        | None
    ) = None
    invert: bool = False
    rated_torque: NotNegative = 0.0
    velocity_counts_per_motor_rev: NotNegative = 0.0
    command_timeout_ms: Milliseconds = 0

    @property
    def homes(self) -> bool:
        return False

    def misplaced(self, bus_kind: str) -> list[tuple[str, str, str]]:
        """Return keys that do not fit the kind of its bus, as key, what, hint."""
        if bus_kind == "can":
            return []
        return [("bus", f"a {self.kind} drive is on a CAN bus", 'kind = "cia402" is there on EtherCAT too')]

    @property
    def usual_timeout_ms(self) -> int:
        """Default time-out of commands [ms]."""
        return COMMAND_TIMEOUT_MS

    @property
    def place(self) -> tuple[int, int]:
        """Its node, and its axis on that node."""
        return self.node, 0

    @property
    def borrowed_node(self) -> int:
        """Node number besides its own whose COB-IDs it uses; 0: none."""
        return 0

    def answer_cycles(self, cycle_s: float) -> int:  # noqa: ARG002
        """Return the greatest number of cycles between two of its answers."""
        return 1

    @classmethod
    def shares(cls, axes: Sequence[Axis], cycle_hz: float) -> list[Share]:
        """Return the frames of these axes of its kind on their bus, without SYNC and server heartbeat."""
        raise NotImplementedError

    def complete(self, axis: AxisSection, cycle_s: float, bad: Refusal) -> tuple[Self, float | None]:
        if not self.bus:
            bad("bus", f"a {self.kind} drive needs a bus", 'give bus = "can0", or a [[bus]] name')
        if not self.node:
            bad("node", "is missing", "give the drive's node number")
        timeout = self.command_timeout_ms or max(
            self.usual_timeout_ms, math.ceil(COMMAND_TIMEOUT_CYCLES * cycle_s * 1e3 - 1e-9)
        )
        if timeout < 3.0 * cycle_s * 1e3:
            bad("command_timeout_ms", f"{timeout} is below three cycles", "10 cycles are usual")
        inertia = self.inertia or SIMULATED_INERTIA
        completed = msgspec.structs.replace(self, command_timeout_ms=timeout, inertia=inertia)
        travel = _travel(self, axis, bad)
        if travel is None:
            return completed, axis.units_per_motor_rev
        encoder, gear, feed, per_turn = travel
        return msgspec.structs.replace(completed, encoder=encoder, gear=gear, feed=feed), per_turn


def _travel(
    drive: CanDrive, axis: AxisSection, bad: Refusal
) -> tuple[tuple[int, int], tuple[int, int], tuple[float, float], float] | None:
    """Return encoder, gear, feed, and the travel per motor turn [mm, deg]; None after a mistake."""
    if drive.encoder is not None and drive.counts_per_motor_rev:
        bad("encoder", "contradicts counts_per_motor_rev, which is there too", "give one of them")
        return None
    if drive.encoder is None and not drive.counts_per_motor_rev:
        bad(
            "counts_per_motor_rev",
            "it is not said what a count of the drive is",
            "give counts_per_motor_rev, or encoder = [increments, motor revolutions] (608Fh)",
        )
        return None
    encoder = drive.encoder or (drive.counts_per_motor_rev, 1)
    gear = drive.gear or (1, 1)
    per_turn = axis.units_per_motor_rev
    feed = drive.feed
    if feed is None:
        if per_turn is not None:
            feed = (per_turn * gear[0] / gear[1], 1.0)
        elif axis.type == "rotary":
            feed = (360.0, 1.0)
        else:
            bad(
                "feed",
                "it is not said how far a turn of the motor goes",
                "give units_per_motor_rev of the axis, or feed = [mm, shaft revolutions] (6092h)",
            )
            return None
    by_feed = feed[0] / feed[1] * gear[1] / gear[0]
    if per_turn is not None and abs(per_turn - by_feed) > SAME * by_feed:
        bad(
            "feed",
            f"gear and feed say {by_feed:g} for a turn of the motor, units_per_motor_rev says {per_turn:g}",
            "leave one of them out",
        )
        return None
    return encoder, gear, feed, by_feed if per_turn is None else per_turn
