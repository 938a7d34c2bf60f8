"""The channels of a recording and their schemas.

What comes every cycle is Protobuf, since it is small and quick and every reader of MCAP knows it; what comes
now and then is JSON, since people read it.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence

import msgspec
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    EnumDescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from mcap.records import Channel, Schema

from mcserver.executor.shm.feedback import AxisCondition, SlotState
from mcserver.executor.shm.mailbox import SLOTS
from mcserver.machine.machine_file import Machine
from mcserver.recorder.fixed_records import Field, Kind
from mcserver.service.reports import Event

CYCLES_TOPIC, EVENTS_TOPIC, LINES_TOPIC = "/cycles", "/events", "/lines"
PROGRAM_TOPIC, NOTES_TOPIC, TOOLS_TOPIC = "/program", "/recorder", "/tools"
CYCLES, EVENTS, LINES, PROGRAM, NOTES, FIRST_TOOL = 1, 2, 3, 4, 5, 6


class LineMark(msgspec.Struct, frozen=True, omit_defaults=True):
    """``/lines``: a line of a program that has ended; times are executor times [s]."""

    program: str
    line: int
    start_s: float
    end_s: float
    requested_s: float | None = None
    stretched_by: float | None = None
    bound_by: str | None = None


class ProgramPart(msgspec.Struct, frozen=True):
    """``/program``: lines ``first``, ``first + 1``, … of a program's text."""

    program: str
    name: str
    first: int
    lines: list[str]


class Note(msgspec.Struct, frozen=True):
    """``/recorder``: what the recorder has to say about itself.

    Attributes:
        kind: ``gap``: cycles that it missed; ``trigger``: why a black box was written;
            ``events_lost``: events that found no room on the way to it.
        count: cycles, events. text: a code or words.
    """

    kind: str
    t: float
    count: int = 0
    text: str = ""


class CycleField(enum.Enum):
    """Fields of ``mcserver.Cycle`` with their numbers; what they hold is in docs/recordings.md."""

    CYCLE = 1
    TIME = 2
    LINE = 3
    LATE_CYCLES = 4
    ESTOP = 5
    SETPOINT = 6
    POSITION = 7
    VELOCITY = 8
    TORQUE = 9
    FOLLOWING_ERROR = 10
    COMMANDED_VELOCITY = 11
    CONDITION = 12
    RATE = 13
    PROGRAM_STATE = 14
    INPUT = 15
    OUTPUT = 16
    INTERLOCK = 17


def cycle_fields_of(machine: Machine) -> list[Field]:
    """Fields of a cycle's message of this machine."""
    return cycle_fields(len(machine.axes), SLOTS, len(machine.inputs), len(machine.outputs))


def cycle_fields(axes: int, slots: int, inputs: int = 1, outputs: int = 1) -> list[Field]:
    """Fields of a cycle's message; positions are doubles, what is looked at by eye floats."""
    shapes: dict[CycleField, tuple[Kind, int | None]] = {
        CycleField.CYCLE: (Kind.UINT64, None),
        CycleField.TIME: (Kind.DOUBLE, None),
        CycleField.LINE: (Kind.UINT32, None),
        CycleField.LATE_CYCLES: (Kind.UINT32, None),
        CycleField.ESTOP: (Kind.SMALL, None),
        CycleField.SETPOINT: (Kind.DOUBLE, axes),
        CycleField.POSITION: (Kind.DOUBLE, axes),
        CycleField.VELOCITY: (Kind.FLOAT, axes),
        CycleField.TORQUE: (Kind.FLOAT, axes),
        CycleField.FOLLOWING_ERROR: (Kind.FLOAT, axes),
        CycleField.COMMANDED_VELOCITY: (Kind.FLOAT, axes),
        CycleField.CONDITION: (Kind.SMALL, axes),
        CycleField.RATE: (Kind.FLOAT, slots),
        CycleField.PROGRAM_STATE: (Kind.SMALL, slots),
        CycleField.INPUT: (Kind.FLOAT, inputs),
        CycleField.OUTPUT: (Kind.FLOAT, outputs),
        CycleField.INTERLOCK: (Kind.SMALL, None),
    }
    return [Field(field.name.lower(), field.value, kind, count) for field, (kind, count) in shapes.items()]


def pose_fields() -> list[Field]:
    """Fields of ``mcserver.ToolPose``: a tool's frame in the machine's, X Y Z [mm], A B C [deg]."""
    return [Field("time", 1, Kind.DOUBLE)] + [
        Field(letter, number, Kind.DOUBLE) for number, letter in enumerate("xyzabc", start=2)
    ]


