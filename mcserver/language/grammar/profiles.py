"""Build the grammar of a profile's programs: blocks of RS-274 as posts and slicers write them (D-60, D-61).

Stricter than the reader: words stand in the usual orders, comments nest once, and of the reference's own
codes there are only those that capture and release axes. What is derived has no fault of text, code or axis
under the profile; modal state, geometry and the machine's tables are left to ``mcserver check``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from types import MappingProxyType

from mcserver.gcode.profiles.codes import (
    ACTING,
    ADVANCE,
    DRILLING,
    FACTORS,
    IGNORED,
    LATHE,
    PROBING,
    SILENT,
    TAPPING,
    acting_of,
    settings_of,
)
from mcserver.gcode.profiles.frame import LENGTH_AXIS
from mcserver.gcode.text.words import AXIS_LETTERS, INCREMENTAL_LETTERS
from mcserver.language.grammar.expressions import (
    Chars,
    Choice,
    Expression,
    Grammar,
    Ref,
    Repeat,
    Seq,
    SomeOf,
    char,
    choice,
    many,
    opt,
    seq,
    text,
)
from mcserver.language.grammar.words import (
    DIGIT,
    all_but,
    common_words,
    offsets,
    one_of,
    vocabulary,
    whole,
    word,
)
from mcserver.machine.machine_file import Machine
from mcserver.machine.work_systems import SYSTEM_NUMBERS
from mcserver.units import AxisType

# the beginnings of printers' macros that go without effect
_MACRO_FAMILIES = (
    *("EXCLUDE_OBJECT", "SET_PRESSURE_ADVANCE", "SET_VELOCITY_LIMIT", "SET_PRINT_STATS"),
    *("TIMELAPSE", "BED_MESH", "RESPOND", "SET_FAN"),
)
_CODE = re.compile(r"([GM])([0-9]+)(?:\.([0-9]+))?\Z")
_MACRO = re.compile(r"[A-Z_]{3,}[A-Z0-9_]*\Z")
_CAPTURING = (1000, 1001, 1002, 1010, 1011)
# acting codes without words of their own
_WORDLESS = frozenset(
    {
        *("G7", "G8", "G15", "G40", "G49", "G69", "G80", "G90.1", "G91.1", "G95", "G98", "G99"),
        *("G92.1", "G92.2", "G92.3", "M82", "M83", "M600", *SYSTEM_NUMBERS),
    }
)
_NAMED_ELSEWHERE = frozenset("FGIJKMNPRST")


def build_profile_grammar(machine: Machine) -> Grammar:
    """Build the grammar of whole programs for a machine whose profile is not the reference's."""
    structure = _structure(machine)
    tokens = _tokens(machine)
    used = _reachable({**structure, **tokens})
    known = {name: rule for name, rule in tokens.items() if name in used}
    title = f"G-code of the profile {machine.dialect.profile}, machine {machine.name}"
    return Grammar(title, MappingProxyType({**structure, **known}), frozenset(known))


def _structure(machine: Machine) -> dict[str, Expression]:
    """Build lines and blocks; every token brings the space behind it."""
    acting, profile = ACTING[machine.dialect.profile], machine.dialect.profile
    linear = sorted(axis.index for axis in machine.axes if axis.type is AxisType.LINEAR)
    spindle = [opt(Ref("speed"))] if "M3" in acting else []
    centre = [opt(choice(Ref("radius"), Ref("offsets")))] if linear else []
    blocks = [
        seq(Ref("before"), opt(Ref("feed"), many(Ref("setting"))), opt(Ref("program-code"))),
        seq(Ref("before"), Ref("straight-code"), many(Ref("setting")), opt(Ref("straight-words"))),
        seq(Ref("before"), Ref("axes"), *centre, opt(Ref("feed")), *spindle),
        seq(Ref("dwell-code"), Ref("seconds")),
    ]
    rules: dict[str, Expression] = {
        # one tolerance in a line: its word is P
        "before": seq(many(Ref("setting")), opt(Ref("rounding"), many(Ref("setting")))),
        "straight-words": choice(
            seq(Ref("feed"), opt(Ref("axes"))), seq(Ref("axes"), opt(Ref("feed")), *spindle)
        ),
        "axes": _axes(machine),
    }
    if profile == "robot" and machine.tools:
        rules["before"] = seq(rules["before"], opt(Ref("tool"), many(Ref("setting"))))
    if linear:
        blocks.append(seq(Ref("before"), Ref("arc-code"), Ref("arc-words")))
        rules |= _arcs(linear, [axis for axis in _lettered(machine) if axis in linear])
    blocks += _special_blocks(machine)
    lines = [seq(Ref("space"), opt(Ref("line-number")), choice(*blocks), opt(Ref("remark")))]
    lines.append(seq(Ref("gap"), Ref("capturing"), opt(Ref("remark"))))
    lines += [seq(Ref("gap"), other) for other in _idle_lines(machine)]
    return {
        "program": seq(Ref("line"), many(Ref("line-end"), Ref("line"))),
        "line": choice(*lines),
        **rules,
    }


