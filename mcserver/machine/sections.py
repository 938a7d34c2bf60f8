"""The tables of a machine file as written: mm, degrees and seconds; allowed values as msgspec's constraints.

The ``description`` of a constraint is the hint that a mistake shows.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import msgspec
from mckinematics.description import EARTH
from msgspec import Meta

from mcserver.can.cob import GREATEST_NODE, LEAST_NODE
from mcserver.machine.clearance_section import Body, ClearanceSection, Zone
from mcserver.machine.homing_section import HomingSection, ProbeSection
from mcserver.machine.io_section import InputSection, OutputSection
from mcserver.machine.recovery_section import RecoverySection

MAX_AXES = 64

Limit = Annotated[float, Meta(gt=0.0, description="leave the key out where there is no limit")]
Positive = Annotated[float, Meta(gt=0.0, description="give a number above 0")]
NotNegative = Annotated[float, Meta(ge=0.0, description="leave the key out if it is not known")]
Torque = Annotated[
    Annotated[float, Meta(gt=0.0)] | Literal["urdf"],
    Meta(description='give N·m above 0, or "urdf" for the effort of its joint; leave it out without a limit'),
]
Milliseconds = Annotated[int, Meta(ge=0, le=0xFFFF, description="100 is usual")]
Unsigned32 = Annotated[int, Meta(ge=0, le=0xFFFFFFFF, description="see 1018h of the drive")]
Count = Annotated[int, Meta(ge=1, le=0xFFFFFFFF)]
_LSS = "vendor, product code, revision and serial number of 1018h"
_TURN_BY_INVERT = Meta(description='give two numbers above 0; turn the motor with "invert"')
_ERROR_CODE = "(0x|0X)?[0-9A-Fa-fxX?*]{4}h?"
ErrorCode = Annotated[
    str, Meta(pattern=f"^{_ERROR_CODE}$", description="four hexadecimal digits, x for any: '8611', '81xx'")
]
MonitoredObject = Annotated[
    str,
    Meta(
        pattern=r"^[0-9A-Fa-f]{4}h?(:[0-9A-Fa-f]{1,2})?( .{1,40})?$",
        description="index, subindex and a name: '6079h:00 DC link voltage'",
    ),
]
AxisNumber = Annotated[int, Meta(ge=0, lt=MAX_AXES, description="number axes from 0 to 63")]


class DriveSection(msgspec.Struct, frozen=True, tag_field="kind", tag="simulated"):
    """``[axis.drive]`` of a simulated drive; what a drive on a bus has besides is for its simulation.

    Attributes:
        initial_position: [mm, deg]. bandwidth_hz: of the servo loop.
        encoder_resolution: [mm, deg], 0: continuous.
        heartbeat_timeout_s: without setpoints for so long the drive stops. brake: holds without power.
        friction_decel: [mm/s², deg/s²]. inertia: at the motor [kg·m²]. max_torque: 0: not limited [N·m].
        home_switch: from where to where the home switch is active, index_at: one place of the encoder's
            index, of which there is one a turn of the motor, hard_stops: ends of the mechanics; all by the
            encoder [mm, deg].
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
    # a machine is tried without its drives by changing `kind` alone
    other_kinds_keys_are_idle: ClassVar[bool] = True


class IdealDriveSection(DriveSection, frozen=True, tag="ideal"):
    """``[axis.drive]`` of a drive whose actual position is its setpoint."""


class CanDriveSection(DriveSection, frozen=True, tag="can"):
    """What the two kinds of drives on a CAN bus share; see `mcserver.machine.machine_file.Drive`."""

    other_kinds_keys_are_idle: ClassVar[bool] = False
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


class DriveHomingSection(msgspec.Struct, frozen=True):
    """``[axis.drive.homing]``: how the drive homes itself (CiA 402, mode 6).

    Attributes:
        method: 6098h. speed_switch, speed_zero: 6099h:01, :02 [mm/s, deg/s].
        acceleration: 609Ah [mm/s², deg/s²]. position: the axis is here at the home position [mm, deg].
        timeout_s: longer than this it has failed.
    """

    method: Annotated[int, Meta(ge=-128, le=127, description="6098h, as the drive's manual numbers them")]
    speed_switch: Positive = 10.0
    speed_zero: Positive = 2.0
    acceleration: Positive = 100.0
    position: float = 0.0
    timeout_s: Positive = 60.0


