"""Codes that profiles add: which ones act, have no effect, or are refused (D-60)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from mcserver.machine.dialect_section import Dialect
from mcserver.machine.work_systems import WORK_SYSTEMS

# settings that the reference's grammar reads, in RS-274's order of execution
SETTINGS: Final = frozenset(
    {"G9", "G17", "G18", "G19", "G20", "G21", "G61", "G64", "G90", "G91", "G93", "G94"}
)
MOTIONS: Final = frozenset({"G0", "G1", "G2", "G3"})
PROGRAM: Final = frozenset({"M0", "M1", "M2", "M30", "M60"})

_FRAME = {
    "G10",
    "G28",
    "G28.1",
    "G30",
    "G30.1",
    "G52",
    "G53",
    "G92",
    "G92.1",
    "G92.2",
    "G92.3",
    *WORK_SYSTEMS,
}
# cutter compensation, by side: 1 is left of the path (D-85)
COMPENSATING: Final[Mapping[str, int]] = MappingProxyType({"G41": 1, "G41.1": 1, "G42": -1, "G42.1": -1})
# tool tip control, by rotary axes as written or by the tool's direction (D-86, D-140)
TIP_CONTROL: Final = frozenset({"G43.4", "G43.5"})
TOOL_LENGTHS: Final = frozenset({"G43", "G43.1", "G49"}) | TIP_CONTROL
_MACHINING = {"G4", *TOOL_LENGTHS, "M3", "M4", "M5", "M6", "M61"}
# canned cycles, and codes that go with them (D-75)
TAPPING: Final = frozenset({"G74", "G84"})
# rigid taps of Fanuc's older mills, right and left: the codes that they stand for, as every tap here is rigid
RIGID_TAPS: Final[Mapping[str, float]] = MappingProxyType({"G84.2": 84.0, "G84.3": 74.0})
DRILLING: Final = frozenset({"G73", "G81", "G82", "G83", "G85", "G86", "G89"}) | TAPPING
PECKING: Final = frozenset({"G73", "G83"})
# words of a cycle, besides R, L, F and axis words, that have to be above 0
CYCLE_WORDS: Final[Mapping[str, str]] = MappingProxyType(
    {
        **dict.fromkeys(PECKING, "PQIJK"),
        **dict.fromkeys(("G81", "G85"), "K"),
        **dict.fromkeys(("G82", "G86", "G89"), "PK"),
        **dict.fromkeys(TAPPING, "PQK"),
    }
)
# motion synchronous to the spindle (D-89, D-90)
THREADING: Final = frozenset({"G33", "G33.1", "G76"})
# rotation, scaling, mirrors and polar coordinates (D-94 to D-96)
TRANSFORMING: Final = frozenset({"G15", "G16", "G50", "G50.1", "G51", "G51.1", "G68", "G69"})
# a tilted plane, and turning the tool towards it (D-111)
TILTING: Final = frozenset({"G68.2", "G53.1"})
# curves by control points (D-97)
SPLINES: Final = frozenset({"G5", "G5.1", "G5.2", "G5.3"})
# X as diameter and as radius (D-137)
DIAMETERS: Final = frozenset({"G7", "G8"})
# firmware retraction of printers, by code: the action, since G10 sets tables in cnc (D-115)
RETRACTING: Final[Mapping[str, str]] = MappingProxyType(
    {"G10": "RETRACT", "G11": "RECOVER", "M207": "M207", "M208": "M208"}
)
# factors of F and of E; like retractions they take all words of their line (D-141)
FACTORS: Final = frozenset({"M220", "M221"})
# pressure advance of Marlin, RepRapFirmware and Klipper (D-143)
KLIPPER_ADVANCE: Final = "SET_PRESSURE_ADVANCE"
ADVANCE: Final = frozenset({"M900", "M572", KLIPPER_ADVANCE})
# a printer's bed mesh in Marlin's codes; Klipper's macros are translated to them (D-144)
BED_MESH: Final = frozenset({"G29", "M420"})
_CYCLE_MODES: Final = frozenset({"G80", "G98", "G99"})

# codes of printers that stop until somebody resumes, with the message for the operator; "": the program ends
PRINTER_STOPS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "M25": "the program pauses itself (M25)",
        "M112": "",
        "M125": "the program pauses itself (M125); the head is not parked",
        "M226": "the program waits for you (M226)",
        "M524": "",
        "M600": "change the filament, then resume",
        "M601": "the program pauses itself (M601)",
    }
)
# of printers: would shift the parts
_SHIFTS_OF_PRINTERS: Final = ("M206", "M218", "M290", "M428")
# of printers: run another file, which may move, such as M98 P"home.g" in RepRapFirmware
FILES_OF_PRINTERS: Final = ("M32", "M98")
# of printers: E in mm³ of a filament of diameter D; no effect with D0 or S0, or without words
VOLUMETRIC: Final = "M200"

# codes that act, by profile
ACTING: Final[Mapping[str, frozenset[str]]] = MappingProxyType(
    {
        "reference": frozenset(_MACHINING - TOOL_LENGTHS - {"M6", "M61"}),
        "cnc": frozenset(
            _FRAME
            | _MACHINING
            | DRILLING
            | THREADING
            | _CYCLE_MODES
            | {"M19"}
            | COMPENSATING.keys()
            | TRANSFORMING
            | TILTING
            | SPLINES
            | {"G40", "G90.1", "G91.1", "G95", "G96", "G97", *DIAMETERS}
        ),
        "robot": frozenset(_FRAME | {"G4", "M3", "M4", "M5"}),
        "printer": frozenset({"G4", "G28", "G92", "M82", "M83", *PRINTER_STOPS, *RETRACTING, *FACTORS}),
    }
)


def settings_of(profile: str) -> frozenset[str]:
    """Return the settings of a profile: Marlin's G61 returns to where G60 was (its exact stop is G61.1)."""
    return SETTINGS - {"G61"} if profile == "printer" else SETTINGS


