"""The text of EDS and DCF files (CiA 306), as tools of thirty years have written it.

Read as Windows' profile functions read it, for which the format was made: sections and keys in any case, and
the first of two equal keys counts. Bytes are UTF-8, UTF-16 with a mark, or Windows-1252.
"""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass, field

from mcserver.errors import ConfigurationError

# A real one has a few hundred kilobytes.
MAX_BYTES = 16 * 1024 * 1024
# Values of these keys are words, in which only a semicolon behind a blank begins a comment.
_WORDS = re.compile(r"name|description|comment|line\d|createdby|modifiedby|ordercode|denotation|file|unit")
# Sections of words alone: lines that are no entries there are left out.
_PROSE = ("comments", "fileinfo", "deviceinfo")


def fault(source: str, section: str, key: str, what: str, remedy: str) -> ConfigurationError:
    """MC008: what is wrong with an EDS file, and where."""
    place = source + (f", section [{section}]" if section else "") + (f", {key}" if key else "")
    return ConfigurationError("MC008", f"{place}: {what}", remedy)


@dataclass
class Section:
    """One section: its name as written, and its entries by lower-case key (key as written, value)."""

    name: str
    line: int
    entries: dict[str, tuple[str, str]] = field(default_factory=dict)

    def text(self, key: str) -> str:
        """Return the value, empty where the key is missing or has none."""
        return self.entries.get(key.lower(), ("", ""))[1]


def decode(raw: bytes) -> str:
    """Return the text of a file's bytes; never fails."""
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return raw.decode("utf-16", errors="replace")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def sections_of(text: str, source: str) -> dict[str, Section]:
    """Sections by lower-case name without blanks.

    Raises:
        ConfigurationError: MC008 a line that is neither section, entry nor comment.
    """
    sections: dict[str, Section] = {}
    current: Section | None = None
    for number, written in enumerate(text.splitlines(), 1):
        line = written.strip().strip("\x00\x1a").strip()
        if not line or line[0] in ";#" or line.startswith("//"):
            continue
        if line.startswith("["):
            name, closed, _ = line[1:].partition("]")
            if not closed:
                raise fault(source, "", "", f"line {number}: {line!r} has no ]", "close the section's name")
            current = sections.setdefault(_plain(name), Section(name.strip(), number))
            continue
        key, equals, value = line.partition("=")
        if not equals or not key.strip():
            if current is not None and _plain(current.name) in _PROSE:
                continue
            raise fault(
                source,
                current.name if current else "",
                "",
                f"line {number}: {line[:60]!r} is neither a section, nor key=value, nor a comment",
                "begin comments with ; or take the line out",
            )
        if current is None:
            raise fault(source, "", key.strip(), f"line {number} stands before any section", "take it out")
        key = key.strip()
        current.entries.setdefault(key.lower(), (key, _without_comment(key, value)))
    return sections


def device_of(raw: bytes) -> tuple[int, int] | None:
    """Return vendor and product of a file's beginning ([DeviceInfo]); None where it does not say."""
    found: dict[str, int] = {}
    inside = False
    for line in decode(raw).splitlines():
        text = line.strip()
        if text.startswith("["):
            inside = _plain(text[1:].partition("]")[0]) == "deviceinfo"
            continue
        key, equals, value = text.partition("=")
        name = key.strip().lower()
        if not inside or not equals or name not in ("vendornumber", "productnumber"):
            continue
        try:
            found.setdefault(name, number_of(_without_comment("", value), 0))
        except ValueError:
            continue
    if len(found) < 2 or not all(found.values()):
        return None
    return found["vendornumber"], found["productnumber"]


def _plain(name: str) -> str:
    return re.sub(r"\s+", "", name).lower()


def _without_comment(key: str, value: str) -> str:
    if _WORDS.search(key.lower()):
        return re.split(r"\s;", value, maxsplit=1)[0].strip()
    return re.split(r";|\s#|\s//", value, maxsplit=1)[0].strip()


def number_of(text: str, node: int) -> int:
    """Return a whole number as CiA 306 writes it: decimal, hexadecimal, octal, or a sum with ``$NODEID``.

    Raises:
        ValueError: it is not a number.
    """
    total = 0
    plain = re.sub(r"\s+", "", text).upper()
    if not plain:
        raise ValueError("no number")
    for part in plain.split("+"):
        total += node if part == "$NODEID" else _literal(part)
    return total


def _literal(text: str) -> int:
    found = re.fullmatch(r"(-?)(?:0X([0-9A-F]+)|(0[0-7]+)|([0-9]+))", text)
    if found is None:
        raise ValueError(f"{text!r} is no number")
    sign, hexadecimal, octal, decimal = found.groups()
    number = int(hexadecimal, 16) if hexadecimal else int(octal, 8) if octal else int(decimal)
    return -number if sign else number
