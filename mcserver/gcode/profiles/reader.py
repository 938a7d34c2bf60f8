"""Read a line of a profile's programs (D-60, D-61).

RS-274's words in any order become a line of the reference's grammar, and actions for the codes that the
reference does not have.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import msgspec

from mcserver.gcode.line_faults import FaultList, Span
from mcserver.gcode.notices import DISPLAY, logging_of
from mcserver.gcode.profiles.codes import (
    FACTORS,
    FILES_OF_PRINTERS,
    HARMLESS_MACRO,
    IGNORED,
    IO_WORDS,
    MOTIONS,
    MOVING_MACRO,
    OWN_WORDS,
    PRINTER_WORDS,
    PROBING,
    PROGRAM,
    REFUSED,
    RETRACTING,
    RIGID_TAPS,
    SET_OUTPUTS,
    SETTINGS,
    SILENT,
    SPINDLE,
    TAKES_AXES,
    VOLUMETRIC,
    acting_of,
    code_name,
)
from mcserver.gcode.profiles.letter_o import found_letter_o
from mcserver.gcode.profiles.polar_words import POLAR_LETTERS, as_axis_words
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
    r"[#=<>]|[A-Z@^][ \t]*[-+]?[ \t]*\[|\][ \t]*\[|\b(?:IF|WHILE|GOTO|CALL|SUB|ENDSUB)\b|O[ \t]*<"
    r"|\A[ \t]*(?:N[0-9]+[ \t]*)?O[ \t]*[0-9]+[ \t]*[A-Z]"
)
_PROGRAM_NUMBER = re.compile(r"[ \t]*[O:][ \t]*[0-9]+[ \t]*\Z")
_MACRO = re.compile(r"[ \t]*([A-Z_][A-Z_]{2,}[A-Z0-9_]*)(?![0-9.+-])")
# words of a language; codes have no four letters in a row
_PROSE = re.compile(r"[A-Z]{4,}")
_HEAD = re.compile(r"[ \t]*(?:N[0-9]+[ \t]*)?([GMT])[ \t]*([0-9]+(?:\.[0-9]+)?)")
# Fanuc's corners and directions of a line: ,C5 ,R3 ,A45
_CORNER = re.compile(r",[ \t]*([ACR])[ \t]*[-+.0-9\[#]")
_REFERENCE_ONLY = re.compile(r",|G[ \t]*0*1[0-9]{3}(?![0-9])")
_EXPONENT = re.compile(r"E[-+]?[0-9]+")
# take words E of their own
_IO_CODE = re.compile(r"M[ \t]*0*6[678](?![0-9])")
_CHECKSUM = re.compile(r"\*[0-9]+[ \t]*\Z")
_GEOMETRY_OR_SPEED = re.compile(r"[XYZUWS]")
_GEOMETRY = re.compile(r"[XYZIJK]")
# take all words of their line
_WHOLE_LINE = {**RETRACTING, **{code: code for code in FACTORS}}
_RETRACTING = re.compile(r"(?:G[ \t]*0*1[01]|M[ \t]*0*20[78])(?![0-9]|\.0*[1-9])")
# what may stand behind M200 where E stays a length
_LENGTH = re.compile(r"(?:[DS]0*\.?0*)?(?:T0)?")
# waits for somebody, where M400 alone waits for the motion
_PAUSE_OF_BAMBU = re.compile(r"M400[ \t]+U[ \t]*0*1\b")
_FACTOR = re.compile(r"M[ \t]*0*22[01](?![0-9]|\.0*[1-9])")
_CYCLE_WORDS = re.compile(r"[PQUWDIR]")
# Haas's patterns of holes, beside the number of these; else turning cycles
_HOLES = frozenset({"G70", "G71", "G72"})
_COUNT = re.compile(r"L")
# inches and millimetres in DIN 66025, where no words of a turning cycle stand beside them
_DIN_UNITS = {"G70": "20", "G71": "21"}

# commands to firmware begin with one of these
_FIRMWARE = "$!?~"
_OWN_LINE = "give each a line of its own"
_COMPUTES = "the program computes: expressions, parameters and O-words are not read here"
_COMPUTES_OTHERWISE = "the program computes in the language of another controller than LinuxCNC"


class ProfileReader:
    """Reads the lines of one program."""

    def __init__(self, dialect: Dialect) -> None:
        self._dialect = dialect
        self._acting = acting_of(dialect) | dialect.mapped
        if dialect.channels:
            self._acting |= IO_WORDS.keys()
        if dialect.probes:
            self._acting |= PROBING
        self._incremental = dialect.profile in ("reference", "robot")  # U V W are X Y Z as increments
        self._ignored = IGNORED[dialect.profile] | dialect.ignore
        if dialect.profile != "reference" and not dialect.channels:
            self._ignored |= SET_OUTPUTS
        self._axes = axis_letters(dialect)
        self._tools = dialect.profile in ("reference", "robot")  # T means the reference's tool

    def read(self, text: str, number: int) -> ParsedLine:
        """Parse a line; faults are kept in `ParsedLine.faults`."""
        if number == 1:
            text = text.removeprefix(BOM)
        if self._dialect.reference:
            return self._read_reference(text, number)
        # files that went through several systems have CR CR LF, and those of DOS end with Ctrl-Z
        text = text.rstrip("\r\x1a")
        code = _blank(text).upper()
        if not code.strip():
            return _line(number, text, code, [], FaultList(number), ProfileWords(ignored=logging_of(text)))
        return self._read(text, code, number) or scan_line(text, number)

    def _read_reference(self, text: str, number: int) -> ParsedLine:
        """Parse a line of the reference's own dialect: only what it cannot read is a profile's."""
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
        """Parse a line with code; None for what only the reference has: comma groups and axis commands."""
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
            # M1000 and above are the makers' own
            own = head[1] == "M" and float(head[2]) >= 1000.0
            idle = own or head[1] == "T" or name in self._ignored or family in self._ignored
            idle = idle or (
                name == VOLUMETRIC and _LENGTH.fullmatch(code[head.end() :].replace(" ", "")) is not None
            )
            if head[1] == "T" and self._no_tool(
                name, float(head[2]), (head.start(1) + 1, head.end() + 1), faults
            ):
                return nothing()
            if idle and name not in self._acting and self._dialect.profile == "printer":
                # what M117 shows is read from the text (D-76)
                return nothing() if family == "M117" else nothing(name)
            if name in FILES_OF_PRINTERS and self._dialect.profile == "printer":
                # its words are the name of a file
                span = (head.start(1) + 1, head.end() + 1)
                self._refuse(Word("M", float(head[2]), head[2], -1, span), name, faults)
                return nothing()
        said = DISPLAY.match(code) if self._dialect.profile == "printer" else None
        if said is not None:
            code = code[: said.start(1)] + " " * (len(code) - said.start(1))
        macro = _MACRO.match(code)
        if macro is not None and macro[1] not in ("IF", "WHILE"):
            if HARMLESS_MACRO.match(macro[1]) or macro[1] in self._dialect.ignore:
                return nothing(macro[1])
            faults.add(
                "MC145",
                f"{macro[1]} is a macro of another controller",
                (macro.start(1) + 1, macro.end(1) + 1),
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
        # settings of firmware, such as $110=500, compute nothing
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
        if retracting or (self._dialect.profile == "printer" and _FACTOR.search(code)):
            return self._whole_line(text, code, number, faults)
        return self._sort(text, code, number, faults)

    def _no_tool(self, name: str, number: float, span: Span, faults: FaultList) -> bool:
        """Report a T of another extruder than the one that a printer has; return True then."""
        if self._dialect.profile != "printer" or number == 0.0 or name in self._dialect.ignore:
            return False
        faults.add(
            "MC143",
            f"this printer has no {name}: it has one extruder, T0",
            span,
            "let the slicer write for one extruder; "
            f'if it may go without effect, list it in the machine file: [dialect] ignore = ["{name}"]',
        )
        return True

    def _whole_line(self, text: str, code: str, number: int, faults: FaultList) -> ParsedLine:
        """Give a retraction, what sets it, or a factor all words of the line: Z, F and B are its own."""
        words = [word for word in self._words(code, faults) if word.letter != "N"]
        actions: tuple[Action, ...] = ()
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
            actions = () if faults.found else (Action(_WHOLE_LINE[name], words[0].span, own),)
        return _line(number, text, code, [], faults, ProfileWords(actions))

    def _sort(self, text: str, code: str, number: int, faults: FaultList) -> ParsedLine:
        """Sort words into RS-274's order of execution and hand each code its own words."""
        settings: list[Word] = []
        feeds: list[Word] = []
        motions: list[Word] = []
        stops: list[Word] = []
        loose: list[Word] = []
        codes: list[Word] = []
        own: list[Word] = []
        ignored: list[str] = []
        machine_frame = compensated = False
        polar: list[Word] = []
        last: Word | None = None
        tolerances: list[Word] = []
        for word in self._words(code, faults):
            if word.letter == "N":
                continue
            if word.letter in "GM":
                name = code_name(word.letter, word.value)
                last = word
                if name in SETTINGS or name == "G61.1":
                    settings.append(word if name != "G61.1" else msgspec.structs.replace(word, text="61"))
                elif name in _HOLES and self._dialect.profile == "cnc" and _COUNT.search(code):
                    shown = f"holes on a circle or a line ({name} of Haas's mills) are not placed here"
                    faults.add("MC141", shown, word.span, "let the post write X and Y of each hole")
                elif name in _DIN_UNITS and self._dialect.profile == "cnc" and not _CYCLE_WORDS.search(code):
                    settings.append(msgspec.structs.replace(word, text=_DIN_UNITS[name]))
                elif name in RIGID_TAPS and self._dialect.profile == "cnc":
                    codes.append(msgspec.structs.replace(word, value=RIGID_TAPS[name]))
                elif name == "G0" and self._dialect.profile == "printer":
                    # firmware of printers moves both alike (D-61)
                    motions.append(msgspec.structs.replace(word, text="1", value=1.0))
                elif name in MOTIONS:
                    motions.append(word)
                elif name in PROGRAM:
                    stops.append(word if name != "M60" else msgspec.structs.replace(word, text="00"))
                elif name == "G50" and _GEOMETRY_OR_SPEED.search(code):
                    self._refuse(word, name, faults)
                elif name in ("G5", "G5.1") and not _GEOMETRY.search(code):
                    # G5 P10000 and G5.1 Q1 are Fanuc's lookahead; with X and Y they are splines
                    ignored.append(name)
                elif name == "G8" and "P" in code:
                    # Fanuc's lookahead, as G5 P10000
                    ignored.append(name)
                elif name == "G53" and name in self._acting:
                    machine_frame = True
                elif name in self._acting or (name in SILENT and self._dialect.profile != "reference"):
                    codes.append(word)
                elif name in self._ignored:
                    ignored.append(name)
                else:
                    compensated = compensated or name in ("G41", "G42")
                    self._refuse(word, name, faults)
            elif word.letter == "F":
                feeds.append(word)
            elif word.letter in POLAR_LETTERS:
                polar.append(word)
            elif word.letter == "T" and self._tools:
                settings.append(word)
            elif (
                word.letter == "P"
                and last is not None
                and code_name("G", last.value) == "G64"
                and last.letter == "G"
            ):
                tolerances.append(word)
            elif word.letter in INCREMENTAL_LETTERS and word.axis >= 0 and not self._incremental:
                faults.add(
                    "MC112",
                    f"{word.letter} is no axis of this machine",
                    word.span,
                    f"name it in the machine file: [dialect] letters = {{ {word.letter} = 6 }}",
                )
            elif word.axis >= 0 or word.letter in "IJKR":
                loose.append(word)
            else:
                own.append(word)
        loose += as_axis_words(polar, codes, loose, machine_frame, faults)
        if faults.found:
            # what is left of such a line would only be blamed for it; what stays in force is still known
            known = [*settings, *feeds, *(motions + loose if compensated and motions else [])]
            return _line(number, text, code, known, faults, ProfileWords(ignored=tuple(ignored)))
        taken = self._io_words(codes, own, loose, faults)
        self._one_motion(codes, motions, machine_frame, faults)
        repeated = not (motions or taken) and self._repeats_cycle(codes, own, loose)
        if repeated:
            codes.append(msgspec.structs.replace(loose[0], letter="REPEAT"))
        names = {code_name(word.letter, word.value) for word in (*settings, *codes)}
        names |= {"REPEAT"} if repeated else set()
        if motions and "P" not in taken and not names & {"G4", "G28", "G30"}:
            # of an arc: the turns
            loose += [word for word in own if word.letter == "P"]
            own = [word for word in own if word.letter != "P"]
        if not ignored:
            self._unused(own, names, ignored, faults)
        else:
            ignored += _strays(own, names | set(ignored), ignored[0])
        actions = self._actions(codes, own, loose, faults, bool(ignored or motions or tolerances))
        ordered: list[Word] = []
        for word in settings:
            ordered.append(word)
            if code_name(word.letter, word.value) == "G64":
                ordered += tolerances[:1]
        ordered += [*feeds, *motions, *loose, *stops]
        return _line(
            number,
            text,
            code,
            ordered,
            faults,
            ProfileWords(tuple(actions), machine_frame, tuple(ignored), bool(polar)),
        )

    def _words(self, code: str, faults: FaultList) -> list[Word]:
        words: list[Word] = []
        # a printer's words may lack their number, and its texts stand without brackets
        if "O" in code and self._dialect.profile != "printer" and found_letter_o(code, faults):
            return words
        exponents = self._dialect.profile != "printer" and "E" not in self._axes and not _IO_CODE.search(code)
        for match in _TOKEN.finditer(code):
            span = (match.start() + 1, match.end() + 1)
            # E1E2 is none of two words of an axis E either
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
                # G28 X: printers' words may lack their number
                own = match[5] not in INCREMENTAL_LETTERS or match[5] in self._dialect.letters
                axis = self._axes.get(match[5], -1) if own else -1
                words.append(Word(match[5], 0.0, "0", axis, span))
            elif match[5]:
                end = re.compile(r"[^ \t]*").match(code, match.start())
                stop = match.end() if end is None else end.end()
                shown = code[match.start() : stop]
                if shown.isalpha() and len(shown) == 1:
                    hint = f"write {shown}0 if zero is meant"
                    faults.add("MC102", f"{shown} has no number", span, hint)
                    break
                reason = f"{shown} is not a word of a program"
                if match[5] in _FIRMWARE:
                    reason = f"{shown} is a command to a controller's firmware, not a word of a program"
                faults.add("MC103", reason, (span[0], stop + 1), "take the line out")
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
                # U V W as axes of their own are no increments of X Y Z
                own = match[1] in INCREMENTAL_LETTERS and match[1] in self._dialect.letters
                words.append(Word(f"[{axis}]" if own else match[1], float(match[2]), match[2], axis, span))
        return words

    def _io_words(
        self, codes: list[Word], own: list[Word], loose: list[Word], faults: FaultList
    ) -> frozenset[str]:
        """Give codes of inputs and outputs their words, which may be axis letters elsewhere.

        Returns:
            Letters that one of M62 to M68 takes in this line.
        """
        letters: set[str] = set()
        first: Word | None = None
        for word in codes:
            name = code_name(word.letter, word.value)
            if name in self._dialect.mapped:
                # R of M109 is a temperature that is waited for in falling, too
                letters.update("SR" if name in self._dialect.waits else "S")
            if name not in self._acting or name not in IO_WORDS:
                continue
            if first is not None:
                faults.add("MC153", f"{name} and another of M62 to M68 share a line", word.span, _OWN_LINE)
                return frozenset()
            first = word
            letters.update(IO_WORDS[name])
        if not letters:
            return frozenset()
        own += [word for word in loose if word.letter in letters]
        loose[:] = [word for word in loose if word.letter not in letters]
        if first is None:
            return frozenset()
        name = code_name(first.letter, first.value)
        for letter in IO_WORDS[name]:
            same = [word for word in own if word.letter == letter]
            if len(same) > 1:
                faults.add("MC153", f"{letter} stands twice beside {name}", same[1].span, _OWN_LINE)
        for word in codes:
            other = code_name(word.letter, word.value)
            if other in ("G4", "G10"):
                faults.add("MC153", f"{other} and {name} would share their words", word.span, _OWN_LINE)
        return frozenset(IO_WORDS[name])

    def _one_motion(
        self, codes: list[Word], motions: list[Word], machine_frame: bool, faults: FaultList
    ) -> None:
        """Report codes that would each take the axis words of the line.

        G0 and G1 beside G28 or G30 leave it their words and are in force behind it (D-61), as posts write it.
        """
        takers = [word for word in codes if code_name(word.letter, word.value) in TAKES_AXES]
        returning = bool(takers) and code_name(takers[0].letter, takers[0].value) in ("G28", "G30")
        if returning and not machine_frame:
            motions = [word for word in motions if code_name(word.letter, word.value) not in ("G0", "G1")]
        for word in [*takers[1:], *(motions if takers else [])]:
            first, name = (code_name(each.letter, each.value) for each in (takers[0], word))
            faults.add("MC153", f"{first} and {name} would share their words", word.span, _OWN_LINE)
        if machine_frame and takers:
            name = code_name(takers[0].letter, takers[0].value)
            faults.add("MC153", f"G53 goes with G0 and G1, not with {name}", takers[0].span, _OWN_LINE)

    def _repeats_cycle(self, codes: list[Word], own: list[Word], loose: list[Word]) -> bool:
        """Return True if a line without a motion code has words that only a canned cycle takes."""
        names = {code_name(word.letter, word.value) for word in codes}
        if self._dialect.profile != "cnc" or names & (TAKES_AXES | {"G4", "M19"}):
            return False
        return bool(loose) and any(word.letter in "PQL" for word in own)

    def _actions(
        self, codes: list[Word], own: list[Word], loose: list[Word], faults: FaultList, others: bool
    ) -> list[Action]:
        """Give each acting code the words that it takes; axis words are taken out of ``loose``."""
        actions: list[Action] = []
        words = {word.letter: word for word in own}
        names = {code_name(word.letter, word.value) for word in codes}
        for position, word in enumerate(own):
            if any(word.letter == each.letter for each in own[:position]) and not names & IO_WORDS.keys():
                faults.add("MC111", f"{word.letter} stands twice in one line", word.span, "keep one of them")
        # of printers' G4 S is the time
        dwells = self._dialect.profile == "printer" and "G4" in names
        speeds = not (dwells or names & (self._dialect.mapped - SPINDLE))
        for word in own:
            if word.letter == "T" and self._no_tool(
                code_name("T", word.value), word.value, word.span, faults
            ):
                continue
            if word.letter == "T" or (word.letter == "S" and speeds):
                actions.append(Action(word.letter, word.span, {word.letter: word}))
        for word in sorted(codes, key=_precedence):
            name = "REPEAT" if word.letter == "REPEAT" else code_name(word.letter, word.value)
            if name in SILENT and name not in self._acting:
                continue
            taken = dict(words)
            axes: tuple[Word, ...] = ()
            if name == "G10" and "L" not in words:
                self._refuse(word, name, faults)
                continue
            if name in TAKES_AXES:
                axes = tuple(each for each in loose if each.axis >= 0)
                letters = [each for each in loose if each.axis < 0]
                first = {each.letter: each for each in reversed(letters)}
                for each in letters:
                    if each is not first[each.letter]:
                        shown = f"{each.letter} stands twice in one command"
                        faults.add("MC111", shown, each.span, "keep one of them")
                taken.update(first)
                loose.clear()
            # G4 X2.5 is a dwell; beside P or a motion X is where the axis goes
            if name == "G4" and "P" not in words and not others:
                taken.update({each.letter: each for each in loose if each.letter == "X"})
                loose[:] = [each for each in loose if each.letter != "X"]
            if name == "M19":
                taken.update({each.letter: each for each in loose if each.letter == "R"})
                loose[:] = [each for each in loose if each.letter != "R"]
            actions.append(Action(name, word.span, taken, axes))
        return actions

    def _unused(self, own: list[Word], names: set[str], ignored: list[str], faults: FaultList) -> None:
        """Report words that no code of the line takes; an extruder that is not there has no effect."""
        printer = self._dialect.profile == "printer"
        taken = {"S", "T"}
        for name in names:
            taken.update(OWN_WORDS.get(name, ""), PRINTER_WORDS.get(name, "") if printer else "")
            if name in self._dialect.mapped:
                taken.add("*")
        if "*" in taken:
            return
        for word in own:
            if word.letter in taken:
                continue
            if printer and word.letter == "E":
                ignored.append("E")
                continue
            faults.add(
                "MC113",
                f"{word.letter}{word.text} belongs to no command",
                word.span,
                "take it out, or write the code that it belongs to",
            )

    def _refuse(self, word: Word, name: str, faults: FaultList) -> None:
        # Fanuc's M98 is none of a printer's
        reason = None if (self._dialect.profile, name) == ("printer", "M98") else REFUSED.get(name)
        if reason is not None:
            faults.add(
                "MC141", f"{name}: {reason.split('; ')[0]}", word.span, "; ".join(reason.split("; ")[1:])
            )
        else:
            faults.add(
                "MC110",
                f"{name} is not a code of the profile {self._dialect.profile}",
                word.span,
                # a G-code may move, or say where the tool's point is: nobody is told to leave it out
                f'if it may go without effect, list it in the machine file: [dialect] ignore = ["{name}"]'
                if word.letter == "M"
                else "let the post write what the profile reads",
            )