def channels(machine: Machine) -> tuple[list[Schema], list[Channel]]:
    """Schemas and channels of a recording of this machine."""
    cycle = _protobuf_schema()
    json: list[tuple[str, type[msgspec.Struct], int, str]] = [
        ("mcserver.Event", Event, EVENTS, EVENTS_TOPIC),
        ("mcserver.LineMark", LineMark, LINES, LINES_TOPIC),
        ("mcserver.ProgramPart", ProgramPart, PROGRAM, PROGRAM_TOPIC),
        ("mcserver.Note", Note, NOTES, NOTES_TOPIC),
    ]
    schemas = [Schema(1, cycle, "protobuf", "mcserver.Cycle")]
    names = {"axes": ",".join(str(axis.index) for axis in machine.axes)}
    names["units"] = ",".join(axis.type.unit for axis in machine.axes)
    names["inputs"] = ",".join(each.name for each in machine.inputs)
    names["outputs"] = ",".join(each.name for each in machine.outputs)
    found = [Channel(CYCLES, CYCLES_TOPIC, "protobuf", names, 1)]
    for number, (name, message, channel, topic) in enumerate(json, start=2):
        schemas.append(Schema(number, _json_schema(message), "jsonschema", name))
        found.append(Channel(channel, topic, "json", {}, number))
    if machine.tools:
        last = len(schemas) + 1
        schemas.append(Schema(last, cycle, "protobuf", "mcserver.ToolPose"))
        for at, tool in enumerate(sorted(machine.tools, key=lambda each: each.number)):
            found.append(
                Channel(
                    FIRST_TOOL + at, f"{TOOLS_TOPIC}/{tool.number}", "protobuf", {"units": "mm,deg"}, last
                )
            )
    return schemas, found


def _json_schema(message: type[msgspec.Struct]) -> bytes:
    """Return a schema whose root is an object: readers do not follow a reference there."""
    (_,), definitions = msgspec.json.schema_components([message], ref_template="#/$defs/{name}")
    root = definitions.pop(message.__name__)
    return msgspec.json.encode({**root, **({"$defs": definitions} if definitions else {})})


def _protobuf_schema() -> bytes:
    condition = _enumeration("AxisCondition", AxisCondition)
    state = _enumeration("ProgramState", SlotState)
    cycle = message_descriptor("Cycle", cycle_fields(axes=1, slots=1))
    for field, kind in (
        ("condition", condition),
        ("program_state", state),
        ("estop", None),
        ("interlock", None),
    ):
        (described,) = (each for each in cycle.field if each.name == field)
        if kind is None:
            described.type = FieldDescriptorProto.TYPE_BOOL
        else:
            described.type = FieldDescriptorProto.TYPE_ENUM
            described.type_name = f".mcserver.{kind.name}"
    file = FileDescriptorProto(
        name="mcserver/recording.proto",
        package="mcserver",
        syntax="proto3",
        enum_type=[condition, state],
        message_type=[cycle, message_descriptor("ToolPose", pose_fields())],
    )
    described_set: bytes = FileDescriptorSet(file=[file]).SerializeToString()
    return described_set


def message_descriptor(name: str, fields: Sequence[Field]) -> DescriptorProto:
    """Describe a message of these fields for a file's schema."""
    types = {
        Kind.UINT64: FieldDescriptorProto.TYPE_FIXED64,
        Kind.DOUBLE: FieldDescriptorProto.TYPE_DOUBLE,
        Kind.UINT32: FieldDescriptorProto.TYPE_FIXED32,
        Kind.FLOAT: FieldDescriptorProto.TYPE_FLOAT,
        Kind.SMALL: FieldDescriptorProto.TYPE_UINT32,
    }
    message = DescriptorProto(name=name)
    for field in fields:
        message.field.add(
            name=field.name,
            number=field.number,
            type=types[field.kind],
            label=FieldDescriptorProto.LABEL_OPTIONAL
            if field.count is None
            else FieldDescriptorProto.LABEL_REPEATED,
        )
    return message


def _enumeration(name: str, values: type[enum.IntEnum]) -> EnumDescriptorProto:
    described = EnumDescriptorProto(name=name)
    prefix = "AXIS" if values is AxisCondition else "PROGRAM"
    for value in values:
        # names of an enumeration's values share the package's name space
        described.value.add(name=f"{prefix}_{value.name}", number=int(value))
    return described
