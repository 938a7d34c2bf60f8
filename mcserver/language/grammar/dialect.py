"""Build the dialect's grammar from the command table, for one machine or for any (D-01 to D-04).

The grammar describes programs without a fault of text, grammar, axis or tool number. It is on the strict
side where that keeps it small: words stand in a fixed order (T and modal codes, axes by number, R or I J K,
P, F, where F may also come first), M codes stand on lines without motion, and a number has at most nine
digits before the point. What needs modal state or geometry, such as a feed in force or the radius of an
arc, is left to ``mcserver check``.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

from mcserver.gcode.text.command_table import COMMANDS, CommandSpec, Kind
from mcserver.gcode.text.words import AXIS_LETTERS, INCREMENTAL_LETTERS
from mcserver.language.grammar.expressions import (
    Expression,
    Grammar,
    Ref,
    Repeat,
    SomeOf,
    char,
    choice,
    many,
    opt,
    seq,
    text,
)
from mcserver.language.grammar.profiles import build_profile_grammar
from mcserver.language.grammar.words import Vocabulary, common_words, offsets, vocabulary, whole
from mcserver.machine.machine_file import Machine


def build_grammar(machine: Machine | None = None) -> Grammar:
    """Build the grammar of whole programs.

    Args:
        machine: its axes and tools are the only ones, in its profile; None: all that the dialect can name.
    """
    if machine is not None and not machine.dialect.reference:
        return build_profile_grammar(machine)
    known = vocabulary(machine)
    structure = _structure(known)
    tokens = {**_codes(), **_words(known)}
    return Grammar(known.title, MappingProxyType({**structure, **tokens}), frozenset(tokens))


# --- tokens: each with the blanks and comments that follow it -----------------------------------------------


def _words(known: Vocabulary) -> dict[str, Expression]:
    rules = common_words(known)
    for axis in sorted({*known.axes, *(AXIS_LETTERS[letter] for letter in known.letters)}):
        rules[f"axis-{axis}"] = _axis_word(axis, known.letters, known.axes, incremental=True)
    for axis in known.axes:
        rules[f"direct-{axis}"] = _axis_word(axis, known.letters, known.axes, incremental=False)
    for axis in sorted({*known.linear, *(AXIS_LETTERS[letter] for letter in known.linear_letters)}):
        rules[f"arc-axis-{axis}"] = _axis_word(axis, known.linear_letters, known.linear, incremental=True)
    return rules


def _axis_word(axis: int, letters: frozenset[str], axes: tuple[int, ...], *, incremental: bool) -> Expression:
    names: list[Expression] = []
    for letter, number in AXIS_LETTERS.items():
        relative = letter in INCREMENTAL_LETTERS
        if number == axis and "XYZABC"[axis] in letters and (incremental or not relative):
            names.append(char(letter))
    if axis in axes:
        digits = str(axis)
        inside = seq(Repeat(char("0"), 0, 3 - len(digits)), text(digits))
        names.append(seq(char("["), Ref("gap"), inside, Ref("gap"), char("]")))
    return seq(choice(*names), Ref("gap"), Ref("number"), Ref("space"))


def _codes() -> dict[str, Expression]:
    """Build the codes: those of one kind that take the same words are one token."""
    rules: dict[str, list[CommandSpec]] = {}
    for spec in COMMANDS:
        rules.setdefault(_code_rule(spec), []).append(spec)
    return {name: choice(*_by_letter(specs)) for name, specs in rules.items()}


def _code_rule(spec: CommandSpec) -> str:
    """Return the name of the token of a code."""
    if spec.kind in (Kind.MOVE, Kind.DIRECT) or _takes_tolerance(spec):
        return f"code-{spec.name.lower()}"
    return {
        Kind.SETTING: "modal-code",
        Kind.AXIS: "axis-code",
        Kind.DWELL: "dwell-code",
        Kind.PROGRAM: "program-code",
    }[spec.kind]


def _takes_tolerance(spec: CommandSpec) -> bool:
    return spec.kind is Kind.SETTING and "P" in spec.words


def _by_letter(specs: Sequence[CommandSpec]) -> list[Expression]:
    letters = dict.fromkeys(spec.letter for spec in specs)
    return [
        seq(
            char(letter),
            Ref("gap"),
            whole(spec.number for spec in specs if spec.letter == letter),
            Ref("space"),
        )
        for letter in letters
    ]


# --- structure ----------------------------------------------------------------------------------------------


def _structure(known: Vocabulary) -> dict[str, Expression]:
    """Build lines, groups and commands; every token brings the space behind it."""
    code = {spec.name: Ref(_code_rule(spec)) for spec in COMMANDS}
    with_tolerance = [
        seq(Ref(_code_rule(spec)), opt(Ref("tolerance"))) for spec in COMMANDS if _takes_tolerance(spec)
    ]
    direct = [_direct(spec) for spec in COMMANDS if spec.kind is Kind.DIRECT]
    arcs = bool(known.linear or known.linear_letters)
    rules: dict[str, Expression] = {
        "program": seq(Ref("line"), many(Ref("line-end"), Ref("line"))),
        "line": choice(
            seq(
                Ref("space"),
                opt(Ref("line-number")),
                opt(choice(Ref("motion-line"), Ref("axis-line"), Ref("program-line"))),
                opt(Ref("remark")),
            ),
            seq(Ref("space"), Ref("title"), opt(Ref("remark"))),
        ),
        "motion-line": seq(Ref("motion-group"), many(Ref("comma"), Ref("motion-group"))),
        "axis-line": seq(Ref("axis-group"), many(Ref("comma"), Ref("axis-group"))),
        "program-line": seq(opt(Ref("settings")), Ref("program-code")),
        "motion-group": choice(Ref("moves"), Ref("dwell"), Ref("settings")),
        "moves": choice(
            seq(opt(Ref("settings")), choice(Ref("feed-moves"), Ref("rapid"), Ref("direct"))),
            Ref("repeated-move"),
        ),
        "dwell": seq(Ref("dwell-code"), Ref("seconds")),
        "axis-group": seq(
            opt(Ref("settings")), Repeat(seq(Ref("axis-command"), opt(Ref("later-settings"))), 1)
        ),
        "axis-command": seq(Ref("axis-code"), opt(Ref("axis-number"))),
        # several of G01-G03 share one duration (D-31)
        "feed-moves": Repeat(Ref("feed-move"), 1),
        **_feed_moves(code, arcs),
        "rapid": seq(
            code["G00"], choice(seq(Ref("linear-words"), opt(Ref("later-settings"))), Ref("code-words"))
        ),
        "direct": seq(choice(*direct), opt(Ref("later-settings"))),
        # axis words without a code repeat the last of G00-G03 (D-03)
        "repeated-move": seq(
            choice(
                seq(Ref("settings-with-feed"), Ref("repeated-words")),
                seq(opt(Ref("settings-without-feed")), Ref("repeated-words"), opt(Ref("feed"))),
            ),
            opt(Ref("later-settings")),
        ),
        "repeated-words": seq(Ref("axes"), opt(Ref("centre"), opt(Ref("turns")))) if arcs else Ref("axes"),
        **_settings(bool(known.tools)),
        "modal": choice(Ref("modal-code"), *with_tolerance),
        "axes": _ascending("axis", known.axes, known.letters),
        "direct-axes": _ascending("direct", known.axes, frozenset()),
    }
    if arcs:
        rules["arc-axes"] = _ascending("arc-axis", known.linear, known.linear_letters)
        rules["centre"] = choice(Ref("radius"), Ref("offsets"))
        rules["offsets"] = offsets()
    return rules


def _feed_moves(code: dict[str, Ref], arcs: bool) -> dict[str, Expression]:
    """Build G01, G02 and G03; a code without words is only remembered."""
    moving: list[Expression] = [seq(code["G01"], Ref("linear-words"))]
    other: list[Expression] = [seq(code["G01"], Ref("code-words"))]
    rules: dict[str, Expression] = {}
    if arcs:
        moving.append(seq(Ref("arc-code"), Ref("arc-words")))
        other.append(seq(Ref("arc-code"), Ref("circle-words")))
        around = seq(Ref("offsets"), opt(Ref("turns")))
        rules = {
            "arc-code": choice(code["G02"], code["G03"]),
            "arc-words": _with_feed(seq(Ref("arc-axes"), Ref("centre"), opt(Ref("turns")))),
            "circle-words": _with_feed(around),
        }
    return {
        "feed-move": choice(seq(choice(*moving), opt(Ref("later-settings"))), *other),
        "linear-words": _with_feed(Ref("axes")),
        "code-words": choice(Ref("before-with-feed"), Ref("before")),
        **rules,
    }


def _with_feed(words: Expression) -> Expression:
    """Put F before or behind a command's words, or leave it out; T and modal codes stand before them."""
    return choice(seq(Ref("before-with-feed"), words), seq(Ref("before"), words, opt(Ref("feed"))))