def _axes(machine: Machine) -> Expression:
    """Build axis words in the order of their numbers; slicers write E before the others too."""
    numbers = sorted(axis.index for axis in machine.axes)
    lettered = _lettered(machine)
    others = [number for number in numbers if number not in lettered]
    ascending = SomeOf(tuple(Ref(f"axis-{number}") for number in numbers))
    if not lettered or not others:
        return ascending
    first, last = (SomeOf(tuple(Ref(f"axis-{each}") for each in group)) for group in (lettered, others))
    return choice(ascending, seq(first, last))


def _arcs(linear: list[int], lettered: list[int]) -> dict[str, Expression]:
    """Build arcs; an axis with a letter of the machine's own, such as E, may stand behind the offsets."""
    plain = [axis for axis in linear if axis not in lettered] or linear
    behind = [opt(SomeOf(tuple(Ref(f"axis-{axis}") for axis in lettered)))] if plain != linear else []
    return {
        "arc-words": choice(
            seq(Ref("arc-axes"), choice(Ref("radius"), Ref("offsets")), *behind, opt(Ref("feed"))),
            seq(Ref("offsets"), *behind, opt(Ref("feed"))),
        ),
        "arc-axes": SomeOf(tuple(Ref(f"axis-{axis}") for axis in plain)),
        "offsets": offsets(),
    }


def _special_blocks(machine: Machine) -> list[Expression]:
    """Build the blocks of codes that act with words of their own."""
    acting = ACTING[machine.dialect.profile]
    blocks: list[Expression] = []
    if "G53" in acting:
        blocks.append(seq(Ref("machine-frame"), Ref("straight-code"), Ref("axes"), opt(Ref("feed"))))
    if "G92" in acting:
        blocks.append(seq(Ref("offset-code"), Ref("axes")))
    if "G28" in acting:
        blocks.append(seq(Ref("home-code"), opt(Ref("axes"))))
    if "M3" in acting:
        blocks.append(seq(Ref("spindle-code"), opt(Ref("speed")), many(Ref("setting"))))
        blocks.append(seq(Ref("speed"), opt(Ref("spindle-code"))))
    if "M6" in acting:
        blocks.append(seq(Ref("pocket"), opt(Ref("change"))))
        blocks.append(seq(Ref("change"), opt(Ref("pocket"))))
    if "G43" in acting:
        blocks.append(
            seq(opt(Ref("straight-code")), Ref("length-code"), opt(Ref("axes")), Ref("length-number"))
        )
    if "G41" in acting:
        blocks.append(
            seq(
                Ref("before"),
                choice(
                    seq(opt(Ref("straight-code")), Ref("beside"), opt(Ref("straight-words"))),
                    seq(Ref("beside"), Ref("straight-code"), opt(Ref("straight-words"))),
                ),
            )
        )
    if "G81" in acting:
        # P stands before R, or behind Q, and not beside a tolerance, whose word it is too
        depths = (opt(Ref("radius")), opt(Ref("peck")))
        words = choice(seq(Ref("seconds"), *depths), seq(*depths, opt(Ref("seconds"))))
        blocks.append(
            seq(
                *(many(Ref("setting")), Ref("cycle-code"), opt(Ref("axes")), words),
                *(opt(Ref("times")), opt(Ref("feed"))),
            )
        )
    if "G28.1" in acting:
        blocks.append(
            seq(
                Ref("system-code"),
                choice(seq(Ref("kind"), opt(Ref("system"))), seq(Ref("system"), Ref("kind"))),
                Ref("axes"),
            )
        )
        blocks.append(Ref("store-code"))
    if "G43" in acting and machine.axis(LENGTH_AXIS) is not None:
        words = seq(Ref("system-code"), Ref("tool-kind"), Ref("tool-number"))
        blocks.append(seq(words, Ref(f"axis-{LENGTH_AXIS}"), opt(Ref("tool-radius"))))
    if machine.dialect.probes:
        blocks.append(seq(Ref("before"), Ref("probe-code"), Ref("straight"), opt(Ref("feed"))))
    blocks += _io_blocks(machine)
    if machine.dialect.profile == "printer":
        blocks += [Ref("dwell-code"), seq(Ref("factor-code"), opt(Ref("per-cent")))]
        if machine.dialect.retraction is not None:
            blocks.append(Ref("retraction-code"))
        if machine.dialect.leads:
            blocks.append(seq(Ref("advance-code"), opt(Ref("advance"))))
        if machine.dialect.mesh_axis is not None:
            blocks += [Ref("bed-code"), seq(Ref("mesh-code"), Ref("mesh-use"))]
        blocks.append(seq(Ref("home-code"), Ref("home-option")))
    return blocks


