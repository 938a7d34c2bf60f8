"""Answers that need no server: the machine, the dialect by topic, faults, and drafts of programs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from mcserver.errors import Refused
from mcserver.executor.fault_codes import remedy_of
from mcserver.gcode.line_faults import TITLES
from mcserver.gcode.text.command_table import COMMANDS
from mcserver.gcode.text.word_table import WORDS
from mcserver.language.agents.fault_messages import messages_of
from mcserver.language.lsp.knowledge import describe_any_code, describe_letter
from mcserver.language.profile_codes import acting_codes, in_order
from mcserver.language.rules import rules
from mcserver.machine.machine_file import Machine
from mcserver.planning.start_state import axis_word
from mcserver.units import MM

MAX_POINTS = 5000
TOPICS = {
    "lines": ("D-01", "D-01a", "D-02", "D-03", "D-04"),
    "modes": ("D-10", "D-11", "D-12", "D-13", "D-14", "D-15"),
    "moves": ("D-20", "D-21", "D-25", "D-28"),
    "arcs": ("D-22", "D-23"),
    "time": ("D-30", "D-31", "D-32", "D-33"),
    "corners": ("D-34", "D-35", "D-36"),
    "axes": ("D-26", "D-27", "D-40"),
    "tools": ("D-50", "D-51", "D-52", "D-53", "D-54"),
}


def machine_facts(machine: Machine) -> dict[str, Any]:
    """Describe a machine in the units of programs: mm, degrees and seconds."""
    axes = []
    for axis in machine.axes:
        unit = axis.type.si_per_unit
        limits = {
            "min_position": axis.min_position / unit,
            "max_position": axis.max_position / unit,
            "max_velocity": axis.max_velocity / unit,
            "max_acceleration": axis.max_acceleration / unit,
            "max_jerk": axis.max_jerk / unit,
        }
        axes.append(
            {
                "word": axis_word(machine, axis.index),
                "axis": axis.index,
                "type": axis.type.value,
                "unit": axis.type.unit,
                "start": axis.initial_position / unit,
                **{name: value if abs(value) != float("inf") else None for name, value in limits.items()},
            }
        )
    tools = [
        {
            "word": f"T{tool.number}",
            "axes": list(tool.axes),
            "orientation": tool.orientation,
            "euler": tool.euler,
        }
        for tool in machine.tools
    ]
    table = [
        {"word": f"T{number}", "length": cutter.length / MM, "diameter": cutter.diameter / MM}
        for number, cutter in sorted(machine.dialect.cutters.items())
    ]
    profile = machine.dialect.profile
    return {"machine": machine.name, "profile": profile, "axes": axes, "tools": tools, "tool_table": table}


def dialect_topic(topic: str, machine: Machine) -> str:
    """Explain a topic, a code (``G02``), a word (``R``) or a rule (``D-22``) in Markdown."""
    asked = topic.strip()
    rule = rules().get(asked[:2].upper() + asked[2:].lower())
    if rule is not None:
        return f"**{rule.name}** {rule.title}. {rule.text}"
    if asked.lower() in TOPICS:
        return "\n\n".join(
            f"**{name}** {rules()[name].title}. {rules()[name].text}" for name in TOPICS[asked.lower()]
        )
    described = describe_any_code(asked, machine)
    if described:
        return described
    word = describe_letter(asked.upper(), machine)
    if word:
        return word
    return overview(machine)


def overview(machine: Machine) -> str:
    """List every code and word on a line of its own, with an example, the profile's codes, and the topics."""
    codes = "\n".join(f"{spec.name}: {spec.title}, such as {spec.example}" for spec in COMMANDS)
    words = "\n".join(f"{' '.join(spec.letters)}: {spec.title}" for spec in WORDS)
    begin = (
        "The first move energizes"
        if machine.dialect.auto_capture
        else "A program starts with G1010 (energize)"
    )
    own = ""
    if machine.dialect.profile != "reference":
        added = acting_codes(machine) - {f"{spec.letter}{spec.number}" for spec in COMMANDS}
        own = f"Besides, by the profile {machine.dialect.profile}: {' '.join(in_order(added))}\n\n"
    return (
        f"{begin}; a feed move needs F. mm and mm/min unless G20, G93.\n\n"
        f"{codes}\n\n{words}\n\n{own}Topics: {', '.join(TOPICS)}; or a code, a word, a rule such as D-22."
    )


def fault_facts(code: str) -> dict[str, str]:
    """Explain the code of a fault.

    Raises:
        ServiceError: MC511 the code is not known.
    """
    asked = code.strip().upper()
    if asked in TITLES:
        return {
            "code": asked,
            "title": TITLES[asked],
            "help": "`check` gives line, columns, values and a hint",
        }
    if re.fullmatch(r"MC4[0-9]{2}", asked):
        message, hint = remedy_of(int(asked[2:]), "…")
        if hint:
            return {"code": asked, "title": message, "help": hint}
    if re.fullmatch(r"MC[0-9]{3}", asked) and (found := messages_of(asked)):
        titles, hints = zip(*found, strict=True)
        return {
            "code": asked,
            "title": " | ".join(titles),
            "help": " | ".join(dict.fromkeys(each for each in hints if each)) or "the fault itself says it",
        }
    raise Refused("MC511", f"{asked[:20]} is no code of this server", "codes look like MC104 or MC401")


def draft(points: Sequence[Sequence[float]], feed: float, words: str, *, rapid_first: bool) -> str:
    """Write a program through points: capture, rapid to the first, straight lines through the others.

    Args:
        points: coordinates in mm (degrees of rotary axes), one for each of ``words``.
        feed: above zero [mm/min].
        words: axis letters such as ``XY``.

    Raises:
        ServiceError: MC511 letters, counts or numbers that do not fit.
    """
    letters = words.upper()
    if not letters or len(set(letters)) != len(letters) or not set(letters) <= set("XYZABC"):
        raise Refused("MC511", f"{words[:20]!r} are not different letters of XYZABC", "such as XY or XYZ")
    if not 1 <= len(points) <= MAX_POINTS or any(len(point) != len(letters) for point in points):
        raise Refused("MC511", f"1 to {MAX_POINTS} points of {len(letters)} numbers are needed", "")
    numbers = [feed, *(value for point in points for value in point)]
    if not all(-1e6 < value < 1e6 for value in numbers) or feed < 1e-3:
        raise Refused("MC511", "a number is out of range", "mm or degrees, and a feed above zero")
    lines = ["G1010", f"G21 G90 G94 F{_number(feed)}"]
    for place, point in enumerate(points):
        code = "G00" if place == 0 and rapid_first else "G01"
        lines.append(
            " ".join([code, *(f"{letter}{_number(at)}" for letter, at in zip(letters, point, strict=True))])
        )
    return "\n".join([*lines, "M30", ""])


def _number(value: float) -> str:
    return f"{value:.4f}".rstrip("0").rstrip(".") or "0"
