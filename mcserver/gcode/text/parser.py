"""Parse a line into groups, commands and words (D-01, D-01a), with all faults that need no modal state."""

from __future__ import annotations

from copy import copy

from mcserver.errors import Edit
from mcserver.gcode.line_faults import FaultList, Origin, Span
from mcserver.gcode.text.grammar import group_commands
from mcserver.gcode.text.profile_words import ProfileWords
from mcserver.gcode.text.scanner import Scan, Token, scan, token_spans
from mcserver.gcode.text.source import BOM
from mcserver.gcode.text.syntax import Command, Group
from mcserver.gcode.text.words import AXIS_LETTERS, LARGEST, MAX_AXIS, Word


class ParsedLine:
    """A parsed line: groups of commands of words; columns are computed on demand.

    Attributes:
        number: of the line, from 1.
        text: as written.
        groups: comma groups in reading order, empty for a blank line.
        faults: of text and grammar, including those given.
        profile: actions besides the reference's words, in dialects of profiles.
        origin: of a computed line: its line in the text, and a map of columns to it; None: the text is the
            line itself.
    """

    __slots__ = ("_scan", "_spans", "faults", "groups", "number", "origin", "profile", "text")

    def __init__(
        self, number: int, text: str, scanned: Scan, faults: FaultList, profile: ProfileWords | None = None
    ) -> None:
        self.number = number
        self.text = text
        self.profile = profile
        self.origin: Origin | None = None
        self._scan = scanned
        self._spans: list[Span] | None = scanned.spans
        words = self._split(faults)
        self.groups = group_commands(words, faults, self.span, offsets_move=profile is not None)
        self.faults = faults.in_reading_order()

    def with_words(self, groups: tuple[Group, ...], profile: ProfileWords | None) -> ParsedLine:
        """Return the line with other values of words, at the same columns."""
        found = copy(self)
        found.groups, found.profile = groups, profile
        return found

    @property
    def blank(self) -> bool:
        """Whether the line has no code."""
        return not self.groups and self.profile is None

    def _letter(self, index: int) -> str:
        """Return the letter that a profile's line uses for an axis; empty if it uses the axis's number."""
        spans = self._scan.spans
        first = "" if spans is None else self._scan.code[spans[index][0] - 1]
        return first if first.isalpha() else ""

    def span(self, first: int, last: int | None = None) -> Span:
        """Return the columns of token ``first``, or from there to token ``last``: from 1, end exclusive."""
        if self._spans is None:
            self._spans = token_spans(self._scan.code)
        if not 0 <= first < len(self._spans):
            return (1, len(self.text) + 1)
        return (self._spans[first][0], self._spans[first if last is None else last][1])

    def command_span(self, command: Command) -> Span:
        """Return the columns from a command's code to its last word."""
        return self.span(command.first, command.last)

    def _split(self, faults: FaultList) -> list[list[Word]]:
        """Split the tokens into the words of each comma group, without the line number."""
        groups: list[list[Word]] = [[]]
        commas: list[int] = []
        for index, token in enumerate(self._scan.tokens):
            if token[2]:
                commas.append(index)
                groups.append([])
                continue
            word = self._word(index, token, faults)
            if word.letter == "N":
                self._line_number(word, faults)
            else:
                groups[-1].append(word)
        if commas:
            self._empty_groups(commas, faults)
        return groups

    def _empty_groups(self, commas: list[int], faults: FaultList) -> None:
        """Report MC107 at the comma beside each group without words."""
        code = self._scan.code
        start = 0
        for comma in commas:
            column, end_column = self.span(comma)
            if not code[start : column - 1].strip(" \t"):
                self._empty_group("before", comma, faults)
            start = end_column - 1
        if not code[start:].strip(" \t"):
            self._empty_group("behind", commas[-1], faults)

    def _empty_group(self, side: str, comma: int, faults: FaultList) -> None:
        span = self.span(comma)
        edit = Edit(*span, "")
        faults.add("MC107", f"nothing stands {side} this comma", span, "take the comma out", edit=edit)

    def _word(self, index: int, token: Token, faults: FaultList) -> Word:
        name, text, _ = token
        value = float(text)
        if name[0] == "[":
            inside = name[1:-1].strip(" \t")
            axis = int(inside) if inside != "?" else -1
            if axis > MAX_AXIS:
                column = self.span(index)[0]
                faults.add(
                    "MC108",
                    f"[{inside}] is not an axis: axes are [0] to [{MAX_AXIS}]",
                    (column, column + len(name)),
                )
                axis = -1
            word = Word("[", value, index, axis, text, self._letter(index))
        else:
            word = Word(name, value, index, AXIS_LETTERS.get(name, -1), text)
        if not -LARGEST <= value <= LARGEST and value == value and name not in ("G", "M", "N"):
            faults.add(
                "MC116",
                f"{word.shown} is beyond {LARGEST:.0f}, the largest number that is read",
                self.span(index),
            )
            word = Word(word.letter, float("nan"), index, word.axis, text)
        return word

    def _line_number(self, word: Word, faults: FaultList) -> None:
        if word.index != 0:
            faults.add(
                "MC117", "N stands only at the beginning of a line", self.span(word.index), "put it first"
            )
        elif not word.text.isdigit() and word.value == word.value:
            faults.add("MC117", f"{word.shown} is not a whole number from 0", self.span(0))


def scan_line(text: str, number: int) -> ParsedLine:
    """Parse a line; faults are stored in `ParsedLine.faults`, for callers that continue after a fault."""
    if number == 1:
        text = text.removeprefix(BOM)
    faults = FaultList(number)
    return ParsedLine(number, text, scan(text, faults), faults)