def _io_blocks(machine: Machine) -> list[Expression]:
    """Build M62 to M68 for the inputs and outputs that the machine has (D-70 to D-72)."""
    blocks: list[Expression] = []
    if any(each.digital for each in machine.outputs):
        blocks.append(seq(Ref("switch-code"), Ref("digital-output")))
    if any(not each.digital for each in machine.outputs):
        blocks.append(seq(Ref("level-code"), Ref("analog-output"), Ref("level")))
    if any(each.digital for each in machine.inputs):
        waits = seq(Ref("wait"), Ref("timeout"))
        blocks.append(seq(Ref("input-code"), Ref("digital-input"), opt(waits)))
    if any(not each.digital for each in machine.inputs):
        blocks.append(seq(Ref("input-code"), Ref("analog-input")))
    return blocks


def _idle_lines(machine: Machine) -> list[Expression]:
    """Build lines that go without effect whatever stands in them."""
    lines: list[Expression] = [Ref("title"), seq(Ref("program-name"), opt(Ref("remark")))]
    if machine.dialect.profile == "printer":
        lines.append(seq(Ref("idle"), opt(Ref("remark"))))
    if _macros(machine):
        lines.append(seq(Ref("macro"), opt(Ref("remark"))))
    return lines


def _tokens(machine: Machine) -> dict[str, Expression]:
    dialect = machine.dialect
    ignored = (
        IGNORED[dialect.profile] | dialect.mapped | {name for name in dialect.ignore if _CODE.match(name)}
    )
    acting = ACTING[dialect.profile]
    printer = dialect.profile == "printer"
    # printers' codes without effect take a line of their own, with whatever stands behind them
    idle = frozenset() if printer else (ignored | SILENT) - LATHE  # with words G50 is a lathe's
    settings = settings_of(dialect.profile) | (_WORDLESS & acting) | idle
    rest = opt(Ref("blank"), many(all_but("();\r\n")))
    outer, inner = all_but("()\r\n"), seq(char("("), many(all_but("();\r\n")), char(")"))
    numbers = sorted(axis.index for axis in machine.axes)
    words: dict[str, Expression] = {
        **common_words(vocabulary(machine)),
        "comment": choice(
            seq(char("("), many(outer), char(")")),
            seq(char("("), many(choice(all_but("();\r\n"), inner)), char(")")),
        ),
        "setting": _codes((settings - acting | (_WORDLESS & acting)) | {"G64"}),
        "rounding": seq(_codes({"G64"}), Ref("tolerance")),
        "straight-code": _codes({"G0", "G1"}),
        "arc-code": _codes({"G2", "G3"}),
        "program-code": _codes({"M0", "M1", "M2", "M30", "M60"}),
        "dwell-code": _codes({"G4"}),
        "machine-frame": _codes({"G53"}),
        "offset-code": _codes({"G92"}),
        "home-code": _codes({"G28", "G30"} & acting or {"G28"}),
        "retraction-code": _codes({"G10", "G11"}),
        "factor-code": _codes(FACTORS & acting_of(dialect) or FACTORS),
        "advance-code": _codes({"M900"}),
        "advance": word("K", _advances(machine)),
        "bed-code": _codes({"G29"}),
        "mesh-code": _codes({"M420"}),
        "mesh-use": word("S", whole((0, 1))),
        "per-cent": word("S", Ref("positive")),
        "home-option": seq(char("W"), Ref("space")),
        "spindle-code": _codes({"M3", "M4", "M5"}),
        "speed": word("S", Ref("unsigned")),
        "pocket": word("T", Repeat(DIGIT, 1, 2)),
        "change": _codes({"M6"}),
        "cycle-code": _codes((DRILLING - TAPPING) & acting or {"G81"}),
        "peck": word("Q", Ref("positive")),
        "times": word("L", whole(range(1, 100))),
        "system-code": _codes({"G10"}),
        "kind": word("L", whole((2, 20))),
        "tool-kind": word("L", whole((1,))),
        "tool-number": word("P", whole(range(1, 100))),
        "tool-radius": word("R", Ref("unsigned")),
        "system": word("P", whole(range(10))),
        "store-code": _codes({"G28.1", "G30.1"}),
        "probe-code": _codes(PROBING),
        "straight": SomeOf(
            tuple(Ref(f"axis-{each.index}") for each in machine.axes if each.type is AxisType.LINEAR)
        ),
        **_io_words(machine),
        "program-name": seq(choice(char("O"), char(":")), Ref("gap"), Repeat(DIGIT, 1, 8), Ref("space")),
        "beside": choice(
            seq(_codes({"G41", "G42"}), opt(word("D", Repeat(DIGIT, 1, 2)))),
            seq(_codes({"G41.1", "G42.1"}), word("D", Ref("positive"))),
        ),
        "length-code": _codes({"G43"}),
        "length-number": word("H", Repeat(DIGIT, 1, 2)),
        # lines as the reference has them: no nested comments, and a blank behind the code
        "capturing": seq(
            char("G"),
            one_of(_CAPTURING),
            opt(Ref("blank"), Ref("gap"), opt(char("P"), Ref("gap"), whole(numbers), Ref("gap"))),
        ),
    }
    for axis in machine.axes:
        words[f"axis-{axis.index}"] = _axis(axis.index, machine)
    if printer:
        names = [name for name in ignored - acting_of(dialect) if name[0] == "G" or "." not in name]
        words["idle"] = seq(
            choice(
                seq(_bare_codes(name for name in names if name[0] == "G")),
                seq(
                    _bare_codes(name for name in names if name[0] == "M"), opt(char("."), Repeat(DIGIT, 1, 2))
                ),
                seq(char("T"), char("0")),
            ),
            rest,
        )
    if _macros(machine):
        words["macro"] = seq(choice(*_macros(machine)), rest)
    return words


