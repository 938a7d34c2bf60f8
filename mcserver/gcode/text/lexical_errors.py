"""Scan a line with lexical errors: report each one and continue with the best guess."""

from __future__ import annotations

import re
import unicodedata

from mcserver.errors import Edit
from mcserver.gcode.line_faults import FaultList, Span
from mcserver.gcode.text.command_table import find_command
from mcserver.gcode.text.words import LETTERS, MAX_AXIS

_BLANK = re.compile(r"[ \t]*")
# a run that may have been meant as a number: no blanks, controls, letters except O, brackets, commas
_RUN = re.compile(r"[^\x00-\x20\x7fA-NP-Za-np-z,\[\]()]*")
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)\Z")
_EXPONENT = re.compile(r"[eE][-+]?[0-9]+")
_BRACKET = re.compile(r"\[([^\[\],]*)\]")
_DIGITS = re.compile(r"[0-9]+\Z")
_CONTROLS = re.compile(r"[\x00-\x08\x0a-\x1f\x7f]+")
_SIX = re.compile(r"6([0-9]{1,4})\Z")
_MINUSES = str.maketrans(dict.fromkeys("‐‑‒–—−﹣－", "-"))
_UNKNOWN = "nan"

Token = tuple[str, str, str]


def scan_faulty(code: str, faults: FaultList) -> tuple[list[Token], list[Span]]:
    """Return tokens and their columns; a number that cannot be guessed is ``nan``, an axis number ``[?]``."""
    scanner = _ErrorScanner(code, faults)
    scanner.read()
    return scanner.tokens, scanner.spans


def _shorten(text: str) -> str:
    return text if len(text) <= 24 else f"{text[:20]}…"


def _character(character: str) -> str:
    name = unicodedata.name(character, "")
    if not name:
        name = {"\x00": "NUL", "\r": "carriage return", "\x7f": "DEL"}.get(character, "a control character")
    return f"U+{ord(character):04X} ({name})"


