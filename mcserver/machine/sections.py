"""Tables of a machine file as written: mm, degrees and seconds; allowed values are msgspec constraints.

The ``description`` of a constraint is the hint of a mistake.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from mckinematics.description import EARTH
from msgspec import Meta

from mcserver.machine.advance_section import PressureAdvanceSection
from mcserver.machine.button_section import Button
from mcserver.machine.clearance_section import Body, ClearanceSection, Zone
from mcserver.machine.compensation_section import CompensationSection
from mcserver.machine.constraints import Limit, NotNegative, Positive
from mcserver.machine.drive import Drive
from mcserver.machine.families import AnyDrive
from mcserver.machine.follow_section import FollowSection, ToolFollowSection
from mcserver.machine.gantry_section import GantrySection
from mcserver.machine.homing_section import HomingSection, ProbeSection
from mcserver.machine.io_section import InputSection, OutputSection
from mcserver.machine.recovery_section import RecoverySection
from mcserver.machine.shaper_section import Shaper

MAX_AXES = 64

Torque = Annotated[
    Annotated[float, Meta(gt=0.0)] | Literal["urdf"],
    Meta(description='give N·m above 0, or "urdf" for the effort of its joint; leave it out without a limit'),
]
Rollover = Literal["shortest", "sign"]
AxisNumber = Annotated[int, Meta(ge=0, lt=MAX_AXES, description="number axes from 0 to 63")]

ToolShapers = Annotated[
    dict[Annotated[str, Meta(pattern=r"^[1-9][0-9]{0,4}$")], Shaper],
    Meta(description='by numbers of tools, such as tool_shapers.3 = { type = "ei", frequency_hz = 40.0 }'),
]


class AxisSection(msgspec.Struct, frozen=True):
    """``[[axis]]``."""

    index: AxisNumber
    type: Literal["linear", "rotary"]
    max_velocity: Positive
    max_acceleration: Positive
    max_jerk: Limit | None = None
    min_position: float | None = None
    max_position: float | None = None
    in_position: Positive = 0.01
    max_following_error: Limit | None = None
    units_per_motor_rev: Positive | None = None
    max_torque: Torque | None = None
    drive: AnyDrive = Drive()
    homing: HomingSection | None = None
    shaper: Shaper | None = None
    tool_shapers: ToolShapers = {}
    compensation: CompensationSection | None = None
    gantry: GantrySection | None = None
    follow: FollowSection | None = None
    rollover: Rollover | None = None
    pressure_advance: PressureAdvanceSection | None = None


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
    group: Annotated[str, Meta(max_length=64, description="where it stands, such as hall-2")] = ""
    tags: Annotated[
        tuple[Annotated[str, Meta(pattern=r"^[^\s,;]{1,32}$", description="words without spaces")], ...],
        Meta(max_length=16, description="16 words at the most"),
    ] = ()
    camera: Annotated[
        str,
        Meta(
            pattern=r"^(https?://[^\s/@?#]+(/\S*)?)?$",
            max_length=500,
            description="the address of a picture or of MJPEG, http or https, without a name or password",
        ),
    ] = ""
    orders_from: Annotated[
        tuple[Literal["opcua"], ...], Meta(max_length=1, description='instruments that may order: ["opcua"]')
    ] = ()


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
    """``payload`` of a tool: mass of the tool and of what it holds.

    Attributes:
        mass: [kg]. center_mm: of mass, in the axes of the tool's frame. inertia: about that centre, ixx, iyy,
            izz, ixy, ixz, iyz [kg·m²]; by default of a point mass.
    """

    mass: Annotated[float, Meta(ge=0.0, description="give kg, 0 for nothing")]
    center_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class ToolSection(msgspec.Struct, frozen=True):
    """``[[tool]]``: one end effector of the URDF.

    Attributes:
        posture: preferred positions of its axes, if a pose has several solutions [mm, deg].
        work: frame of its poses, such as a rotary table; the chain goes from it to ``frame``.
        follow: the axis that its tip can follow, such as a conveyor.
    """

    number: Annotated[int, Meta(ge=0, description="number each tool once, from 0")]
    frame: str
    axes: Annotated[list[int], Meta(min_length=1, description="list the chain's joints once each")]
    orientation: bool = False
    euler: Literal["ZYX", "XYZ", "XZY", "YXZ", "YZX", "ZXY"] = "ZYX"
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    payload: PayloadSection | None = None
    posture: list[float] | None = None
    work: str | None = None
    follow: ToolFollowSection | None = None


class BusSection(msgspec.Struct, frozen=True):
    """``[[bus]]``; its name is the address or interface by default."""

    name: Annotated[str, Meta(min_length=1, description="name each bus once")]
    kind: Literal["can", "ethercat"] = "can"
    address: str = ""
    interface: Annotated[str, Meta(max_length=15, description='as `ip link` shows it: "eth1"')] = ""
    redundant_interface: Annotated[str, Meta(max_length=15, description="where a ring of slaves ends")] = ""
    distributed_clocks: bool = True
    bitrate: Annotated[
        int, Meta(ge=10_000, le=1_000_000, description="1000000 is usual; classic CAN has no more")
    ] = 1_000_000
    silence_cycles: Annotated[int, Meta(ge=1, le=1000, description="3 is usual")] = 3
    sync: Literal["own", "foreign"] = "own"
    listen_ms: Annotated[int, Meta(ge=0, le=10_000, description="250 is usual")] = 250
    appear_timeout_s: Annotated[float, Meta(gt=0.0, le=600.0, description="10 is usual")] = 10.0


class CodeWaitSection(msgspec.Struct, frozen=True):
    """``[dialect.waits]``: the digital input that has to be on before the program continues after a code."""

    input: str
    for_s: Annotated[float, Meta(gt=0.0, le=86_400.0, description="the longest, then it is a fault")]
    settle_s: Annotated[float, Meta(ge=0.0, le=60.0, description="before the input is looked at")] = 0.5


class RetractionSection(msgspec.Struct, frozen=True):
    """``[dialect.retraction]``: retraction by G10 and G11 of a printer [mm, mm/s]."""

    length_mm: Annotated[float, Meta(ge=0.0, le=1000.0, description="0.5 to 6 is usual")]
    speed: Annotated[float, Meta(gt=0.0, description="25 to 60 mm/s is usual")]
    hop_mm: Annotated[float, Meta(ge=0.0, le=1000.0, description="0.2 is usual")] = 0.0
    recover_speed: Annotated[float, Meta(gt=0.0, description="of G11 [mm/s]")] | None = None
    extra_mm: Annotated[float, Meta(ge=-100.0, le=100.0, description="0 is usual")] = 0.0


class DialectSection(msgspec.Struct, frozen=True):
    """``[dialect]``: a profile, and overrides of its parts."""

    profile: Literal["reference", "cnc", "printer", "robot"] = "reference"
    letters: dict[str, int] = {}
    capture: Literal["program", "auto"] | None = None
    ignore: list[str] = []
    spindle_axis: AxisNumber | None = None
    thread_tolerance_mm: Annotated[float, Meta(gt=0.0, le=10.0, description="0.05 is usual")] = 0.05
    dwell: Literal["s", "ms"] | None = None
    tool_change: Literal["pause", "ask", "ignore"] = "pause"
    rapids: Literal["independent", "straight"] = "independent"
    macros: Literal["linuxcnc", "fanuc"] = "linuxcnc"
    subroutines: str = ""
    persistent: list[tuple[int, int]] = []
    outputs: dict[str, dict[str, bool | float | Literal["S"]]] = {}
    waits: dict[str, CodeWaitSection] = {}
    retraction: RetractionSection | None = None


class CutterSection(msgspec.Struct, frozen=True):
    """``[[cutter]]``: one line of the tool table, for G43."""

    number: Annotated[int, Meta(ge=0, le=99999, description="the number that T and H name")]
    length_mm: float
    diameter_mm: NotNegative = 0.0


class RecorderSection(msgspec.Struct, frozen=True):
    """``[recorder]``: the black box of the last minutes, and the folder for recordings."""

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
    button: list[Button] = []
