"""Reading the kernel's small text files, which may not exist."""

from __future__ import annotations

from pathlib import Path


def read_text(path: str | Path) -> str | None:
    """Return the text without surrounding blanks; None where it cannot be read."""
    try:
        return Path(path).read_text("utf-8", errors="replace").strip()
    except OSError:
        return None


def read_int(path: str | Path) -> int | None:
    """Return the whole number in a file; None where the file holds no number."""
    text = read_text(path)
    try:
        return None if text is None else int(text)
    except ValueError:
        return None