def _io_words(machine: Machine) -> dict[str, Expression]:
    """Build the words of M62 to M68: the numbers of the machine's inputs and outputs."""
    words: dict[str, Expression] = {
        "switch-code": _codes({"M62", "M63", "M64", "M65"}),
        "level-code": _codes({"M67", "M68"}),
        "input-code": _codes({"M66"}),
        "level": word("Q", Ref("number")),
        "wait": word("L", whole(range(1, 5))),
        "timeout": word("Q", Ref("positive")),
    }
    for name, channels in (("output", machine.outputs), ("input", machine.inputs)):
        digital = [each.number for each in channels if each.digital]
        analog = [each.number for each in channels if not each.digital]
        if digital:
            words[f"digital-{name}"] = word("P", whole(sorted(digital)))
        if analog:
            words[f"analog-{name}"] = word("E", whole(sorted(analog)))
    return words


def _macros(machine: Machine) -> list[Expression]:
    """Build the names of macros that go without effect, longer ones first."""
    own = sorted((name for name in machine.dialect.ignore if _MACRO.match(name)), key=len, reverse=True)
    names: list[Expression] = [text(name) for name in own]
    if machine.dialect.profile == "printer":
        tail = many(Chars((("A", "Z"), ("a", "z"), ("_", "_"))))
        acting = (ADVANCE if machine.dialect.leads else frozenset[str]()) | (
            set() if machine.dialect.mesh_axis is None else {"BED_MESH"}
        )
        families = [each for each in _MACRO_FAMILIES if each not in acting]
        names += [seq(text(family), tail) for family in families]
    return names