def acting_of(dialect: Dialect) -> frozenset[str]:
    """Return the codes of a profile that act on a machine, besides those that its file maps."""
    acting = ACTING[dialect.profile]
    if dialect.fanuc:
        # G7 is another code on Fanuc's controllers
        return acting - DIAMETERS
    if dialect.profile == "printer" and dialect.extruder is None:
        acting = acting - RETRACTING.keys() - {"M221"}
    if dialect.leads:
        acting = acting | (ADVANCE - {KLIPPER_ADVANCE})
    return acting if dialect.mesh_axis is None else acting | BED_MESH


# act in every profile if the machine has a probe
PROBING: Final = frozenset({f"G38.{n}" for n in range(2, 6)})
# codes that take the axis words of their line
TAKES_AXES: Final = (
    frozenset({"G10", "G28", "G28.1", "G30", "G30.1", "G43.1", "G52", "G92", "REPEAT"})
    | {"G50.1", "G51", "G51.1", "G68"}
    | PROBING
    | DRILLING
    | THREADING
    | SPLINES
    | TILTING
)

# actions that move axes
MOVING: Final = (
    frozenset({"G28", "G29", "G30", "G53.1", "M19", "REPEAT", "RETRACT", "RECOVER"})
    | PROBING
    | DRILLING
    | THREADING
    | SPLINES
)

