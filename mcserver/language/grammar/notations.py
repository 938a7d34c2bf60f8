"""Write a grammar as EBNF (W3C), GBNF (llama.cpp), Lark, or one regular expression."""

from __future__ import annotations

import enum
import re
from collections.abc import Callable, Mapping

import msgspec

from mcserver.language.grammar.expressions import (
    Chars,
    Choice,
    Expression,
    Grammar,
    Ref,
    Repeat,
    Seq,
    SomeOf,
    halves,
)

_SPECIAL = frozenset(r"\[](){}.*+?|^$-/")
_CONTROLS = {"\t": r"\t", "\r": r"\r", "\n": r"\n"}


class Notation(enum.Enum):
    """The language in which a grammar is written."""

    EBNF = "ebnf"
    GBNF = "gbnf"
    LARK = "lark"
    REGEX = "regex"


def write_grammar(grammar: Grammar, notation: Notation) -> str:
    """Write a grammar, with a line end."""
    match notation:
        case Notation.EBNF:
            return f"/* {grammar.title} */\n" + _rules(grammar.rules, _EBNF)
        case Notation.GBNF:
            renamed = {
                "root" if name == grammar.start else name: rule for name, rule in grammar.rules.items()
            }
            return f"# {grammar.title}\n" + _rules(renamed, _GBNF)
        case Notation.LARK:
            return _write_lark(grammar)
        case Notation.REGEX:
            # each line with its end: the start rule would say every line twice
            return f"(?:{write_regex(grammar, 'line')}{write_regex(grammar, 'line-end')})*\n"


# --- one regular expression ---------------------------------------------------------------------------------


def write_regex(grammar: Grammar, rule: str | None = None) -> str:
    """Write a rule, the start rule by default, as a regular expression without references and look-around."""
    known: dict[str, str] = {}

    def inlined(name: str) -> str:
        if name not in known:
            known[name] = _regex(grammar.rules[name], inlined)
        return known[name]

    return inlined(grammar.start if rule is None else rule)


def _regex(expression: Expression, inlined: Callable[[str], str]) -> str:
    """Write an expression; alternatives are in parentheses."""
    match expression:
        case Chars():
            character = single(expression)
            return _class(expression, _escaped) if character is None else _escaped(character)
        case Ref():
            return inlined(expression.name)
        case Seq():
            return "".join(_regex(part, inlined) for part in expression.parts)
        case SomeOf():
            return _regex(halves(expression.parts), inlined)
        case Choice():
            return f"(?:{'|'.join(_regex(part, inlined) for part in expression.parts)})"
        case Repeat():
            inner = _regex(expression.part, inlined)
            return (inner if isinstance(expression.part, Chars) else f"(?:{inner})") + _braces(expression)


def _escaped(character: str) -> str:
    return _CONTROLS.get(character) or (f"\\{character}" if character in _SPECIAL else character)


def single(expression: Expression) -> str | None:
    """Return the character of a set of one, else None."""
    if isinstance(expression, Chars) and not expression.negated and len(expression.ranges) == 1:
        first, last = expression.ranges[0]
        return first if first == last else None
    return None


def _class(chars: Chars, escaped: Callable[[str], str]) -> str:
    members = (
        escaped(first) if first == last else f"{escaped(first)}-{escaped(last)}"
        for first, last in chars.ranges
    )
    return f"[{'^' if chars.negated else ''}{''.join(members)}]"


def _braces(repeat: Repeat) -> str:
    match repeat.least, repeat.most:
        case 0, 1:
            return "?"
        case 0, None:
            return "*"
        case 1, None:
            return "+"
        case least, None:
            return f"{{{least},}}"
        case least, most:
            return f"{{{least},{most}}}"


# --- rule by rule -------------------------------------------------------------------------------------------


class _Style(msgspec.Struct, frozen=True):
    """What differs between notations of rules.

    Attributes:
        defines: between a rule's name and its text.
        character: writes a member of a set.
        counted: True if ``x{1,9}`` can be written; else it is spelled out.
    """

    defines: str
    character: Callable[[str], str]
    counted: bool


def _in_ebnf(character: str) -> str:
    return f"#x{ord(character):X}" if character in "\t\r\n ]-^#[" else character


def _in_gbnf(character: str) -> str:
    return f"\\x{ord(character):02X}" if character in "\t\r\n]-^[\\" else character


_EBNF = _Style("::=", _in_ebnf, counted=False)
_GBNF = _Style("::=", _in_gbnf, counted=True)


def _rules(rules: Mapping[str, Expression], style: _Style) -> str:
    return "".join(f"{name} {style.defines} {_rule(rule, style, top=True)}\n" for name, rule in rules.items())


