"""Sort the words of a profile's line into RS-274's order of execution, and assign them to codes (D-61)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

import msgspec

from mcserver.gcode.line_faults import FaultList, Span
from mcserver.gcode.profiles.codes import (
    DRILLING,
    IGNORED,
    IO_WORDS,
    MOTIONS,
    OWN_WORDS,
    PRINTER_WORDS,
    PROBING,
    PROGRAM,
    REFUSED,
    RIGID_TAPS,
    SET_OUTPUTS,
    SILENT,
    SPINDLE,
    TAKES_AXES,
    TILTING,
    acting_of,
    code_name,
    settings_of,
)
from mcserver.gcode.text.profile_words import Action, ProfileWords
from mcserver.gcode.text.profile_words import ProfileWord as Word
from mcserver.gcode.text.words import INCREMENTAL_LETTERS
from mcserver.machine.dialect_section import Dialect

_GEOMETRY_OR_SPEED = re.compile(r"[XYZUWS]")
_GEOMETRY = re.compile(r"[XYZIJK]")
_CYCLE_WORDS = re.compile(r"[PQUWDIR]")
# Haas's hole patterns if L, the count of holes, is given; else turning cycles
_HOLES = frozenset({"G70", "G71", "G72"})
_COUNT = re.compile(r"L")
# inch and millimetre in DIN 66025, if the line has no words of a turning cycle
_DIN_UNITS = {"G70": "20", "G71": "21"}

_OWN_LINE = "give each a line of its own"
# axis whose word each of LinuxCNC's polar words replaces (D-96)
POLAR_LETTERS: Final[Mapping[str, int]] = MappingProxyType({"@": 0, "^": 1})


class WordSorter:
    """Sorts the words of the lines of one program.

    Attributes:
        acting: codes that act. ignored: codes without effect.
    """

    def __init__(self, dialect: Dialect) -> None:
        self._dialect = dialect
        self._settings = settings_of(dialect.profile)
        self.acting = acting_of(dialect) | dialect.mapped
        if dialect.channels:
            self.acting |= IO_WORDS.keys()
        if dialect.probes:
            self.acting |= PROBING
        self.ignored = IGNORED[dialect.profile] | dialect.ignore
        if dialect.profile != "reference" and not dialect.channels:
            self.ignored |= SET_OUTPUTS
        self._incremental = dialect.profile in ("reference", "robot")  # U V W are increments of X Y Z
        self._tools = dialect.profile in ("reference", "robot")  # T means the reference's tool

    def sort(self, words: list[Word], code: str, faults: FaultList) -> tuple[list[Word], ProfileWords]:
        """Sort the words of a line.

        Returns:
            Words of the reference's grammar in order, and the actions of the profile.
        """
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
        for word in words:
            if word.letter == "N":
                continue
            if word.letter in "GM":
                name = code_name(word.letter, word.value)
                last = word
                if name in self._settings or name == "G61.1":
                    settings.append(word if name != "G61.1" else msgspec.structs.replace(word, text="61"))
                elif name in _HOLES and self._dialect.profile == "cnc" and _COUNT.search(code):
                    shown = f"holes on a circle or a line ({name} of Haas's mills) are not placed here"
                    faults.add("MC141", shown, word.span, "let the post write X and Y of each hole")
                elif name in _DIN_UNITS and self._dialect.profile == "cnc" and not _CYCLE_WORDS.search(code):
                    settings.append(msgspec.structs.replace(word, text=_DIN_UNITS[name]))
                elif name in RIGID_TAPS and self._dialect.profile == "cnc":
                    codes.append(msgspec.structs.replace(word, value=RIGID_TAPS[name]))
                elif name == "G0" and self._dialect.profile == "printer":
                    # printers' firmware moves alike with both (D-61)
                    motions.append(msgspec.structs.replace(word, text="1", value=1.0))
                elif name in MOTIONS:
                    motions.append(word)
                elif name in PROGRAM:
                    stops.append(word if name != "M60" else msgspec.structs.replace(word, text="00"))
                elif name == "G50" and _GEOMETRY_OR_SPEED.search(code):
                    self.refuse(word, name, faults)
                elif name in ("G5", "G5.1") and not _GEOMETRY.search(code):
                    # without X and Y, G5 P10000 and G5.1 Q1 are Fanuc's lookahead, not splines
                    ignored.append(name)
                elif name == "G8" and "P" in code:
                    # Fanuc's lookahead, as G5 P10000
                    ignored.append(name)
                elif name == "G53" and name in self.acting:
                    machine_frame = True
                elif name in self.acting or (name in SILENT and self._dialect.profile != "reference"):
                    codes.append(word)
                elif name in self.ignored:
                    ignored.append(name)
                else:
                    compensated = compensated or name in ("G41", "G42")
                    self.refuse(word, name, faults)
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
        loose += _as_axis_words(polar, codes, loose, machine_frame, faults)
        tilting = TILTING & {code_name(word.letter, word.value) for word in words if word.letter == "G"}
        if faults.found:
            # only report the fault found: keep what sets modal state, drop the words that depended on it
            known = [*settings, *feeds, *(motions + loose if compensated and motions else [])]
            return known, ProfileWords(ignored=tuple(ignored), tilting=tilting)
        taken = self._io_words(codes, own, loose, faults)
        self._one_motion(codes, motions, machine_frame, faults)
        repeated = not (motions or taken) and self._repeats_cycle(codes, own, loose)
        if repeated:
            codes.append(msgspec.structs.replace(loose[0], letter="REPEAT"))
        names = {code_name(word.letter, word.value) for word in (*settings, *codes)}
        names |= {"REPEAT"} if repeated else set()
        if motions and "P" not in taken and not names & {"G4", "G28", "G30"}:
            # P of an arc: its turns
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
        return ordered, ProfileWords(tuple(actions), machine_frame, tuple(ignored), bool(polar), tilting)

    def _io_words(
        self, codes: list[Word], own: list[Word], loose: list[Word], faults: FaultList
    ) -> frozenset[str]:
        """Give I/O codes their words, whose letters may be axes elsewhere.

        Returns:
            Letters taken by M62 to M68 in this line.
        """
        letters: set[str] = set()
        first: Word | None = None
        for word in codes:
            name = code_name(word.letter, word.value)
            if name in self._dialect.mapped:
                # R of M109 is a temperature that is also waited for when cooling
                letters.update("SR" if name in self._dialect.waits else "S")
            if name not in self.acting or name not in IO_WORDS:
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
        """Report codes that compete for the axis words of the line.

        G0 and G1 beside G28 or G30 leave it the words and are in force afterwards (D-61), as posts write it.
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
        """Return whether a line without a motion code has words that only a canned cycle takes."""
        names = {code_name(word.letter, word.value) for word in codes}
        if self._dialect.profile != "cnc" or names & (TAKES_AXES | {"G4", "M19"}):
            return False
        return bool(loose) and any(word.letter in "PQL" for word in own)

    def _actions(
        self, codes: list[Word], own: list[Word], loose: list[Word], faults: FaultList, others: bool
    ) -> list[Action]:
        """Give each acting code its words, removing axis words from ``loose``."""
        actions: list[Action] = []
        words = {word.letter: word for word in own}
        names = {code_name(word.letter, word.value) for word in codes}
        for position, word in enumerate(own):
            if any(word.letter == each.letter for each in own[:position]) and not names & IO_WORDS.keys():
                faults.add("MC111", f"{word.letter} stands twice in one line", word.span, "keep one of them")
        # S of G4 is the time on printers
        dwells = self._dialect.profile == "printer" and "G4" in names
        speeds = not (dwells or names & (self._dialect.mapped - SPINDLE))
        for word in own:
            if word.letter == "T" and self.refuse_tool(
                code_name("T", word.value), word.value, word.span, faults
            ):
                continue
            if word.letter == "T" or (word.letter == "S" and speeds):
                actions.append(Action(word.letter, word.span, {word.letter: word}))
        for word in sorted(codes, key=_precedence):
            name = "REPEAT" if word.letter == "REPEAT" else code_name(word.letter, word.value)
            if name in SILENT and name not in self.acting:
                continue
            taken = dict(words)
            axes: tuple[Word, ...] = ()
            if name == "G10" and "L" not in words:
                self.refuse(word, name, faults)
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
            # G4 X2.5 is a dwell; with P or a motion, X is a target
            if name == "G4" and "P" not in words and not others:
                taken.update({each.letter: each for each in loose if each.letter == "X"})
                loose[:] = [each for each in loose if each.letter != "X"]
            if name == "M19":
                taken.update({each.letter: each for each in loose if each.letter == "R"})
                loose[:] = [each for each in loose if each.letter != "R"]
            actions.append(Action(name, word.span, taken, axes))
        return actions

    def _unused(self, own: list[Word], names: set[str], ignored: list[str], faults: FaultList) -> None:
        """Report words that no code of the line takes; E without an extruder has no effect."""
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

    def refuse_tool(self, name: str, number: float, span: Span, faults: FaultList) -> bool:
        """Report a T for an extruder that the printer lacks; return whether it was one."""
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

    def refuse(self, word: Word, name: str, faults: FaultList) -> None:
        """Report a code that is not in the profile."""
        # a printer's M98 is not Fanuc's
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
                # a G-code may move, or change where the tool's point is: no hint to leave it out
                f'if it may go without effect, list it in the machine file: [dialect] ignore = ["{name}"]'
                if word.letter == "M"
                else "let the post write what the profile reads",
            )


