"""What an editor shows about codes and words: completion and hover, from the tables and rules."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import msgspec

from mcserver.gcode.profiles.codes import CYCLE_WORDS, TAPPING
from mcserver.gcode.text.command_table import COMMANDS, CommandSpec, find_command
from mcserver.gcode.text.word_table import WORDS, WordSpec, find_word
from mcserver.gcode.text.words import AXIS_LETTERS, axis_letters
from mcserver.language.profile_codes import acting_codes, describe_profile_code, in_order
from mcserver.language.rules import rules
from mcserver.language.tables import words_of as listed_words
from mcserver.machine.machine_file import Machine
from mcserver.planning.start_state import axis_word
from mcserver.units import MM

# What the words of a canned cycle are (D-75, D-89); where nothing is said, as elsewhere.
CYCLE: tuple[WordSpec, ...] = (
    WordSpec(("R",), "the height that a canned cycle drills from and goes out to", "mm or inches", ("D-75",)),
    WordSpec(("P",), "the dwell of a canned cycle at the bottom", "by the profile", ("D-75",)),
    WordSpec(("Q",), "the depth of each peck of a canned cycle", "mm or inches", ("D-75", "D-89")),
    WordSpec(("I",), "the first peck of G73 and G83", "mm or inches", ("D-75",)),
    WordSpec(("J",), "by which each further peck is less", "mm or inches", ("D-75",)),
    WordSpec(("K",), "the least peck, or how often a canned cycle is repeated", "", ("D-75",)),
    WordSpec(("L",), "how often a canned cycle is repeated, for G91", "", ("D-75",)),
)
_NUMBER = re.compile(r"[0-9]+(?:\.[0-9]+)?")
_WORD = re.compile(r"(?P<name>[A-Za-z]|\[[ \t]*[0-9]*[ \t]*\]?)[ \t]*(?P<number>[-+0-9.]*)")
_COMMENT = re.compile(r"\([^)]*\)?|;.*", re.DOTALL)


class WordAt(msgspec.Struct, frozen=True):
    """A word as far as it is written.

    Attributes:
        name: an upper-case letter, or ``[n]``.
        number: as written, perhaps empty.
        start, end: code points from 0, end exclusive.
    """

    name: str
    number: str
    start: int
    end: int

    @property
    def is_code(self) -> bool:
        """Return True for G and M."""
        return self.name in ("G", "M")


class Suggestion(msgspec.Struct, frozen=True):
    """One completion.

    Attributes:
        label: what is inserted.
        detail: a few words beside it.
        documentation: Markdown.
        start: code point from 0 where what is written already begins.
    """

    label: str
    detail: str
    documentation: str
    start: int


def in_comment(line: str, position: int) -> bool:
    """Return True if a position lies within a comment."""
    return any(found.start() < position <= _inner_end(found) for found in _COMMENT.finditer(line))


def _inner_end(found: re.Match[str]) -> int:
    return found.end() - 1 if found[0].startswith("(") and found[0].endswith(")") else found.end()


def words_of(line: str) -> list[WordAt]:
    """Return the words of a line, without those in comments."""
    code = _COMMENT.sub(lambda found: " " * len(found[0]), line)
    return [
        WordAt(_name(found["name"]), found["number"], found.start(), found.end())
        for found in _WORD.finditer(code)
    ]


def _name(written: str) -> str:
    return re.sub(r"[ \t]", "", written) if written.startswith("[") else written.upper()


def word_at(line: str, position: int) -> WordAt | None:
    """Return the word that a position touches."""
    return next((word for word in words_of(line) if word.start <= position <= word.end), None)


def describe_code(spec: CommandSpec) -> str:
    """Describe a code in Markdown: what it does, its words, an example and its first rule."""
    example = f"```gcode\n{spec.example}\n```"
    return "\n\n".join(
        [f"**{spec.name}** {spec.title}", f"words: {listed_words(spec)}", example, describe_rules(spec.rules)]
    )


def describe_word(spec: WordSpec, machine: Machine, name: str) -> str:
    """Describe a word in Markdown, with the machine's axis if it names one."""
    unit = f" [{spec.unit}]" if spec.unit else ""
    return f"**{name}** {spec.title}{unit}{_axis_of(machine, name)}\n\n{describe_rules(spec.rules)}"


def describe_rules(names: tuple[str, ...]) -> str:
    """Quote the first rule and name the others."""
    first = rules()[names[0]]
    others = ", ".join(names[1:])
    return f"**{first.name}** {first.title}. {first.text}" + (f"\n\nSee also {others}." if others else "")


def _axis_of(machine: Machine, name: str) -> str:
    number = axis_letters(machine.dialect).get(name)
    if name.startswith("["):
        digits = name.strip("[]")
        number = int(digits) if digits.isdigit() else None
    axis = next((each for each in machine.axes if each.index == number), None)
    if axis is None:
        return ""
    unit = axis.type.unit
    low, high = axis.min_position / axis.type.si_per_unit, axis.max_position / axis.type.si_per_unit
    return f"; axis {axis.index} of {machine.name} is {axis.type.value}, {low:g} … {high:g} {unit}"