_NO_COMPENSATION = {"G40", "G40.1", "G50", "G69"}
# analog outputs: without effect on a machine without any
SET_OUTPUTS: Final = frozenset({"M67", "M68"})
# refused codes that only lathe programs have
LATHE: Final = frozenset({"G7", "G50", "G70", "G71", "G72", "G96"})
# a smaller feed under G99 is one per revolution, in a program for a lathe [mm/min]
LEAST_FEED_UNDER_G99: Final = 5.0
# a larger feed under G95 was meant per minute [mm]
LARGEST_FEED_PER_TURN: Final = 50.0
IGNORED: Final[Mapping[str, frozenset[str]]] = MappingProxyType(
    {
        "reference": frozenset(),
        "cnc": frozenset(
            (_NO_COMPENSATION - TRANSFORMING)
            | {"G8", "G67", "G103", "G187"}
            | {f"M{n}" for n in (7, 8, 9, 10, 11, 17, 18, 29, 41, 42, 43, 44, 48, 49, 50, 51, 52, 53, 84)}
            # Haas's conveyor of chips, and coolant through the spindle
            | {"M31", "M33", "M88", "M89"}
        ),
        "robot": frozenset(
            _NO_COMPENSATION | {"G80", "G43", "G49", "M6", "M7", "M8", "M9", "M10", "M11", "M48", "M49"}
        ),
        "printer": frozenset(
            {"G29", "G80", "G31", "G32", "G34", "G280", "G392"}
            | {
                f"M{n}"
                for n in (*range(3, 30), *range(31, 60), *range(61, 82), *range(84, 1000))
                if f"M{n}" not in {*PRINTER_STOPS, *_SHIFTS_OF_PRINTERS, *FILES_OF_PRINTERS, VOLUMETRIC}
            }
        ),
    }
)
SPINDLE: Final = frozenset({"M3", "M4", "M5"})
# whether S is a surface speed or turns (D-120)
SPINDLE_SPEEDS: Final = frozenset({"G96", "G97"})
# letters of the words that M62 to M68 take
IO_WORDS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "M62": "P",
        "M63": "P",
        "M64": "P",
        "M65": "P",
        "M66": "PELQ",
        "M67": "EQ",
        "M68": "EQ",
    }
)
# Letters of the words that a code takes besides S, T and axis words; "*": any. A word that no code of the
# line takes is a fault: without it the line might do something else.
OWN_WORDS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "G4": "P",
        "G10": "LP",
        "G43": "H",
        **dict.fromkeys(TIP_CONTROL, "H"),
        "G49": "H",
        "G64": "Q",
        **dict.fromkeys((*COMPENSATING, "G40"), "D"),
        "M6": "H",
        "M61": "Q",
        **dict.fromkeys(PRINTER_STOPS, "*"),
        "REPEAT": "PQL",
        **dict.fromkeys(DRILLING, "PQL"),
        "G51": "P",
        "G68.2": "PQ",
        "G5": "PQ",
        "G5.2": "PL",
        "G76": "PQHEL",
        "G96": "D",
        "M19": "P",
        **IO_WORDS,
    }
)
# of printers: flags and the extruder's position
PRINTER_WORDS: Final[Mapping[str, str]] = MappingProxyType({"G28": "*", "G92": "E"})
# codes for what is always in force here: no notice that they have no effect
SILENT: Final = frozenset({"G91.1", "G97"})

_MACRO_B = (
    'Fanuc\'s subprograms are an option; set [dialect] profile = "cnc", macros = "fanuc" in the machine file'
)
REFUSED: Final[Mapping[str, str]] = MappingProxyType(
    {
        **dict.fromkeys(SPLINES, "splines are read in the profile cnc; let the post write arcs and lines"),
        "G7": "diameters are halved in the profile cnc, by LinuxCNC's G7; let the post write radii",
        **dict.fromkeys(
            ("G10", "G11"),
            "retractions are for the profile printer with an axis E; let the slicer write them as moves of E",
        ),
        "G16": "polar coordinates are read in the profile cnc; let the post write X and Y",
        "G31": "a probe's move is G38.2 to G38.5 here; let the post write G38.2, or G38.3 if it may miss",
        "G33.1": "holes are tapped in the profile cnc; let the CAM mill the thread",
        **dict.fromkeys(("G33", "G76"), "threads are cut in the profile cnc; let the CAM mill the thread"),
        **dict.fromkeys(
            ("G41", "G42"),
            "cutter compensation is for the profile cnc; let the CAM compute the tool's own path",
        ),
        **dict.fromkeys(
            TIP_CONTROL, "the tip is led on the work piece in the profile cnc; let the post write the axes"
        ),
        "G50": "with words it sets a lathe's zero or speed limit; let the post write G92, or D beside G96",
        **dict.fromkeys(("G50.1", "G51.1"), "mirrors are for the profile cnc; let the CAM mirror the part"),
        "G51": "scaling is done in the profile cnc; let the CAM scale the part",
        "G53.1": "the tool is turned in the profile cnc; let the CAM write the rotary axes",
        "G54.1": "there are the systems G54 to G59.3; let the post write one of them",
        "G54.2": "offsets do not turn with the table here; let the post write the moves out",
        "G68": "rotation is done in the profile cnc; let the CAM rotate the part",
        "G68.2": "planes are tilted in the profile cnc; let the post write the rotary axes and the moves",
        "G90.1": "arc centres are increments from the start here; let the post write G91.1",
        "M19": "the spindle is turned to an angle in the profile cnc; let the post leave it out",
        "G95": "feed per revolution is for the profile cnc; use G94",
        "G96": "constant surface speed is kept in the profile cnc; use G97",
        **dict.fromkeys(("M62", "M63", "M64", "M65", "M67", "M68"), "this machine has no outputs"),
        "M66": "this machine has no inputs",
        "M97": "subprograms are not read here; let the post write the moves out",
        **dict.fromkeys(("M98", "M99", "G65"), _MACRO_B),
        **{
            f"G{number}": "canned cycles are read in the profile cnc; let the post write the moves out"
            for number in (73, 74, 81, 82, 83, 84, 85, 86, 89)
        },
        **{
            f"G{number}": "cycles for turning are not expanded here; let the post write the moves out"
            for number in (70, 71, 72)
        },
        **{
            f"G{number}": f"{what} is not done here; let the post write the moves out"
            for number, what in (
                (77, "back boring"),
                (87, "back boring"),
                (88, "boring that is drawn out by hand"),
            )
        },
        **{
            f"M{number}": "state is saved in the profile cnc, by a line of its own; let the post write codes"
            for number in range(70, 74)
        },
        **dict.fromkeys(
            _SHIFTS_OF_PRINTERS, "offsets of the head or the bed are not shifted here; let the slicer do it"
        ),
        VOLUMETRIC: "E is a length here, and no volume; let the slicer write it in mm",
        "G66": "modal calls of macros are not done here; let the post write G65 at each place",
        **{f"G38.{n}": "this machine cannot probe; add [probe] to the machine file" for n in range(2, 6)},
    }
)

