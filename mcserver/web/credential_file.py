"""Files of who may log in: an entry a line, its fields separated by colons."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from mcserver.errors import ConfigurationError


class CredentialFile:
    """One such file.

    Args:
        path: of the file. code: of the errors about it. what: what it is, for people. remedy: how to make it.
    """

    def __init__(self, path: Path, code: str, what: str, remedy: str) -> None:
        self._path = path
        self._code = code
        self._what = what
        self._remedy = remedy

    def changed_at(self) -> int | None:
        """Return when it was written last [ns]; None where it is gone."""
        try:
            return self._path.stat().st_mtime_ns
        except OSError:
            return None

    def entries(self, *, may_be_empty: bool = False) -> Iterator[tuple[int, list[str]]]:
        """Yield each entry's line number and fields; blank lines and comments are skipped.

        Raises:
            ConfigurationError: it cannot be read, or holds no entry where it has to.
        """
        try:
            lines = self._path.read_text("utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise self.refusal(f"cannot be read: {error}") from error
        found = [(number, line.split(":")) for number, line in enumerate(lines, 1) if _is_entry(line)]
        if not found and not may_be_empty:
            raise self.refusal("is empty")
        yield from found

    def refusal(self, why: str, number: int = 0) -> ConfigurationError:
        """An error about the file, or about one line of it."""
        where = f":{number}" if number else ""
        return ConfigurationError(self._code, f"the {self._what} {self._path}{where} {why}", self._remedy)

    def replace(self, name: str, *fields: str) -> None:
        """Write an entry in place of the one of that name; the file is readable by its owner alone.

        Raises:
            ConfigurationError: it cannot be written.
        """
        try:
            kept = self._path.read_text("utf-8").splitlines() if self._path.exists() else []
            lines = [line for line in kept if line.partition(":")[0] != name] + [":".join((name, *fields))]
            temporary = self._path.with_name(f"{self._path.name}.new")
            descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            with os.fdopen(descriptor, "w", encoding="utf-8") as file:
                file.write("\n".join(lines) + "\n")
            temporary.replace(self._path)
        except (OSError, UnicodeDecodeError) as error:
            raise self.refusal(f"cannot be written: {error}") from error


def _is_entry(line: str) -> bool:
    return bool(line.strip()) and not line.startswith("#")
