"""The table of codes: what each does and which words it takes."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from types import MappingProxyType

import msgspec

from mcserver.motion.canonical import AxisOperation


class Kind(enum.Enum):
    """A code's role in the grammar."""

    MOVE = "move"  # G00-G03: axis words or a tool's pose
    DIRECT = "direct"  # G1020, G1030, G1040: axis words, never a tool
    DWELL = "dwell"  # G04
    AXIS = "axis"  # G1000-G1011, G1060, G1061
    SETTING = "setting"  # acts where it stands, moves nothing
    PROGRAM = "program"  # M00, M01, M02, M30
    UNKNOWN = "unknown"  # replaces a refused code, so that its words raise no further faults


class CommandSpec(msgspec.Struct, frozen=True):
    """One code.

    Attributes:
        name: with two digits at least, such as ``G01``.
        title: what it does, in a few words.
        kind: its part in the grammar.
        words: letters that it takes besides axis words.
        takes_axes: True if axis words follow it.
        rules: rules of the dialect (docs/dialect.md), the code's own first.
        example: one line that is right on a machine with axes 0 to 3 and F in force.
        operation: for axis commands.
    """

    name: str
    title: str
    kind: Kind
    words: str = ""
    takes_axes: bool = False
    rules: tuple[str, ...] = ()
    example: str = ""
    operation: AxisOperation | None = None

    @property
    def letter(self) -> str:
        return self.name[0]

    @property
    def number(self) -> int:
        return int(self.name[1:])


UNKNOWN = CommandSpec("?", "unknown", Kind.UNKNOWN)

_MOVE = "FT"
_ARC = "FTIJKRP"
_ENDS_CAPTURE = ("D-40", "D-41")
COMMANDS: tuple[CommandSpec, ...] = (
    CommandSpec(
        "G00",
        "rapid move, every axis at its own limits",
        Kind.MOVE,
        _MOVE,
        True,
        ("D-20", "D-03"),
        "G00 X100 Y50",
    ),
    CommandSpec(
        "G01",
        "coordinated linear move",
        Kind.MOVE,
        _MOVE,
        True,
        ("D-21", "D-30", "D-31"),
        "G01 X100 Y50 F6000",
    ),
    CommandSpec(
        "G02",
        "clockwise arc, circle or helix",
        Kind.MOVE,
        _ARC,
        True,
        ("D-22", "D-23", "D-30"),
        "G02 X100 Y0 R60",
    ),
    CommandSpec(
        "G03",
        "counter-clockwise arc, circle or helix",
        Kind.MOVE,
        _ARC,
        True,
        ("D-22", "D-23", "D-30"),
        "G03 I50 J0 P2",
    ),
    CommandSpec("G04", "dwell for P seconds", Kind.DWELL, "P", False, ("D-24",), "G04 P0.5"),
    CommandSpec(
        "G09", "exact stop for the next motion command", Kind.SETTING, rules=("D-15",), example="G09 G01 X100"
    ),
    CommandSpec("G17", "arc plane XY", Kind.SETTING, rules=("D-05", "D-22"), example="G17 G02 X100 Y0 R60"),
    CommandSpec("G18", "arc plane ZX", Kind.SETTING, rules=("D-05", "D-22"), example="G18 G02 X100 Z0 R60"),
    CommandSpec("G19", "arc plane YZ", Kind.SETTING, rules=("D-05", "D-22"), example="G19 G02 Y100 Z0 R60"),
    CommandSpec("G20", "inches", Kind.SETTING, rules=("D-13",), example="G20 G01 X4"),
    CommandSpec("G21", "millimetres", Kind.SETTING, rules=("D-13",), example="G21 G01 X100"),
    CommandSpec("G61", "exact stop on", Kind.SETTING, rules=("D-15", "D-34"), example="G61"),
    CommandSpec(
        "G64",
        "exact stop off; P: path tolerance",
        Kind.SETTING,
        "P",
        rules=("D-35", "D-15", "D-36"),
        example="G64 P0.1",
    ),
    CommandSpec("G90", "absolute positions", Kind.SETTING, rules=("D-14",), example="G90 G01 X100"),
    CommandSpec("G91", "incremental positions", Kind.SETTING, rules=("D-14",), example="G91 G01 X10"),
    CommandSpec("G93", "F in moves per minute", Kind.SETTING, rules=("D-30", "D-12"), example="G93 F60"),
    CommandSpec(
        "G94",
        "F in mm, inches or degrees per minute",
        Kind.SETTING,
        rules=("D-30", "D-11", "D-12"),
        example="G94 F6000",
    ),
    CommandSpec("G1000", "reset drives", Kind.AXIS, "P", False, _ENDS_CAPTURE, "G1000", AxisOperation.RESET),
    CommandSpec(
        "G1001", "switch drives off", Kind.AXIS, "P", False, _ENDS_CAPTURE, "G1001", AxisOperation.OFF
    ),
    CommandSpec("G1002", "stop drives", Kind.AXIS, "P", False, _ENDS_CAPTURE, "G1002 P2", AxisOperation.STOP),
    CommandSpec(
        "G1010",
        "capture: energize and hold",
        Kind.AXIS,
        "P",
        False,
        ("D-40", "D-27"),
        "G1010",
        AxisOperation.CAPTURE,
    ),
    CommandSpec(
        "G1011",
        "release: stop transmitting",
        Kind.AXIS,
        "P",
        False,
        ("D-40",),
        "G1011 P0",
        AxisOperation.RELEASE,
    ),
    CommandSpec("G1020", "servo move, not waited for", Kind.DIRECT, "F", True, ("D-25",), "G1020 X100"),
    CommandSpec("G1030", "motor speed in RPM", Kind.DIRECT, "", True, ("D-26",), "G1030 [3]60"),
    CommandSpec("G1040", "torque in Nm", Kind.DIRECT, "", True, ("D-26",), "G1040 [3]1.5"),
    CommandSpec(
        "G1050",
        "no tool: axis words name axes again",
        Kind.SETTING,
        rules=("D-50", "D-52"),
        example="G1050 G01 X100",
    ),
    CommandSpec(
        "G1060",
        "couple an axis, or the tool in force, to the axis that it follows",
        Kind.AXIS,
        "P",
        False,
        ("D-130", "D-145"),
        "G1060 P3",
        AxisOperation.COUPLE,
    ),
    CommandSpec(
        "G1061",
        "uncouple axes: they follow no more",
        Kind.AXIS,
        "P",
        False,
        ("D-130",),
        "G1061",
        AxisOperation.UNCOUPLE,
    ),
    CommandSpec("M00", "pause until resumed", Kind.PROGRAM, rules=("D-05",), example="M00"),
    CommandSpec("M01", "pause until resumed", Kind.PROGRAM, rules=("D-05",), example="M01"),
    CommandSpec("M02", "end of program", Kind.PROGRAM, rules=("D-05", "D-10"), example="M02"),
    CommandSpec("M30", "end of program", Kind.PROGRAM, rules=("D-05", "D-10"), example="M30"),
)