# macros of printers' firmware that slicers write and that move nothing
HARMLESS_MACRO: Final = re.compile(
    r"(?:EXCLUDE_OBJECT|SET_PRESSURE_ADVANCE|SET_VELOCITY_LIMIT|SET_PRINT_STATS|TIMELAPSE|BED_MESH|RESPOND|SET_FAN"
    r"|SET_HEATER_TEMPERATURE|TEMPERATURE_WAIT|TURN_OFF_HEATERS|SET_DISPLAY_TEXT|SET_LED|GET_POSITION"
    r"|QUERY_|STATUS_)"
)

# macros that move axes, pause, or change the meaning of later words: no hint to leave them out
MOVING_MACRO: Final = re.compile(
    r"(?:SET_GCODE_OFFSET|(?:SAVE|RESTORE)_GCODE_STATE|FORCE_MOVE|MANUAL_\w+|SET_KINEMATIC_POSITION|PROBE\w*"
    r"|ACTIVATE_EXTRUDER|SYNC_EXTRUDER_MOTION|SET_EXTRUDER_ROTATION_DISTANCE|SET_DUAL_CARRIAGE|SKEW_PROFILE"
    r"|PAUSE|RESUME|CANCEL_PRINT)\Z"
)

# effects on the print where codes have no effect: beginnings of codes, and the consequence
CONSEQUENCES: Final = (
    (
        re.compile(r"(?:M10[49]|M1[49]0|SET_HEATER_TEMPERATURE|TEMPERATURE_WAIT)\Z"),
        "nothing is heated or waited for, but by [dialect.outputs] and [dialect.waits]",
    ),
    (re.compile(r"(?:M10[67]|SET_FAN\w*)\Z"), "fans stay as they are, but by [dialect.outputs]"),
    (
        re.compile(r"(?:M900|M572|SET_PRESSURE_ADVANCE)\Z"),
        "E is not led ahead of its pressure: corners and ends of lines get more than was meant",
    ),
    (
        re.compile(r"(?:G29(?:\.[0-9]+)?|G80|M420|BED_MESH\w*)\Z"),
        "nothing is probed by it: the bed is as the mesh of Z that counts has it, flat without one",
    ),
    (re.compile(r"M622\Z"), "what stands between M622 and M623 is done in any case"),
    (re.compile(r"M808\Z"), "nothing is repeated"),
)


def code_name(letter: str, number: float) -> str:
    """Return a code as in the tables: G1, G59.1, M104."""
    return f"{letter}{number:g}"