def _rule(expression: Expression, style: _Style, *, top: bool = False) -> str:
    match expression:
        case Chars():
            character = single(expression)
            return _class(expression, style.character) if character is None else _literal(character, style)
        case Ref():
            return expression.name
        case Seq():
            return " ".join(_parts(expression.parts, style)) or '""'
        case SomeOf():
            return _rule(halves(expression.parts), style, top=top)
        case Choice():
            written = " | ".join(_rule(part, style) for part in expression.parts)
            return written if top else f"( {written} )"
        case Repeat():
            return _repeated(expression, style)


def _parts(parts: tuple[Expression, ...], style: _Style) -> list[str]:
    """Write the parts of a sequence, neighbouring literals as one."""
    written: list[str] = []
    literal = ""
    for part in parts:
        character = single(part)
        if character is not None and character.isprintable() and character not in '"\\':
            literal += character
            continue
        if literal:
            written.append(f'"{literal}"')
            literal = ""
        written.append(_rule(part, style))
    return [*written, f'"{literal}"'] if literal else written


def _literal(character: str, style: _Style) -> str:
    if character.isprintable() and character not in '"\\':
        return f'"{character}"'
    return f"[{style.character(character)}]" if style.counted else style.character(character)


def _repeated(repeat: Repeat, style: _Style) -> str:
    inner = _rule(repeat.part, style)
    if isinstance(repeat.part, Seq | Repeat):
        inner = f"( {inner} )"
    if style.counted or (repeat.least, repeat.most) in ((0, 1), (0, None), (1, None)):
        return inner + _braces(repeat)
    optional = [] if repeat.most is None else [f"{inner}?"] * (repeat.most - repeat.least)
    return " ".join([inner] * repeat.least + optional + ([f"{inner}*"] if repeat.most is None else []))


# --- Lark ---------------------------------------------------------------------------------------------------


def _write_lark(grammar: Grammar) -> str:
    """Write rules for structure and a terminal for each token; needs ``parser="earley"``."""
    lines = [f"// {grammar.title}", f"start: {_lark_name(grammar.start, grammar)}"]
    used: set[str] = set()
    for name, rule in grammar.rules.items():
        if isinstance(rule, SomeOf):
            lines += _lark_chain(name, rule, grammar, used)
        elif name not in grammar.tokens:
            lines.append(f"{_lark_name(name, grammar)}: {_lark(rule, grammar, used, top=True)}")
    for name in grammar.rules:
        if name in used:
            pattern = write_regex(grammar, name)
            if re.fullmatch(pattern, ""):
                # a terminal must not be empty: where it stands it is optional
                pattern = f"(?:{pattern[:-1]})+" if pattern.endswith("*") else pattern
            lines.append(f"{_lark_name(name, grammar)}: /{pattern}/")
    return "\n".join(lines) + "\n"


def _lark_chain(name: str, rule: SomeOf, grammar: Grammar, used: set[str]) -> list[str]:
    """Write a chain of rules, one for each part: optional parts in a row would become all their subsets."""
    lines: list[str] = []
    names = [_lark_name(name, grammar) + (f"_{place}" if place else "") for place in range(len(rule.parts))]
    for place, part in enumerate(rule.parts):
        word = _lark(part, grammar, used)
        rest = f" {names[place + 1]}? | {names[place + 1]}" if place + 1 < len(names) else ""
        lines.append(f"{names[place]}: {word}{rest}")
    return lines


def _lark_name(name: str, grammar: Grammar) -> str:
    name = name.replace("-", "_")
    return name.upper() if name.replace("_", "-") in grammar.tokens else name


def _lark(expression: Expression, grammar: Grammar, used: set[str], *, top: bool = False) -> str:
    match expression:
        case Chars():
            return f"/{_regex(expression, str)}/"
        case Ref():
            name = _lark_name(expression.name, grammar)
            if expression.name in grammar.tokens:
                used.add(expression.name)
                if re.fullmatch(write_regex(grammar, expression.name), ""):
                    return f"{name}?"
            return name
        case Seq():
            return " ".join(_lark(part, grammar, used) for part in expression.parts)
        case Choice():
            written = " | ".join(_lark(part, grammar, used) for part in expression.parts)
            return written if top else f"({written})"
        case Repeat():
            braces = {(0, 1): "?", (0, None): "*", (1, None): "+"}[expression.least, expression.most]
            return f"({_lark(expression.part, grammar, used)}){braces}"
        case SomeOf():
            return f"({_lark(halves(expression.parts), grammar, used)})"
