"""Programs that operators have uploaded, kept as files in folders beside the page's other state."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from pathlib import Path

import msgspec

from mcserver.errors import ServiceError
from mcserver.machine.program_bytes import NoText, text_of_bytes
from mcserver.web.thumbnails import HEAD_CHARS, Thumbnail, find_thumbnail
from mcserver.web.translation import mark

MAX_PROGRAM_BYTES = 256 * 1024 * 1024
MAX_PROGRAMS = 500
# of a folder or a file, beside what a part of it has before it is whole: Linux's file systems allow 255 bytes
MAX_NAME_BYTES = 249
# kept in memory
MAX_THUMBNAILS = 50
# folders and a file; what begins with a dot is none of them
_NAME = re.compile(
    r"(?=.{1,120}\Z)(?:[^./\x00-\x1f\\][^/\x00-\x1f\\]*/){0,4}[^./\x00-\x1f\\][^/\x00-\x1f\\]*"
)


def is_folder(name: str) -> bool:
    """Whether programs can lie in a folder of this name, with ``/`` between it and those about it."""
    return _is_name(f"{name}/x")


def _is_name(name: str) -> bool:
    try:
        parts = name.encode("utf-8").split(b"/")
    except UnicodeEncodeError:
        # half of a surrogate pair
        return False
    return _NAME.fullmatch(name) is not None and max(map(len, parts)) <= MAX_NAME_BYTES


def text_of(name: str, content: bytes) -> str:
    """Return a program's text (`text_of_bytes`).

    Raises:
        ServiceError: MC061 it is no text.
    """
    try:
        return text_of_bytes(content)
    except NoText as error:
        raise ServiceError(
            "MC061", mark("{name} is no text", name=name), mark("is it the right file?")
        ) from error


class StoredProgram(msgspec.Struct, frozen=True):
    """One file of the store: folders and name with ``/`` between, bytes, Unix seconds of its last change."""

    name: str
    size: int
    changed_at: float


class ProgramStore:
    """A folder of programs, for one machine.

    Args:
        folder: made when the first program is written.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        # by the program's name, with when it was changed [ns]
        self._thumbnails: dict[str, tuple[int, Thumbnail | None]] = {}

    @property
    def folder(self) -> Path:
        """Where the programs are; what begins with a dot there is no program."""
        return self._folder

    def list(self) -> list[StoredProgram]:
        """All of them, the newest first."""
        return sorted(self._files(self._folder, ""), key=lambda each: -each.changed_at)

    def _files(self, folder: Path, before: str) -> Iterator[StoredProgram]:
        # a folder may go while it is looked through
        with contextlib.suppress(FileNotFoundError), os.scandir(folder) as entries:
            for entry in entries:
                name = f"{before}{entry.name}"
                if not _NAME.fullmatch(name):
                    continue
                if entry.is_dir(follow_symlinks=False):
                    yield from self._files(folder / entry.name, f"{name}/")
                elif entry.is_file(follow_symlinks=False):
                    status = entry.stat()
                    yield StoredProgram(name, status.st_size, status.st_mtime)

    def write(self, name: str, content: bytes) -> None:
        """Keep a program, whole or not at all.

        Raises:
            ServiceError: MC061 its name, its size, its text or the disk does not allow it.
        """
        path = self._path(name)
        if len(content) > MAX_PROGRAM_BYTES:
            raise ServiceError(
                "MC061",
                mark(
                    "{name} is larger than {size} MiB",
                    name=name,
                    size=MAX_PROGRAM_BYTES >> 20,
                ),
                mark("split the program"),
            )
        content = text_of(name, content).encode("utf-8")
        if not path.exists() and len(self.list()) >= MAX_PROGRAMS:
            raise ServiceError(
                "MC061",
                mark("{count} programs are kept already", count=MAX_PROGRAMS),
                mark("delete some of them"),
            )
        temporary = path.with_name(f".{path.name}.part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary.write_bytes(content)
            temporary.replace(path)
        except OSError as error:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)
            raise ServiceError(
                "MC061",
                mark("{name} could not be kept: {why}", name=name, why=error.strerror),
                mark("make room on the disk"),
            ) from error

    def has(self, name: str) -> bool:
        """Whether a program of this name is kept. Raises ServiceError (MC061) for what cannot be a name."""
        return self._path(name).exists()

    def read(self, name: str) -> str:
        """The program's text. Raises ServiceError (MC061) where it is gone."""
        try:
            return self._path(name).read_text("utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise ServiceError(
                "MC061",
                mark("{name} cannot be read: {why}", name=name, why=error),
                mark("upload it again"),
            ) from error

    def thumbnail(self, name: str) -> Thumbnail | None:
        """Return the picture that the slicer has put into a program; None: none, or the program is gone.

        Raises:
            ServiceError: MC061 it cannot be a file's name.
        """
        path = self._path(name)
        try:
            changed = path.stat().st_mtime_ns
            known = self._thumbnails.get(name)
            if known is None or known[0] != changed:
                with path.open(encoding="utf-8-sig", errors="replace") as file:
                    known = (changed, find_thumbnail(file.read(HEAD_CHARS)))
        except OSError:
            self._thumbnails.pop(name, None)
            return None
        if name not in self._thumbnails and len(self._thumbnails) >= MAX_THUMBNAILS:
            self._thumbnails.clear()
        self._thumbnails[name] = known
        return known[1]

    def delete(self, name: str) -> None:
        """Forget a program, and folders that are empty without it; one that is gone already is no error."""
        path = self._path(name)
        path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            while (path := path.parent) != self._folder:
                path.rmdir()

    def _path(self, name: str) -> Path:
        if not _is_name(name):
            raise ServiceError(
                "MC061", mark("{name!r} cannot be a file's name", name=name), mark("rename the file")
            )
        return self._folder / name
