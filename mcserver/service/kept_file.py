"""Small files beside the journal that have to be whole whenever the server ends."""

from __future__ import annotations

import os
from pathlib import Path


def private(path: str, flags: int) -> int:
    """Open a file that only its owner reads; the ``opener`` of `open`."""
    return os.open(path, flags, 0o600)


def replace_file(path: Path, content: bytes) -> None:
    """Write a file anew: whoever reads it, after a power cut too, finds all of the old one or of the new one.

    Raises:
        OSError: it cannot be written; the old one is as it was.
    """
    aside = path.with_name(f"{path.name}.new")
    with open(aside, "wb", opener=private) as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(aside, path)