def _advances(machine: Machine) -> Expression:
    """Build K of pressure advance in steps of a tenth of the greatest."""
    shaping = machine.shaping
    greatest = 0.0 if shaping is None or shaping.lead is None else shaping.lead.own.greatest
    shown = {f"{greatest * tenths / 10.0:.6f}".rstrip("0").rstrip(".") for tenths in range(10)}
    # longer ones first, as readers may take the first that fits
    return choice(*(text(each) for each in sorted(shown, key=lambda each: (-len(each), each))))


def _lettered(machine: Machine) -> list[int]:
    """Return the axes that have a letter of the machine's own."""
    return sorted(set(machine.dialect.letters.values()))


def _axis(axis: int, machine: Machine) -> Expression:
    # U V W are increments of X Y Z in robots' programs only
    known = set(AXIS_LETTERS) - (INCREMENTAL_LETTERS if machine.dialect.profile != "robot" else set())
    letters = {**{each: AXIS_LETTERS[each] for each in sorted(known)}, **machine.dialect.letters}
    names: list[Expression] = [
        char(letter)
        for letter, number in letters.items()
        if number == axis and letter not in _NAMED_ELSEWHERE
    ]
    digits = seq(Repeat(char("0"), 0, 1), text(str(axis))) if axis < 10 else text(str(axis))
    names.append(seq(char("["), Ref("gap"), digits, Ref("gap"), char("]")))
    return seq(choice(*names), Ref("gap"), Ref("number"), Ref("space"))


def _codes(names: Iterable[str]) -> Expression:
    """Build a choice of codes, each with at most two leading zeros and the space behind it."""
    return seq(_bare_codes(names), Ref("space"))


def _bare_codes(names: Iterable[str]) -> Expression:
    """Build a choice of codes; longer ones first: some readers take the first alternative that fits."""
    families: dict[str, list[tuple[str, str]]] = {}
    for name in names:
        match = _CODE.match(name)
        if match is not None:
            families.setdefault(match[1], []).append((str(int(match[2])), match[3] or ""))
    zeros = Repeat(char("0"), 0, 2)
    return choice(
        *(
            seq(char(letter), Ref("gap"), zeros, choice(*map(_numbered, _longest_first(numbers))))
            for letter, numbers in sorted(families.items())
        )
    )


def _longest_first(numbers: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    return sorted(set(numbers), key=lambda each: (-len(each[0]) - len(each[1]), each))


def _numbered(number: tuple[str, str]) -> Expression:
    whole, fraction = number
    return text(f"{whole}.{fraction}" if fraction else whole)


def _reachable(rules: dict[str, Expression]) -> set[str]:
    """Return the names of the rules that the start rule needs."""
    found = {next(iter(rules))}
    waiting: list[Expression] = [rules[next(iter(rules))]]
    while waiting:
        match waiting.pop():
            case Ref(name) if name not in found:
                found.add(name)
                waiting.append(rules[name])
            case Seq(parts) | Choice(parts):
                waiting.extend(parts)
            case SomeOf(refs):
                waiting.extend(refs)
            case Repeat(part, _, _):
                waiting.append(part)
    return found
