"""The payload of ``info``, as `mcserver.net.messages`: what a machine and its service are."""

from __future__ import annotations

from typing import Literal

import msgspec

AxisKind = Literal["linear", "rotary"]
AxisUnit = Literal["mm", "deg"]
ChannelKind = Literal["digital", "analog"]


class AxisInfo(msgspec.Struct, frozen=True, omit_defaults=True):
    """One axis; limits in mm or deg and seconds, None where not limited.

    ``homing``: how it finds its reference; None: its encoder's reading is its position. ``letter``: an
    additional letter by which programs of the machine's profile name it, such as ``E``; empty: none.
    ``spindle``: M3, M4, M5 and S turn it.
    """

    index: int
    type: AxisKind
    unit: AxisUnit
    max_velocity: float
    max_acceleration: float
    drive: str
    max_jerk: float | None = None
    min_position: float | None = None
    max_position: float | None = None
    in_position: float = 0.0
    homing: str | None = None
    letter: str = ""
    spindle: bool = False


class ToolInfo(msgspec.Struct, frozen=True):
    """One tool of G01 … Tn.

    Attributes:
        work: the frame of its poses; empty: the base.
    """

    number: int
    frame: str
    axes: list[int]
    orientation: bool
    euler: str
    work: str = ""


class InputInfo(msgspec.Struct, frozen=True, omit_defaults=True):
    """One input.

    Attributes:
        number: within its kind, as M66 names it. source: of a real input; empty: it is simulated.
        hold, stop: it can hold the programs, or stop the machine.
    """

    name: str
    number: int
    kind: ChannelKind
    unit: str = ""
    source: str = ""
    hold: bool = False
    stop: bool = False


class OutputInfo(msgspec.Struct, frozen=True, omit_defaults=True):
    """One output.

    Attributes:
        number: within its kind, as M62 to M68 name it. target: of a real output; empty: it is simulated.
        min, max: least and greatest value. safe: its value once its setter is lost; None: it stays.
    """

    name: str
    number: int
    kind: ChannelKind
    unit: str = ""
    target: str = ""
    min: float = 0.0
    max: float = 1.0
    safe: float | None = None


class ArgumentInfo(msgspec.Struct, frozen=True):
    """A number that a button asks for, in the units of its text; ``first`` is shown first."""

    name: str
    low: float
    high: float
    first: float
    unit: str


class ButtonInfo(msgspec.Struct, frozen=True):
    """A program of the machine file, or a probing cycle, that people start from a page.

    Attributes:
        text: lines of G-code; ``{name}`` is the place of an argument.
        role: the lowest role that may press it, ``operator`` or ``engineer``.
        confirm: what must be confirmed before it runs; empty: nothing.
        group: the heading under which pages show it.
    """

    name: str
    text: str
    role: str
    confirm: str
    arguments: list[ArgumentInfo]
    group: str


class TelemetryInfo(msgspec.Struct, frozen=True):
    """How to read ``tele/batch``: its columns, its fields and the maximum of cycles in a message."""

    axes: list[int]
    fields: list[str]
    cycles_a_message: int
    state_hz: float


class LimitsInfo(msgspec.Struct, frozen=True):
    """Bounds of the service."""

    max_line_length: int
    max_lines_a_message: int
    queue_lines: int
    programs_at_once: int
    open_programs: int
    remembered_answers: int
    remembered_answer_s: float


class Info(msgspec.Struct, frozen=True):
    """Reply of ``info``.

    Attributes:
        protocol: versions of this key space that the server speaks.
        instance: one start of the server; a different one means that earlier programs were interrupted.
        epoch: Unix time of executor time 0, by the clock as it goes now [s].
        buttons: programs of the machine file that operators start, with places for numbers.
        group, tags: by which people find the machine.
        camera: address of a still picture or of MJPEG; empty: none.
        orders_from: instruments that may command, such as ``opcua``; others only show the machine.
    """

    machine: str
    server: str
    protocol: list[int]
    instance: str
    epoch: float
    cycle_s: float
    axes: list[AxisInfo]
    tools: list[ToolInfo]
    telemetry: TelemetryInfo
    limits: LimitsInfo
    methods: list[str]
    inputs: list[InputInfo] = []
    outputs: list[OutputInfo] = []
    buttons: list[ButtonInfo] = []
    group: str = ""
    tags: list[str] = []
    camera: str = ""
    orders_from: list[str] = []