def hover(line: str, position: int, machine: Machine) -> tuple[str, int, int] | None:
    """Return Markdown for the word at a position, with its start and end; None for comments and blanks."""
    if in_comment(line, position):
        return None
    word = word_at(line, position)
    if word is None:
        return None
    if word.is_code:
        shown = describe_any_code(word.name + word.number, machine)
        return (shown, word.start, word.end) if shown else None
    further = word.name.startswith("[") or word.name in machine.dialect.letters
    known = find_word("[n]") if further else _meaning(word.name, _cycle_of(words_of(line), machine))
    return None if known is None else (describe_word(known, machine, word.name), word.start, word.end)


def _cycle_of(words: Sequence[WordAt], machine: Machine) -> str:
    """Return the canned cycle that a line has, such as G81; empty: none."""
    acting = acting_codes(machine)
    codes = (
        f"G{float(each.number):g}" for each in words if each.name == "G" and _NUMBER.fullmatch(each.number)
    )
    return next((each for each in codes if each in CYCLE_WORDS and each in acting), "")


def _meaning(letter: str, cycle: str) -> WordSpec | None:
    """Return what a word is in a line with a canned cycle, or in one without; None: nothing."""
    own = next((each for each in CYCLE if letter in each.letters), None)
    return own if cycle and own is not None else find_word(letter)


def describe_letter(letter: str, machine: Machine) -> str:
    """Describe a word in Markdown by all its meanings on a machine; empty: it has none."""
    cycles = [""] if CYCLE_WORDS.keys().isdisjoint(acting_codes(machine)) else ["", "G81"]
    found = dict.fromkeys(_meaning(letter, cycle) for cycle in cycles)
    return "\n\n".join(describe_word(each, machine, letter) for each in found if each is not None)


def complete(line: str, position: int, machine: Machine) -> list[Suggestion]:
    """Return what may be written at a position: codes, and the words of the code before it."""
    if in_comment(line, position):
        return []
    before = line[:position]
    word = next((each for each in words_of(before) if each.end == position), None)
    if word is not None and word.is_code:
        written = word.name + word.number
        return list(_codes(word.start, word.name, written, machine))
    if word is not None:
        return list(_tools(word.start, machine)) if word.name == "T" else []
    return [*_codes(position, "", "", machine), *_words(before, position, machine)]


def _codes(start: int, letter: str, written: str, machine: Machine) -> Iterator[Suggestion]:
    """Suggest codes of the reference, and those that act in the machine's profile."""
    known = set()
    for spec in COMMANDS:
        short = spec.letter + str(spec.number)
        known.add(short)
        if spec.name.startswith(letter) and (spec.name.startswith(written) or short.startswith(written)):
            yield Suggestion(spec.name, spec.title, describe_any_code(short, machine), start)
    if machine.dialect.profile == "reference":
        return
    for code in in_order(acting_codes(machine) - known):
        if code.startswith(letter) and code.startswith(written):
            described = describe_profile_code(code, machine)
            yield Suggestion(code, _title_of(described), described, start)


def describe_any_code(code: str, machine: Machine) -> str:
    """Describe a code of the reference or of the machine's profile in Markdown; empty: it is none."""
    spec = find_command(code[:1].upper(), code[1:])
    parts = ["" if spec is None else describe_code(spec), describe_profile_code(code, machine)]
    return "\n\n".join(part for part in parts if part)


def _title_of(described: str) -> str:
    """Return the title of the first rule that describes a code of a profile."""
    found = re.search(r"\*\*D-[0-9a-z]+\*\* ([^.]*)\.", described)
    return found[1] if found is not None else ""


def _tools(start: int, machine: Machine) -> Iterator[Suggestion]:
    for number, cutter in sorted(machine.dialect.cutters.items()):
        yield Suggestion(
            f"T{number}", f"length {cutter.length / MM:g}, diameter {cutter.diameter / MM:g} mm", "", start
        )
    for tool in machine.tools:
        axes = ", ".join(map(str, tool.axes))
        yield Suggestion(f"T{tool.number}", f"frame {tool.frame}, axes {axes}", "", start)


def _words(before: str, start: int, machine: Machine) -> Iterator[Suggestion]:
    """Suggest the words of the last code before the position that the line does not have yet."""
    written = words_of(before)
    spec = next(
        (
            found
            for each in reversed(written)
            if each.is_code and (found := find_command(each.name, each.number))
        ),
        None,
    )
    taken = {each.name for each in written}
    letters = spec.words if spec is not None else "F"
    cycle = _cycle_of(written, machine)
    if cycle:
        # a tap does not dwell
        own = CYCLE_WORDS[cycle].replace("P", "") if cycle in TAPPING else CYCLE_WORDS[cycle]
        for entry in CYCLE:
            if entry.letters[0] in f"RL{own}" and entry.letters[0] not in taken:
                letter = entry.letters[0]
                yield Suggestion(letter, entry.title, describe_word(entry, machine, letter), start)
    if (spec is None or "T" in spec.words) and machine.tools and "T" not in taken:
        yield from _tools(start, machine)
    if spec is None or spec.takes_axes:
        yield from _axis_words(start, machine, taken)
    for entry in WORDS:
        for letter in entry.letters:
            if letter in letters and letter not in taken and letter != "T":
                yield Suggestion(letter, entry.title, describe_word(entry, machine, letter), start)


def _axis_words(start: int, machine: Machine, taken: set[str]) -> Iterator[Suggestion]:
    for axis in machine.axes:
        name = axis_word(machine, axis.index)
        entry = find_word(name if name in AXIS_LETTERS else "[n]")
        if entry is not None and name not in taken:
            yield Suggestion(
                name, f"axis {axis.index}, {axis.type.value}", describe_word(entry, machine, name), start
            )