def _as_axis_words(
    polar: Sequence[Word],
    codes: Sequence[Word],
    words: Sequence[Word],
    machine_frame: bool,
    faults: FaultList,
) -> list[Word]:
    """Return words @ and ^ as X and Y, which are then read as radius and angle; empty after a fault (MC153).

    Args:
        codes, words: of their line, the latter with axes. machine_frame: G53 is one of its codes.
    """
    if not polar:
        return []
    axes = {POLAR_LETTERS[word.letter]: word for word in polar}
    takers = {code_name(word.letter, word.value) for word in codes} & TAKES_AXES
    others = sorted(takers - DRILLING - PROBING - {"REPEAT"}) + ["G53"] * machine_frame
    if len(axes) < len(polar) or any(word.axis in (0, 1) for word in words) or others:
        # the second of two equal letters, or any
        word = polar[-1]
        faults.add(
            "MC153",
            f"{word.letter}{word.text} does not go together with {others[0] if others else 'X and Y'}",
            word.span,
            "@ and ^ are a move's radius and angle, in place of X and Y",
        )
        return []
    return [
        msgspec.structs.replace(word, letter="XY"[axis], axis=axis) for axis, word in sorted(axes.items())
    ]


def _strays(own: list[Word], names: set[str], beside: str) -> list[str]:
    """Name words that codes without effect do not take: they could have meant something."""
    taken = "".join(OWN_WORDS.get(name, "") for name in names)
    return [
        f"{word.letter} beside {beside}" for word in own if word.letter in "DHQL" and word.letter not in taken
    ]


def _precedence(word: Word) -> int:
    """Return a code's rank in RS-274's order of execution (D-61)."""
    name = code_name(word.letter, word.value)
    if name in IO_WORDS:
        return 0
    if word.letter == "M":
        return {"M6": 1, "M61": 1, "M600": 1, "M3": 2, "M4": 2, "M5": 2, "M82": 5, "M83": 5}.get(name, 3)
    return 4 if name == "G4" else 5
