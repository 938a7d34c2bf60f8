"""Read values: numbers, parameters and expressions of RS274/NGC (D-80) or of Fanuc's macro B (D-92)."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np

from mcserver.errors import Diagnostic
from mcserver.gcode.line_faults import Span

# numbers closer than this are equal, and a number this close to a whole one is whole (LinuxCNC)
TOLERANCE = 0.0001
LARGEST_PARAMETER = 5602
# depth of nested brackets in one line
_DEEPEST = 64


class ComputingError(Exception):
    """A value that cannot be computed, with columns, from 1, end exclusive, and line; 0: the current line.

    Attributes:
        file: file of the machine's with the line; empty: the program.
    """

    def __init__(
        self, code: str, message: str, span: Span, hint: str = "", line: int = 0, file: str = ""
    ) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.span = span
        self.hint = hint
        self.line = line
        self.file = file

    def diagnostic(self, line: int) -> Diagnostic:
        """Return it as a fault of a line."""
        return Diagnostic(
            code=self.code,
            message=self.message,
            line=line,
            column=self.span[0],
            end_column=self.span[1],
            hint=self.hint,
        )


class Values(Protocol):
    """Where an expression reads parameters; a missing one is reported at ``span``."""

    def numbered(self, number: int, span: Span) -> float: ...
    def named(self, name: str, span: Span) -> float: ...
    def exists(self, name: str) -> bool: ...


Value = Callable[[Values], float]
Operators = Mapping[str, tuple[int, Callable[[float, float], float]]]


class Null(float):
    """Value of an unset parameter of macro B: 0 in sums, and not equal to 0 in comparisons."""


NULL = Null(0.0)


class Language(NamedTuple):
    """Operators, functions and null of an expression language.

    Attributes:
        operators: precedence and function of each; those of equal precedence bind from left to right.
        functions: of one argument. full_turn: ATAN is never negative.
        null: #0 is `NULL`, and a word whose value is `NULL` is omitted.
    """

    operators: Operators
    functions: Mapping[str, Callable[[float], float]]
    full_turn: bool = False
    null: bool = False


def _modulo(left: float, right: float) -> float:
    found = math.fmod(left, right)
    return found + abs(right) if found < 0.0 else found


def _exclusive(left: float, right: float) -> float:
    return float((left == 0.0) != (right == 0.0))


_OPERATORS: Operators = MappingProxyType(
    {
        "**": (5, operator.pow),
        "*": (4, operator.mul),
        "/": (4, operator.truediv),
        "MOD": (4, _modulo),
        "+": (3, operator.add),
        "-": (3, operator.sub),
        "EQ": (2, lambda left, right: float(abs(left - right) < TOLERANCE)),
        "NE": (2, lambda left, right: float(abs(left - right) >= TOLERANCE)),
        "GT": (2, lambda left, right: float(left > right)),
        "GE": (2, lambda left, right: float(left >= right)),
        "LT": (2, lambda left, right: float(left < right)),
        "LE": (2, lambda left, right: float(left <= right)),
        "AND": (1, lambda left, right: float(left != 0.0 and right != 0.0)),
        "OR": (1, lambda left, right: float(left != 0.0 or right != 0.0)),
        "XOR": (1, _exclusive),
    }
)
_FUNCTIONS: Mapping[str, Callable[[float], float]] = MappingProxyType(
    {
        # keep signed zeros, as C does: they turn ATAN by 360 degrees
        "ABS": lambda value: -value if value < 0.0 else value,
        "ACOS": lambda value: math.degrees(math.acos(value)),
        "ASIN": lambda value: math.degrees(math.asin(value)),
        "COS": lambda value: math.cos(math.radians(value)),
        "EXP": math.exp,
        "FIX": lambda value: float(np.floor(value)),
        "FUP": lambda value: float(np.ceil(value)),
        "LN": math.log,
        "ROUND": lambda value: float(math.trunc(value + math.copysign(0.5, value))),
        "SIN": lambda value: math.sin(math.radians(value)),
        "SQRT": math.sqrt,
        "TAN": lambda value: math.tan(math.radians(value)),
    }
)
NGC = Language(_OPERATORS, _FUNCTIONS)
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
_OPERATOR = re.compile(r"\*\*|[-+*/]|MOD|AND|XOR|OR|EQ|NE|G[TE]|L[TE]", re.IGNORECASE)
_FUNCTION = re.compile(r"([A-Z]{2,6})[ \t]*(?=\[)", re.IGNORECASE)
# such as <depth>, and <_ini[section]name> in files for LinuxCNC
_NAME = re.compile(r"<((?:[^<>()\[\]#=;]|\[[^<>()\[\]#=;]*\])*)>")
_BLANKS = re.compile(r"[ \t]*")


def skip(text: str, at: int) -> int:
    """Return the index of the next character that is not blank."""
    found = _BLANKS.match(text, at)
    return at if found is None else found.end()


@dataclass(frozen=True, slots=True, eq=False)
class Parameter:
    """A parameter in a line, by name or by an expression for its number; calling it returns its value.

    Attributes:
        name: lower case, without blanks; empty for a numbered one. null: #0 is `NULL`.
    """

    name: str
    number: Value | None
    span: Span
    null: bool = False

    def index(self, values: Values) -> int:
        """Return the number of a numbered parameter.

        Raises:
            ComputingError: MC162 it is not a whole number in range.
        """
        assert self.number is not None
        value = self.number(values)
        if math.isnan(value):
            return 0
        number = round(value)
        if abs(value - number) >= TOLERANCE or not 1 <= number <= LARGEST_PARAMETER:
            raise ComputingError(
                "MC162",
                f"#{value:g} is no parameter",
                self.span,
                f"numbered parameters are #1 to #{LARGEST_PARAMETER}; others have names: #<depth>",
            )
        return number

    def exists(self, values: Values) -> float:
        """Return 1 where it has a value, else 0; numbered ones have one from the start (LinuxCNC)."""
        if self.number is None:
            return float(values.exists(self.name))
        return float(1.0 <= self.number(values) < LARGEST_PARAMETER)

    def __call__(self, values: Values) -> float:
        """Return its value."""
        if self.number is None:
            return values.named(self.name, self.span)
        if self.null and abs(self.number(values)) < TOLERANCE:
            return NULL
        number = self.index(values)
        return values.numbered(number, self.span) if number else math.nan


def read_parameter(text: str, at: int, deep: int = 0, language: Language = NGC) -> tuple[Parameter, int]:
    """Read the parameter whose ``#`` is at index ``at``; return it and the index after it.

    Raises:
        ComputingError: MC160.
    """
    start = at
    at = skip(text, at + 1)
    name = _NAME.match(text, at)
    if name is not None:
        shown = "".join(name[1].split()).lower()
        if not shown:
            raise ComputingError("MC160", "the parameter has no name", (start + 1, name.end() + 1))
        return Parameter(shown, None, (start + 1, name.end() + 1)), name.end()
    number, end = read_value(text, at, deep + 1, language)
    return Parameter("", number, (start + 1, end + 1), null=language.null), end


def read_value(text: str, at: int, deep: int = 0, language: Language = NGC) -> tuple[Value, int]:
    """Read a number, parameter, function or expression at index ``at``; return it and the index after it.

    Raises:
        ComputingError: MC160.
    """
    at = skip(text, at)
    if deep > _DEEPEST:
        raise ComputingError("MC160", f"brackets stand more than {_DEEPEST} deep", (at + 1, at + 2))
    number = _NUMBER.match(text, at)
    if number is not None:
        constant = float(number[0])
        return lambda _: constant, number.end()
    first = text[at : at + 1]
    if first == "[":
        return _read_brackets(text, at, deep, language)
    if first == "#":
        return read_parameter(text, at, deep, language)
    if first in ("-", "+"):
        value, end = read_value(text, at + 1, deep + 1, language)
        return ((lambda values: -value(values)) if first == "-" else value), end
    function = _FUNCTION.match(text, at)
    if function is not None:
        return _read_function(text, function, deep, language)
    what = f"'{text[at : at + 12]}'" if text[at:].strip() else "the line's end"
    raise ComputingError(
        "MC160",
        f"a value is missing: {what} is none",
        (at + 1, at + 2),
        "write a number, a parameter such as #1, or an expression such as [#1 + 2]",
    )


def _read_brackets(text: str, start: int, deep: int, language: Language) -> tuple[Value, int]:
    """Read ``[a op b …]``."""
    value, at = read_operation(text, start + 1, deep, language)
    if text[at : at + 1] == "]":
        return value, at + 1
    missing = at >= len(text)
    raise ComputingError(
        "MC160",
        "the bracket is not closed" if missing else f"'{text[at]}' is no operator",
        (start + 1, start + 2) if missing else (at + 1, at + 2),
        "add ']'" if missing else f"there are {' '.join(language.operators)}",
    )


def read_operation(text: str, at: int, deep: int, language: Language) -> tuple[Value, int]:
    """Read ``a op b …`` by precedence; operators of equal precedence from left to right.

    Raises:
        ComputingError: MC160.
    """
    operators = language.operators
    value, at = read_value(text, at, deep + 1, language)
    values: list[Value] = [value]
    pending: list[tuple[str, Span]] = []
    while True:
        at = skip(text, at)
        found = _OPERATOR.match(text, at)
        if found is None or found[0].upper() not in operators:
            while pending:
                _join(values, operators, *pending.pop())
            return values[0], at
        name = found[0].upper()
        while pending and operators[pending[-1][0]][0] >= operators[name][0]:
            _join(values, operators, *pending.pop())
        pending.append((name, (found.start() + 1, found.end() + 1)))
        value, at = read_value(text, found.end(), deep + 1, language)
        values.append(value)


def _join(values: list[Value], operators: Operators, name: str, span: Span) -> None:
    second, first = values.pop(), values.pop()
    compute = operators[name][1]

    def joined(given: Values) -> float:
        left, right = first(given), second(given)
        if left != left or right != right:
            return math.nan
        return _checked(lambda: compute(left, right), f"{left:g} {name} {right:g}", span)

    values.append(joined)


def _read_function(text: str, found: re.Match[str], deep: int, language: Language) -> tuple[Value, int]:
    name, at = found[1].upper(), found.end()
    span = (found.start() + 1, at + 1)
    if name == "EXISTS" and not language.null:
        inner = skip(text, at + 1)
        if text[inner : inner + 1] == "#":
            parameter, end = read_parameter(text, inner, deep)
            end = skip(text, end)
            if text[end : end + 1] == "]":
                return parameter.exists, end + 1
        raise ComputingError("MC160", "EXISTS asks for a parameter", span, "write EXISTS[#<name>]")
    if name == "ATAN":
        upper, at = _read_brackets(text, at, deep, language)
        slash = skip(text, at)
        if text[slash : slash + 1] != "/" or text[skip(text, slash + 1) :][:1] != "[":
            raise ComputingError("MC160", "ATAN has two arguments", span, "write ATAN[y]/[x]")
        lower, end = _read_brackets(text, skip(text, slash + 1), deep, language)
        turn = 360.0 if language.full_turn else math.inf
        return lambda values: _angle(upper(values), lower(values), turn), end
    compute = language.functions.get(name)
    if compute is None:
        known = " ".join(sorted([*language.functions, "ATAN", *([] if language.null else ["EXISTS"])]))
        raise ComputingError("MC160", f"there is no function {name}", span, f"there are {known}")
    argument, end = _read_brackets(text, at, deep, language)

    def called(values: Values) -> float:
        value = argument(values)
        return value if value != value else _checked(lambda: compute(value), f"{name}[{value:g}]", span)

    return called, end


def _angle(upper: float, lower: float, turn: float) -> float:
    """Return the direction of a vector [deg], from 0 up to ``turn`` if that is finite."""
    angle = math.degrees(math.atan2(upper, lower))
    return angle % turn if math.isfinite(turn) else angle


def _checked(compute: Callable[[], float], shown: str, span: Span) -> float:
    try:
        found = compute()
    except (ValueError, ZeroDivisionError, OverflowError):
        found = math.nan
    # a negative number to a fractional power is complex in Python
    if isinstance(found, complex) or not math.isfinite(found):
        raise ComputingError("MC163", f"{shown} has no value", span, "see what its parameters are there")
    return found
