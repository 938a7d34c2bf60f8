"""Read the folder of subprograms that programs may call by name (D-83, D-91)."""

from __future__ import annotations

import re
from pathlib import Path

from mcserver.machine.program_bytes import NoText, text_of_bytes
from mcserver.machine.section_reader import Mistakes

SUFFIXES = (".ngc", ".nc")
MOST_FILES = 200
# of all files together: they are part of the machine's digest, which approvals refer to
MOST_BYTES = 1 << 20
_FOLDER = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_. -]*(?:/[A-Za-z0-9_-][A-Za-z0-9_. -]*)*\Z")
_NAME = re.compile(r"[a-z0-9_-]{1,64}\Z")
_NUMBER = re.compile(r"o?0*([0-9]+)\Z")
_PATH = ("dialect", "subroutines")


def read_subroutines(written: str, folder: Path | None, mistakes: Mistakes) -> dict[str, str]:
    """Return the present texts of subprograms by name, or by number without leading zeros.

    Args:
        written: folder as in the machine file; empty: none. folder: the machine file's.
    """
    if not written:
        return {}
    if folder is None or not _FOLDER.match(written):
        hint = "name a folder beside the machine file, such as subroutines"
        mistakes.add(_PATH, f"{written!r} is no folder beside a machine file", hint)
        return {}
    try:
        files = sorted(each for each in (folder / written).iterdir() if each.suffix.lower() in SUFFIXES)
    except OSError as error:
        mistakes.add(_PATH, f"cannot be read: {error.strerror}", "make the folder, or correct its name")
        return {}
    found: dict[str, str] = {}
    room = MOST_BYTES
    for path in files[: MOST_FILES + 1]:
        name = path.stem.lower()
        number = _NUMBER.match(name)
        name = name if number is None else number[1]
        if not _NAME.match(name) or name in found or path.is_symlink() or not path.is_file():
            mistakes.add(_PATH, f"{path.name!r} cannot be called", "letters, digits, _ and -; each name once")
            continue
        try:
            with path.open("rb") as file:
                content = file.read(room + 1)
        except OSError as error:
            mistakes.add(_PATH, f"{path.name} cannot be read: {error.strerror}", "let the server read it")
            continue
        try:
            text = text_of_bytes(content)
        except NoText:
            mistakes.add(_PATH, f"{path.name} is no text", "save it as UTF-8, or take it out of the folder")
            continue
        room -= len(content)
        if room < 0 or len(found) == MOST_FILES:
            most = f"more than {MOST_FILES} files or {MOST_BYTES >> 20} MB of subprograms"
            mistakes.add(_PATH, most, "keep those that programs call")
            break
        found[name] = text
    return found