class _ErrorScanner:
    """Scans the code in one pass from left to right, reading each character a bounded number of times."""

    def __init__(self, code: str, faults: FaultList) -> None:
        self.code = code
        self.faults = faults
        self.tokens: list[Token] = []
        self.spans: list[Span] = []
        self.position = 0

    def read(self) -> None:
        code = self.code
        first = _BLANK.match(code).end()  # type: ignore[union-attr]  # matches the empty string too
        if code[first : first + 1] == "%":
            self._percent_line(first)
            return
        while (start := _BLANK.match(code, self.position).end()) < len(code):  # type: ignore[union-attr]
            character = code[start]
            if character == ",":
                self._token(("", "", ","), start, start + 1)
            elif character == "[":
                self._bracket(start)
            elif character.isascii() and character.isalpha():
                self._letter(start)
            else:
                self._stray(start)

    def _token(self, token: Token, start: int, end: int) -> None:
        self.tokens.append(token)
        self.spans.append((start + 1, end + 1))
        self.position = end

    def _fault(
        self, code: str, message: str, start: int, end: int, hint: str = "", *, edit: Edit | None = None
    ) -> None:
        self.faults.add(code, message, (start + 1, end + 1), hint, edit=edit)

    def _percent_line(self, start: int) -> None:
        """Skip a ``%`` line with its title; code in it is a fault, since it would be ignored silently."""
        rest = self.code[start + 1 :]
        # %NEU G71: units of DIN 66025 after the program's name
        if re.match(r"[ \t]*[GMgm][ \t]*[0-9]|.*[ \t][Gg]7[01](?![0-9])", rest):
            self._fault(
                "MC103",
                "code after '%' would not be read",
                start,
                len(self.code),
                "put the code on a line of its own",
            )

    def _letter(self, start: int) -> None:
        code = self.code
        letter = code[start].upper()
        if letter not in LETTERS:
            end = _RUN.match(code, start + 1).end()  # type: ignore[union-attr]
            hint = ""
            if letter == "O" and end == start + 1 and not code[end : end + 1].isalnum():
                hint = "if the digit 0 is meant, write 0"
            elif letter == "D" or letter == "H":
                hint = "there is no tool compensation here"
            elif letter == "S":
                hint = "a spindle is an axis: use G1030 with its number"
            self._fault("MC103", f"{letter} is not a word of this dialect", start, end, hint)
            self.position = end
            return
        self._number(letter, letter, start, start + 1)

    def _number(self, name: str, shown: str, start: int, after_name: int) -> None:
        """Read the number of a word whose name ends before ``after_name``."""
        code = self.code
        begin = _BLANK.match(code, after_name).end()  # type: ignore[union-attr]
        end = _RUN.match(code, begin).end()  # type: ignore[union-attr]
        run = code[begin:end]
        if _NUMBER.match(run):
            exponent = _EXPONENT.match(code, end)
            if exponent is not None:
                end = exponent.end()
                self._exponent(shown, run, exponent[0], start, end)
                run = _UNKNOWN
        elif not run.isascii():
            run = self._foreign(shown, run, begin)
        elif "O" in run or "o" in run:
            run = self._letter_o(shown, run, start, end)
        elif not run:
            end = after_name
            controls = _CONTROLS.match(code, begin)
            if controls is None:  # the control character has a fault of its own
                hint = f"write {shown}0 if zero is meant" if name not in "GMNTFP" else ""
                self._fault("MC102", f"{shown} has no number", start, end, hint)
            run = _UNKNOWN
        else:
            hint = "write a number such as 5, -1.5 or .25"
            if run in (".", "+.", "-."):
                hint = f"write {shown}0 if zero is meant"
            elif run.startswith(("--", "+-", "-+", "++")):
                hint = "one sign is enough"
            elif "*" in run or "/" in run or "#" in run or "=" in run:
                hint = "there are no variables or expressions here; write the value"
            self._fault("MC102", f"'{_shorten(run)}' after {shown} is not a number", start, end, hint)
            run = _UNKNOWN
        self._token((name, run, ""), start, end)

    def _exponent(self, shown: str, run: str, exponent: str, start: int, end: int) -> None:
        value = float(run + exponent) if len(run) + len(exponent) < 30 else float("inf")
        hint = "write the number out"
        if 1e-6 <= abs(value) <= 1e9:
            hint = f"write {shown}{format(value, '.9f').rstrip('0').rstrip('.')}"
        written = _shorten(self.code[start:end])
        self._fault("MC102", f"numbers have no exponent here: '{written}'", start, end, hint)

    def _letter_o(self, shown: str, run: str, start: int, end: int) -> str:
        digits = run.replace("O", "0").replace("o", "0")
        if not _NUMBER.match(digits):
            self._fault("MC102", f"'{_shorten(run)}' after {shown} is not a number", start, end)
            return _UNKNOWN
        written = _shorten(self.code[start:end])
        self._fault(
            "MC101",
            f"'{written}' holds the letter O where the digit 0 belongs",
            start,
            end,
            f"write {shown}{_shorten(digits)}",
            edit=Edit(end - len(run) + 1, end + 1, digits),
        )
        return digits

    def _foreign(self, shown: str, run: str, begin: int) -> str:
        """Report the first non-ASCII character of a number, and return what the number looks like."""
        at = next(index for index, character in enumerate(run) if not character.isascii())
        # blanks beyond ASCII become plain ones, so that words stay separate
        plain = unicodedata.normalize("NFKC", run.translate(_MINUSES)).translate(_MINUSES)
        meant = plain.strip()
        fits = _NUMBER.match(meant) is not None
        hint = f"write {shown}{_shorten(meant)}" if fits else "type the word again"
        if unicodedata.normalize("NFKC", run[at]) == " ":
            hint = "type a plain space"
        self._fault(
            "MC105",
            f"{_character(run[at])} cannot stand in code, which is ASCII",
            begin + at,
            begin + at + 1,
            hint,
            edit=Edit(begin + 1, begin + len(run) + 1, plain) if fits and plain.isascii() else None,
        )
        return meant if fits else _UNKNOWN

    def _bracket(self, start: int) -> None:
        match = _BRACKET.match(self.code, start)
        if match is None:
            end = _RUN.match(self.code, start + 1).end()  # type: ignore[union-attr]
            self._fault("MC102", "the axis number is not closed", start, end, "write the axis as [6]")
            self.position = end
            return
        inside = match[1].strip(" \t")
        end = match.end()
        name = "[?]"
        if _DIGITS.match(inside):
            digits = inside.lstrip("0") or "0"
            if len(digits) <= 2 and int(digits) <= MAX_AXIS:
                name = f"[{digits}]"
            else:
                self._fault(
                    "MC108",
                    f"[{_shorten(inside)}] is not an axis: axes are [0] to [{MAX_AXIS}]",
                    start,
                    end,
                )
        elif inside and _DIGITS.match(zeros := inside.replace("O", "0").replace("o", "0")):
            self._fault(
                "MC101",
                f"'[{_shorten(inside)}]' holds the letter O where the digit 0 belongs",
                start,
                end,
                f"write [{_shorten(zeros)}]",
                edit=Edit(start + 1, end + 1, f"[{zeros}]"),
            )
            digits = zeros.lstrip("0") or "0"
            name = f"[{digits}]" if len(digits) <= 2 and int(digits) <= MAX_AXIS else name
        else:
            self._fault(
                "MC108",
                f"'[{_shorten(inside)}]' does not name an axis: the number is whole and from 0 to {MAX_AXIS}",
                start,
                end,
                "write the axis as [6]",
            )
        self._number(name, self.code[start:end] if name == "[?]" else name, start, end)

    def _stray(self, start: int) -> None:
        code = self.code
        controls = _CONTROLS.match(code, start)
        if controls is not None:
            end = controls.end()
            hint = "take it out"
            if code[start] == "\r":
                hint = "lines end at LF or CR LF; a lone CR does not end one"
            self._fault("MC105", f"{_character(code[start])} cannot stand in code", start, end, hint)
            self.position = end
            return
        if code[start] in ")]%":
            self._closing(start)
            return
        end = max(_RUN.match(code, start).end(), start + 1)  # type: ignore[union-attr]
        run = code[start:end]
        if not run.isascii():
            at = next(index for index, character in enumerate(run) if not character.isascii())
            meant = unicodedata.normalize("NFKC", run[at])
            hint = "take it out, or put it in a comment"
            edit: Edit | None = None
            if meant != run[at] and len(meant) == 1 and meant.isascii() and meant.isprintable():
                hint = "type a plain space" if meant == " " else f"type a plain {meant}"
                alike = len(run[at:]) - len(run[at:].lstrip(run[at]))
                edit = Edit(start + at + 1, start + at + alike + 1, meant * alike)
            self._fault(
                "MC105",
                f"{_character(run[at])} cannot stand in code, which is ASCII",
                start + at,
                start + at + 1,
                hint,
                edit=edit,
            )
            self.position = end
        elif (six := _SIX.match(run)) is not None and find_command("G", six[1]) is not None:
            self._fault("MC103", f"the number {run} has no letter", start, end, f"did you mean G{six[1]}?")
            self._token(("G", six[1], ""), start, end)
        elif run[0] in "0123456789.+-":
            self._fault(
                "MC103",
                f"the number {_shorten(run)} has no letter",
                start,
                end,
                "a word is a letter and a number; numbers hold no blanks",
            )
            self.position = end
        else:
            self._fault("MC103", f"'{_shorten(run)}' has no meaning here", start, end)
            self.position = end

    def _closing(self, start: int) -> None:
        if self.code[start] == ")":
            self._fault("MC106", "this ')' closes no comment", start, start + 1, "take it out")
        elif self.code[start] == "]":
            self._fault("MC103", "this ']' closes no axis number", start, start + 1, "write the axis as [6]")
        else:
            self._fault("MC103", "'%' stands only at the beginning of a line", start, start + 1)
        self.position = start + 1