class Cia402DriveSection(CanDriveSection, frozen=True, tag="cia402"):
    """``[axis.drive]`` of a CiA 402 drive.

    Attributes:
        position_gain: [1/s]. integral_time_s: None: what is usual with the mode. velocity_gain: with mode =
            "cst", at the motor's shaft [N·m·s/rad]; 0: from `inertia`.
    """

    eds: str = ""
    mode: Literal["csp", "csv", "cst", "pp", "ip"] = "csp"
    position_gain: NotNegative = 0.0
    integral_time_s: NotNegative | None = None
    velocity_gain: NotNegative = 0.0
    velocity_feed_forward: Annotated[float, Meta(ge=0.0, le=1.0, description="1 is usual")] = 1.0
    torque_feed_forward: bool = False
    zero_offset: float = 0.0
    pdo: Literal["auto", "fixed"] = "auto"
    monitor: Annotated[list[MonitoredObject], Meta(max_length=8, description="8 objects at most")] = []
    node_axis: Annotated[int, Meta(ge=0, le=7, description="0 is the node's first axis")] = 0
    pdo_node: Annotated[int, Meta(ge=0, le=GREATEST_NODE, description="a number that no node has")] = 0
    stop_on: list[ErrorCode] = []
    warn_on: list[ErrorCode] = []
    sdo_timeout_ms: Annotated[int, Meta(ge=10, le=60_000, description="300 is usual")] = 300
    sdo_tries: Annotated[int, Meta(ge=1, le=10, description="3 is usual")] = 3
    sdo_store_timeout_s: Positive = 15.0
    lss: Annotated[tuple[Unsigned32, Unsigned32, Unsigned32, Unsigned32], Meta(description=_LSS)] | None = (
        None
    )
    homing: DriveHomingSection | None = None
    vendor_id: Unsigned32 = 0
    product_code: Unsigned32 = 0
    heartbeat_ms: Milliseconds = 100
    sdo_writes: list[list[int]] = []


class ServosilaDriveSection(CanDriveSection, frozen=True, tag="servosila"):
    """``[axis.drive]`` of a Servosila drive."""

    codes: dict[str, int] = {}
    pole_pairs: Annotated[int, Meta(ge=0, le=1000, description="see the motor's data")] = 0
    telemetry_hz: NotNegative = 0.0


class AxisSection(msgspec.Struct, frozen=True):
    """``[[axis]]``."""

    index: AxisNumber
    type: Literal["linear", "rotary"]
    max_velocity: Limit
    max_acceleration: Limit
    max_jerk: Limit | None = None
    min_position: float | None = None
    max_position: float | None = None
    in_position: Limit = 0.01
    max_following_error: Limit | None = None
    units_per_motor_rev: Limit | None = None
    max_torque: Torque | None = None
    drive: DriveSection | IdealDriveSection | Cia402DriveSection | ServosilaDriveSection = DriveSection()
    homing: HomingSection | None = None


class MachineSection(msgspec.Struct, frozen=True):
    """``[machine]``."""

    name: Annotated[
        str,
        Meta(
            pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,62}$",
            description="it is part of keys: use letters, digits, '-', '_', '.'",
        ),
    ]
    cycle_hz: Annotated[float, Meta(ge=10.0, le=10000.0, description="1000 is usual")] = 1000.0
    setpoint_timeout_s: Annotated[
        float, Meta(gt=0.0, le=10.0, description="what the drives bridge without a setpoint: 0.05 is usual")
    ] = 0.05


class MotionSection(msgspec.Struct, frozen=True):
    """``[motion]``."""

    path_tolerance_mm: Annotated[float, Meta(ge=0.0, description="0 keeps the exact path")] = 0.0
    exact_stop_timeout_s: Positive = 5.0
    exact_stop_cycles: Annotated[int, Meta(ge=1, description="3 is usual")] = 3
    tool_tolerance_mm: Positive = 0.01
    tool_tolerance_deg: Positive = 0.01
    joint_tolerance_deg: Annotated[float, Meta(ge=0.0, le=30.0, description="0: at the tool alone")] = 0.0
    joint_tolerance_mm: Annotated[float, Meta(ge=0.0, le=100.0, description="0: at the tool alone")] = 0.0


class KinematicsSection(msgspec.Struct, frozen=True):
    """``[kinematics]``.

    Attributes:
        gravity: in the URDF's base frame [m/s²].
    """

    urdf: str
    gravity: tuple[float, float, float] = EARTH