# by letter and number text without leading zeros: endless digit strings are not converted
BY_TEXT: Mapping[tuple[str, str], CommandSpec] = MappingProxyType(
    {(spec.letter, str(spec.number)): spec for spec in COMMANDS}
)

_NO_OFFSETS = "there are no work offsets here; program the axes' own positions"
_ABSENT_FAMILIES: tuple[tuple[str, range, str], ...] = (
    ("G", range(10, 11), _NO_OFFSETS),
    ("G", range(28, 31), "no code finds or goes home here; mcctl home does, and a move goes to a position"),
    ("G", range(40, 50), "there is no tool compensation here; program the tool's own path"),
    ("G", range(53, 60), _NO_OFFSETS),
    ("G", range(80, 90), "there are no canned cycles here; write the moves out"),
    ("G", range(92, 93), _NO_OFFSETS),
    ("M", range(3, 6), "a spindle is an axis: use G1030"),
    ("M", range(6, 7), "T alone chooses the tool"),
)


def find_command(letter: str, text: str) -> CommandSpec | None:
    """Look up a code by letter and number as written: ``1``, ``01`` and ``001`` are one code."""
    return BY_TEXT.get((letter, text.lstrip("0") or "0"))


def nearest_command(letter: str, text: str) -> str:
    """Build the hint for an unknown code: what the dialect lacks, or the nearest known codes."""
    digits = text.lstrip("0") or "0"
    if "." in digits or not digits.isdigit():
        return "codes are whole numbers, such as G01"
    if len(digits) > 6:
        return "codes have at most four digits"
    number = int(digits)
    for family, numbers, hint in _ABSENT_FAMILIES:
        if letter == family and number in numbers:
            return hint
    written = f"{letter}{number:02d}"
    names = [spec.name for spec in COMMANDS if spec.letter == letter]
    near = sorted(names, key=lambda name: (_edit_distance(name, written), abs(int(name[1:]) - number)))
    return f"did you mean {near[0]} or {near[1]}?"


def _edit_distance(first: str, second: str) -> int:
    """Return the Levenshtein distance of two texts."""
    row = list(range(len(second) + 1))
    for i, a in enumerate(first, start=1):
        diagonal, row[0] = row[0], i
        for j, b in enumerate(second, start=1):
            diagonal, row[j] = row[j], min(row[j] + 1, row[j - 1] + 1, diagonal + (a != b))
    return row[-1]
