"""Read a line of a profile's programs (D-60, D-61).

Words in any order, as in RS-274, become a line of the reference's grammar, and actions for codes that the
reference does not have (`mcserver.gcode.profiles.word_sorter`). Macros, prose, programs that compute and
commands to firmware are recognized before.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from mcserver.errors import Edit
from mcserver.gcode.line_faults import FaultList
from mcserver.gcode.notices import DISPLAY, logging_of
from mcserver.gcode.profiles.advance_codes import klipper_words, without_curve
from mcserver.gcode.profiles.bed_mesh_codes import bed_mesh_macro
from mcserver.gcode.profiles.codes import (
    ADVANCE,
    BED_MESH,
    FACTORS,
    FILES_OF_PRINTERS,
    HARMLESS_MACRO,
    KLIPPER_ADVANCE,
    MOVING_MACRO,
    RETRACTING,
    VOLUMETRIC,
    code_name,
)
from mcserver.gcode.profiles.word_sorter import POLAR_LETTERS, WordSorter
from mcserver.gcode.text.parser import ParsedLine, scan_line
from mcserver.gcode.text.profile_words import Action, ProfileWords
from mcserver.gcode.text.profile_words import ProfileWord as Word
from mcserver.gcode.text.scanner import Scan
from mcserver.gcode.text.source import BOM
from mcserver.gcode.text.words import AXIS_LETTERS, INCREMENTAL_LETTERS, axis_letters
from mcserver.machine.dialect_section import Dialect

_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_TOKEN = re.compile(rf"([A-Z@^])[ \t]*({_NUMBER})|\[[ \t]*([0-9]{{1,2}})[ \t]*\][ \t]*({_NUMBER})|([^ \t])")
_COMMENT = re.compile(r"\([^()]*\)|;.*")
_COMPUTED = re.compile(
    r"#[ \t]*[0-9<\[#]|[A-Z0-9\]>][ \t]*=|[A-Z@^][ \t]*[-+]?[ \t]*\[|\][ \t]*\["
    r"|\b(?:IF|WHILE|GOTO|CALL|SUB|ENDSUB)\b|O[ \t]*<|\A[ \t]*(?:N[0-9]+[ \t]*)?O[ \t]*[0-9]+[ \t]*[A-Z]{2}"
)
_PROGRAM_NUMBER = re.compile(r"[ \t]*[O:][ \t]*[0-9]+[ \t]*\Z")
_WITH_O = re.compile(r"(?<![A-Z<])([A-MP-Z])([-+]?[0-9O.]*O[0-9O.]*)(?![A-Z.0-9])")
_MACRO = re.compile(r"[ \t]*([A-Z_][A-Z_]{2,}[A-Z0-9_]*)(?![0-9.+-])")
# words of a language; codes never have four letters in a row
_PROSE = re.compile(r"[A-Z]{4,}")
_HEAD = re.compile(r"[ \t]*(?:N[0-9]+[ \t]*)?([GMT])[ \t]*([0-9]+(?:\.[0-9]+)?)")
# Fanuc's chamfers, corner radii and line angles: ,C5 ,R3 ,A45
_CORNER = re.compile(r",[ \t]*([ACR])[ \t]*[-+.0-9\[#]")
_REFERENCE_ONLY = re.compile(r",|G[ \t]*0*1[0-9]{3}(?![0-9])")
_EXPONENT = re.compile(r"E[-+]?[0-9]+")
# codes with a word E of their own
_IO_CODE = re.compile(r"M[ \t]*0*6[678](?![0-9])")
_CHECKSUM = re.compile(r"\*[0-9]+[ \t]*\Z")
# codes that take all words of their line
_WHOLE_LINE = {**RETRACTING, **{code: code for code in (*FACTORS, *ADVANCE, *BED_MESH)}}
_RETRACTING = re.compile(r"(?:G[ \t]*0*1[01]|M[ \t]*0*20[78])(?![0-9]|\.0*[1-9])")
# words of M200 with which E stays a length
_LENGTH = re.compile(r"(?:[DS]0*\.?0*)?(?:T0)?")
# waits for somebody; M400 alone waits for the motion
_PAUSE_OF_BAMBU = re.compile(r"M400[ \t]+U[ \t]*0*1\b")
_FACTOR = re.compile(r"M[ \t]*0*22[01](?![0-9]|\.0*[1-9])")
_ADVANCE = re.compile(r"M[ \t]*0*(?:900|572)(?![0-9]|\.0*[1-9])")
_BED_MESH = re.compile(r"(?:G[ \t]*0*29|M[ \t]*0*420)(?![0-9]|\.0*[1-9])")

# commands to firmware begin with one of these
_FIRMWARE = "$!?~"
_OWN_LINE = "give each a line of its own"
_COMPUTES = "the program computes: expressions, parameters and O-words are not read here"
_COMPUTES_OTHERWISE = "the program computes in the language of another controller than LinuxCNC"


class ProfileReader:
    """Reads the lines of one program."""

    def __init__(self, dialect: Dialect) -> None:
        self._dialect = dialect
        self._sorter = WordSorter(dialect)
        self._axes = axis_letters(dialect)

    def read(self, text: str, number: int) -> ParsedLine:
        """Parse a line; faults are stored in `ParsedLine.faults`."""
        if number == 1:
            text = text.removeprefix(BOM)
        if self._dialect.reference:
            return self._read_reference(text, number)
        # CR CR LF in files that went through several systems, Ctrl-Z at the end of DOS files
        text = text.rstrip("\r\x1a")
        code = _blank(text).upper()
        if not code.strip():
            return _line(number, text, code, [], FaultList(number), ProfileWords(ignored=logging_of(text)))
        return self._read(text, code, number) or scan_line(text, number)

    def _read_reference(self, text: str, number: int) -> ParsedLine:
        """Parse a line of the reference's dialect; as a profile's only if the reference cannot read it."""
        parsed = scan_line(text, number)
        if not parsed.faults:
            return parsed
        code = _blank(text).upper()
        widened = self._read(text, code, number) if code.strip() else None
        if widened is None or widened.profile is None:
            return parsed
        words = widened.profile
        widens = words.actions or words.ignored or any(each.code == "MC153" for each in widened.faults)
        return widened if widens or (self._dialect.letters and not widened.faults) else parsed

    def _read(self, text: str, code: str, number: int) -> ParsedLine | None:
        """Parse a line with code; None for syntax of the reference only: comma groups and axis commands."""
        faults = FaultList(number)

        def nothing(*ignored: str) -> ParsedLine:
            return _line(number, text, code, [], faults, ProfileWords(ignored=ignored))

        if self._dialect.profile == "printer":
            code = _PAUSE_OF_BAMBU.sub(lambda match: "M226".ljust(len(match[0])), code)
        stripped = code.lstrip()
        if stripped.startswith("%") and self._dialect.profile != "printer":
            return None
        if stripped.startswith("%") or _PROGRAM_NUMBER.match(code):
            return nothing()
        head = _HEAD.match(code)
        if head is not None:
            name = code_name(head[1], float(head[2]))
            family = name.partition(".")[0]
            # M1000 and above are vendors' own
            own = head[1] == "M" and float(head[2]) >= 1000.0
            idle = own or head[1] == "T" or name in self._sorter.ignored or family in self._sorter.ignored
            idle = idle or (
                name == VOLUMETRIC and _LENGTH.fullmatch(code[head.end() :].replace(" ", "")) is not None
            )
            span = (head.start(1) + 1, head.end() + 1)
            if head[1] == "T" and self._sorter.refuse_tool(name, float(head[2]), span, faults):
                return nothing()
            if idle and name not in self._sorter.acting and self._dialect.profile == "printer":
                # the text of M117 is read from the line (D-76)
                return nothing() if family == "M117" else nothing(name)
            if name in FILES_OF_PRINTERS and self._dialect.profile == "printer":
                # its words are a file name
                self._sorter.refuse(Word("M", float(head[2]), head[2], -1, span), name, faults)
                return nothing()
        said = DISPLAY.match(code) if self._dialect.profile == "printer" else None
        if said is not None:
            code = code[: said.start(1)] + " " * (len(code) - said.start(1))
        macro = _MACRO.match(code)
        if macro is not None and macro[1] not in ("IF", "WHILE"):
            span = (macro.start(1) + 1, macro.end(1) + 1)
            if macro[1] == KLIPPER_ADVANCE and self._dialect.leads:
                given = klipper_words(code, macro.end(1), faults)
                action = Action(macro[1], span, given)
                return _line(number, text, code, [], faults, ProfileWords((action,)))
            if self._dialect.mesh_axis is not None:
                found = bed_mesh_macro(macro[1], code, span, faults)
                if found is not None or faults.found:
                    own = () if found is None else (found,)
                    return _line(number, text, code, [], faults, ProfileWords(own))
            if HARMLESS_MACRO.match(macro[1]) or macro[1] in self._dialect.ignore:
                return nothing(macro[1])
            faults.add(
                "MC145",
                f"{macro[1]} is a macro of another controller",
                span,
                "it moves the tool, or what counts behind it: let the slicer write what it does"
                if MOVING_MACRO.match(macro[1])
                else f'if it may go without effect, list it in the machine file: ignore = ["{macro[1]}"]',
            )
            return nothing()
        corner = _CORNER.search(code) if self._dialect.profile == "cnc" else None
        if corner is not None:
            # as a comma group it would move an axis
            faults.add(
                "MC141",
                f",{corner[1]} is Fanuc's word for a corner or a line's direction, which is not made here",
                (corner.start() + 1, corner.end() + 1),
                "let the post write the moves out; in a group of its own an axis needs its code in front",
            )
            return nothing()
        if _REFERENCE_ONLY.search(code):
            return None
        # settings of firmware, such as $110=500, are not expressions
        if stripped[0] not in _FIRMWARE and _COMPUTED.search(code):
            shown = _COMPUTES_OTHERWISE if self._dialect.profile == "cnc" else _COMPUTES
            faults.add("MC140", shown, (1, len(code.rstrip()) + 1), "let the post write plain numbers")
            return nothing()
        prose = _PROSE.search(code)
        if prose is not None:
            shown = f"{prose[0]} is no word of a program: is the line the rest of a comment?"
            faults.add(
                "MC103", shown, (prose.start() + 1, prose.end() + 1), "put ; before it, or take it out"
            )
            return nothing()
        code = _CHECKSUM.sub(lambda match: " " * len(match[0]), code)
        retracting = self._dialect.extruder is not None and _RETRACTING.search(code)
        leading = self._dialect.leads and _ADVANCE.search(code)
        code = without_curve(code) if leading else code
        meshing = self._dialect.mesh_axis is not None and _BED_MESH.search(code)
        if retracting or leading or meshing or (self._dialect.profile == "printer" and _FACTOR.search(code)):
            return self._whole_line(text, code, number, faults)
        words, profile = self._sorter.sort(self._words(code, faults), code, faults)
        return _line(number, text, code, words, faults, profile)

    def _whole_line(self, text: str, code: str, number: int, faults: FaultList) -> ParsedLine:
        """Parse a retraction, its settings, or a factor, which take all words of the line, also Z F B."""
        words = [word for word in self._words(code, faults) if word.letter != "N"]
        actions: tuple[Action, ...] = ()
        ignored: tuple[str, ...] = ()
        name = code_name(words[0].letter, words[0].value) if words else ""
        others = [word for word in words if word.letter in "GM"][name in _WHOLE_LINE :]
        if others:
            shown = f"{others[0].letter}{others[0].text}"
            beside = f"{name} beside it" if name in _WHOLE_LINE else "another code in its line"
            faults.add("MC153", f"{shown}: {beside} takes all words", others[0].span, _OWN_LINE)
        elif name in _WHOLE_LINE:
            own = {word.letter: word for word in words[1:]}
            for word in words[1:]:
                if own[word.letter] is not word:
                    again = own[word.letter].span
                    faults.add("MC111", f"{word.letter} stands twice in one line", again, "keep one of them")
            # Marlin's fade height
            fades = name == "M420" and own.pop("Z", None) is not None
            ignored = ("Z beside M420",) if fades else ()
            actions = () if faults.found else (Action(_WHOLE_LINE[name], words[0].span, own),)
        return _line(number, text, code, [], faults, ProfileWords(actions, ignored=ignored))

    def _words(self, code: str, faults: FaultList) -> list[Word]:
        words: list[Word] = []
        # words of printers may lack their number, and texts have no brackets
        if "O" in code and self._dialect.profile != "printer" and _found_letter_o(code, faults):
            return words
        exponents = self._dialect.profile != "printer" and "E" not in self._axes and not _IO_CODE.search(code)
        for match in _TOKEN.finditer(code):
            span = (match.start() + 1, match.end() + 1)
            # E1E2 is not two words of an axis E either
            possible = match[1] == "E" or (exponents and not match[5])
            exponent = _EXPONENT.match(code, match.end()) if possible else None
            if exponent is not None:
                shown = code[match.start() : exponent.end()]
                faults.add(
                    "MC102",
                    f"numbers have no exponent here: '{shown}'",
                    (span[0], exponent.end() + 1),
                    "write the number out",
                )
                break
            if match[5] and self._dialect.profile == "printer" and match[5].isalpha():
                # G28 X: words of printers may lack their number
                own = match[5] not in INCREMENTAL_LETTERS or match[5] in self._dialect.letters
                axis = self._axes.get(match[5], -1) if own else -1
                words.append(Word(match[5], 0.0, "0", axis, span))
            elif match[5]:
                shown = re.split(r"[ \t]", code[match.start() :], maxsplit=1)[0]
                if shown.isalpha() and len(shown) == 1:
                    hint = f"write {shown}0 if zero is meant"
                    faults.add("MC102", f"{shown} has no number", span, hint)
                    break
                reason = f"{shown} is not a word of a program"
                if match[5] in _FIRMWARE:
                    reason = f"{shown} is a command to a controller's firmware, not a word of a program"
                faults.add("MC103", reason, (span[0], span[0] + len(shown)), "take the line out")
                break
            elif match[1] and match[1] in POLAR_LETTERS and self._dialect.profile != "cnc":
                faults.add(
                    "MC141",
                    f"{match[0]}: polar coordinates are read in the profile cnc",
                    span,
                    "let the post write X and Y",
                )
                break
            elif match[3]:
                words.append(Word(f"[{int(match[3])}]", float(match[4]), match[4], int(match[3]), span))
            else:
                axis = self._axes.get(match[1], -1)
                # U V W as axes of their own are not increments of X Y Z
                own = match[1] in INCREMENTAL_LETTERS and match[1] in self._dialect.letters
                words.append(Word(f"[{axis}]" if own else match[1], float(match[2]), match[2], axis, span))
        return words


def _found_letter_o(code: str, faults: FaultList) -> bool:
    """Report the first number of a line with the letter O among its digits (MC101).

    A lone O counts as a digit where only a number fits, as in ``XO``; not in O-words and program numbers.
    """
    for found in _WITH_O.finditer(code):
        digits = found[2].replace("O", "0")
        if re.fullmatch(_NUMBER, digits):
            faults.add(
                "MC101",
                f"'{found[0]}' holds the letter O where the digit 0 belongs",
                (found.start() + 1, found.end() + 1),
                f"write {found[1]}{digits}",
                edit=Edit(found.start(2) + 1, found.end(2) + 1, digits),
            )
            return True
    return False


def _blank(text: str) -> str:
    """Replace comments, including nested and unclosed ones, by blanks, so that columns stay."""
    if "(" not in text and ";" not in text:
        return text
    before = ""
    while before != text:
        before = text
        text = _COMMENT.sub(lambda match: " " * len(match[0]), text)
    start = text.find("(")
    return text if start < 0 else text[:start] + " " * (len(text) - start)


def _line(
    number: int,
    text: str,
    code: str,
    words: list[Word],
    faults: FaultList,
    profile: ProfileWords,
) -> ParsedLine:
    tokens = [
        (word.letter if word.axis < 0 or word.letter in AXIS_LETTERS else f"[{word.axis}]", word.text, "")
        for word in words
    ]
    return ParsedLine(number, text, Scan(code, tokens, [word.span for word in words]), faults, profile)


Reader = Callable[[str, int], ParsedLine]


def reader_of(dialect: Dialect) -> Reader:
    """Return the parser for a machine's dialect."""
    return scan_line if dialect.strict else ProfileReader(dialect).read