class PayloadSection(msgspec.Struct, frozen=True):
    """``payload`` of a tool: what it weighs, itself and what it holds.

    Attributes:
        mass: [kg]. center_mm: of mass, in the axes of the tool's frame. inertia: about the centre, ixx, iyy,
            izz, ixy, ixz, iyz [kg·m²]; a point mass without it.
    """

    mass: Annotated[float, Meta(ge=0.0, description="give kg, 0 for nothing")]
    center_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class ToolSection(msgspec.Struct, frozen=True):
    """``[[tool]]``: one end effector of the URDF.

    Attributes:
        posture: where its axes had best be, where a pose leaves a choice [mm, deg].
    """

    number: Annotated[int, Meta(ge=0, description="number each tool once, from 0")]
    frame: str
    axes: Annotated[list[int], Meta(min_length=1, description="list the chain's joints once each")]
    orientation: bool = False
    euler: Literal["ZYX", "XYZ", "XZY", "YXZ", "YZX", "ZXY"] = "ZYX"
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    payload: PayloadSection | None = None
    posture: list[float] | None = None


class BusSection(msgspec.Struct, frozen=True):
    """``[[bus]]``; without an address the name is one."""

    name: Annotated[str, Meta(min_length=1, description="name each bus once")]
    address: str = ""
    bitrate: Annotated[
        int, Meta(ge=10_000, le=1_000_000, description="1000000 is usual; classic CAN has no more")
    ] = 1_000_000
    silence_cycles: Annotated[int, Meta(ge=1, le=1000, description="3 is usual")] = 3
    sync: Literal["own", "foreign"] = "own"
    listen_ms: Annotated[int, Meta(ge=0, le=10_000, description="250 is usual")] = 250
    appear_timeout_s: Annotated[float, Meta(gt=0.0, le=600.0, description="10 is usual")] = 10.0


class DialectSection(msgspec.Struct, frozen=True):
    """``[dialect]``: a profile, and keys that each override a part of it."""

    profile: Literal["reference", "cnc", "printer", "robot"] = "reference"
    letters: dict[str, int] = {}
    capture: Literal["program", "auto"] | None = None
    ignore: list[str] = []
    spindle_axis: AxisNumber | None = None
    dwell: Literal["s", "ms"] | None = None
    tool_change: Literal["pause", "ask", "ignore"] = "pause"
    rapids: Literal["independent", "straight"] = "independent"
    outputs: dict[str, dict[str, bool | float | Literal["S"]]] = {}


class CutterSection(msgspec.Struct, frozen=True):
    """``[[cutter]]``: one line of the tool table, for G43."""

    number: Annotated[int, Meta(ge=0, le=99999, description="the number that T and H name")]
    length_mm: float
    diameter_mm: NotNegative = 0.0


class RecorderSection(msgspec.Struct, frozen=True):
    """``[recorder]``: the black box of the last minutes, and the folder of recordings."""

    enabled: bool = True
    minutes: Annotated[float, Meta(gt=0.0, le=120.0, description="5 is usual")] = 5.0
    max_mb: Annotated[int, Meta(ge=1, le=65_536, description="of memory; 256 is usual")] = 256
    after_s: Annotated[float, Meta(ge=0.0, le=60.0, description="2 is usual")] = 2.0
    folder: str = ""
    keep: Annotated[int, Meta(ge=1, le=1000, description="black boxes on the disk; 20 is usual")] = 20
    keep_mb: Annotated[int, Meta(ge=1, description="of black boxes on the disk; 2000 is usual")] = 2000
    min_free_mb: Annotated[int, Meta(ge=0, description="200 is usual")] = 200


class MachineFile(msgspec.Struct, frozen=True):
    """A whole machine file."""

    machine: MachineSection
    axis: list[AxisSection]
    motion: MotionSection = MotionSection()
    kinematics: KinematicsSection | None = None
    tool: list[ToolSection] = []
    bus: list[BusSection] = []
    dialect: DialectSection = DialectSection()
    cutter: list[CutterSection] = []
    input: list[InputSection] = []
    output: list[OutputSection] = []
    probe: ProbeSection | None = None
    recorder: RecorderSection = RecorderSection()
    recovery: RecoverySection | None = None
    clearance: ClearanceSection | None = None
    body: list[Body] = []
    zone: list[Zone] = []