def _direct(spec: CommandSpec) -> Expression:
    """Build G1020, G1030 or G1040; only a position can be an increment."""
    code, modal = Ref(_code_rule(spec)), many(Ref("modal"))
    if "F" not in spec.words:
        return seq(code, modal, Ref("direct-axes"))
    feed = Ref("feed")
    return seq(code, modal, choice(seq(feed, modal, Ref("axes")), seq(Ref("axes"), opt(feed))))


def _settings(tools: bool) -> dict[str, Expression]:
    """Build modal codes with at most one T and one F, as a command of their own and inside of a motion."""
    modal, feed, tool = many(Ref("modal")), Ref("feed"), Ref("tool")
    some = Repeat(Ref("modal"), 1)
    if not tools:
        return {
            "before": modal,
            "before-with-feed": seq(modal, feed, modal),
            "settings": choice(Ref("settings-with-feed"), Ref("settings-without-feed")),
            "settings-without-feed": some,
            "settings-with-feed": seq(modal, feed, modal),
            "later-settings": seq(some, opt(feed, modal)),
        }
    return {
        "before": seq(modal, opt(tool, modal)),
        "before-with-feed": seq(
            modal, choice(seq(tool, modal, feed, modal), seq(feed, modal, opt(tool, modal)))
        ),
        "settings": choice(Ref("settings-with-feed"), Ref("settings-without-feed")),
        "settings-without-feed": choice(seq(some, opt(tool, modal)), seq(tool, modal)),
        "settings-with-feed": Ref("before-with-feed"),
        # behind a command's axis words a modal code ends it; F and T alone would still belong to it (D-01a)
        "later-settings": seq(
            some, opt(choice(seq(tool, modal, opt(feed, modal)), seq(feed, modal, opt(tool, modal))))
        ),
    }


def _ascending(rule: str, axes: Sequence[int], letters: frozenset[str]) -> Expression:
    """Build one axis word or more, each axis at most once, in the order of their numbers."""
    numbers = sorted({*axes, *(AXIS_LETTERS[letter] for letter in letters)})
    return SomeOf(tuple(Ref(f"{rule}-{number}") for number in numbers))