def _strays(own: list[Word], names: set[str], beside: str) -> list[str]:
    """Name words that a code without effect does not explain: they could have meant something."""
    taken = "".join(OWN_WORDS.get(name, "") for name in names)
    return [
        f"{word.letter} beside {beside}" for word in own if word.letter in "DHQL" and word.letter not in taken
    ]


def _precedence(word: Word) -> int:
    """Return where a code stands in RS-274's order of execution (D-61)."""
    name = code_name(word.letter, word.value)
    if name in IO_WORDS:
        return 0
    if word.letter == "M":
        return {"M6": 1, "M61": 1, "M600": 1, "M3": 2, "M4": 2, "M5": 2, "M82": 5, "M83": 5}.get(name, 3)
    return 4 if name == "G4" else 5


def _blank(text: str) -> str:
    """Replace comments by blanks, nested and unclosed ones too: columns stay."""
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
    scanned = Scan(code, tokens, [word.span for word in words])
    parsed = ParsedLine(number, text, scanned)
    parsed.profile = profile
    parsed.analyse(faults)
    return parsed


Reader = Callable[[str, int], ParsedLine]


def reader_of(dialect: Dialect) -> Reader:
    """Return what parses the lines of a program in a machine's dialect."""
    return scan_line if dialect.strict else ProfileReader(dialect).read
