"""Pressure advance of printers: Marlin's M900, RepRapFirmware's M572, Klipper's macro (D-143)."""

from __future__ import annotations

import re

from mcserver.gcode.line_faults import FaultList
from mcserver.gcode.profiles.codes import KLIPPER_ADVANCE
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.text.profile_words import Action, ProfileWord

# letters of K, of the extruder and of the smooth time
_WORDS = {"M900": ("K", "T", None), "M572": ("S", "D", "W"), KLIPPER_ADVANCE: ("K", "T", "W")}
# Bambu Studio adds L and M for its firmware after K
_CURVE = re.compile(r"(?<=[0-9.])[ \t]*L[ \t]*[0-9.]+[ \t]*M[ \t]*[0-9.]+[ \t]*\Z")
_PARAMETER = re.compile(r"[ \t]*([A-Z_]+)[ \t]*=[ \t]*([^ \t=]+)")
_NUMBERS = {"ADVANCE": "K", "SMOOTH_TIME": "W"}
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")


def without_curve(code: str) -> str:
    """Replace what Bambu Studio writes after K by blanks."""
    return _CURVE.sub(lambda match: " " * len(match[0]), code)


def klipper_words(code: str, start: int, faults: FaultList) -> dict[str, ProfileWord]:
    """Return the parameters after the name of a Klipper macro as words; faults are reported."""
    found = {}
    while code[start:].strip():
        match = _PARAMETER.match(code, start)
        name, value = ("", "") if match is None else (match[1], match[2])
        span = (start + 1, len(code.rstrip()) + 1) if match is None else (match.start(1) + 1, match.end() + 1)
        if name in _NUMBERS and _NUMBER.fullmatch(value):
            found[_NUMBERS[name]] = ProfileWord(_NUMBERS[name], float(value), value, -1, span)
        elif name == "EXTRUDER" and value != "EXTRUDER":
            what = f"this printer has no {value.lower()}: it has one, extruder"
            faults.add("MC143", what, span, "leave EXTRUDER out")
        elif name != "EXTRUDER":
            hint = "it takes EXTRUDER=extruder, ADVANCE=0.05 and SMOOTH_TIME=0.04"
            faults.add("MC113", f"{KLIPPER_ADVANCE} does not take this", span, hint)
        if match is None:
            break
        start = match.end()
    return found


def set_advance(block: BlockState, action: Action) -> None:
    """Set K of E for the moves after a line; faults are reported."""
    code, words, faults = action.code, action.words, block.faults
    machine = block.setup.machine
    extruder = machine.dialect.extruder
    axis = None if extruder is None else machine.axis(extruder)
    own = None if axis is None else axis.pressure_advance
    assert own is not None  # without it these codes do not act
    gain, number, smooth = _WORDS[code]
    for letter, word in words.items():
        if letter not in _WORDS[code]:
            taken = " ".join(each for each in _WORDS[code] if each is not None)
            faults.add("MC113", f"{code} takes no {letter}", word.span, f"it takes {taken}")
        elif letter == number and word.value != 0.0:
            what = f"this printer has no extruder {word.text}: it has one, 0"
            faults.add("MC143", what, word.span, f"leave {letter} out")
        elif letter == smooth and abs(word.value - own.smooth_time) > 1e-9:
            what = f"the flow is smoothed over {own.smooth_time:g} s, not {word.text} s"
            faults.add("MC116", what, word.span, "change smooth_time_s of E, or leave it out")
        elif letter == gain and not 0.0 <= word.value <= own.greatest:
            what = f"{word.text} s of pressure advance is not within 0 to {own.greatest:g} s"
            faults.add("MC116", what, word.span, "give seconds, or E a larger greatest_s")
    if gain in words and not faults.found:
        block.change(advance=words[gain].value)
