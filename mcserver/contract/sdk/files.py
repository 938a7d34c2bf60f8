"""The files of the SDKs that are made from the server's messages and methods."""

from __future__ import annotations

from pathlib import Path

from mcserver.contract.sdk import golang, java, python, rust, typescript
from mcserver.contract.sdk.model import model

LANGUAGES = {
    "rust": rust.files,
    "java": java.files,
    "go": golang.files,
    "python": python.files,
    "typescript": typescript.files,
}


def files() -> dict[str, str]:
    """Return every file by its path below `clients`."""
    return {
        f"{folder}/{name}": text for folder, made in LANGUAGES.items() for name, text in made(model()).items()
    }


def write(clients: Path) -> None:
    """Write all of them."""
    for name, text in files().items():
        (clients / name).write_text(text, "utf-8")
