"""The files of the SDKs that are made from the server's messages and methods."""

from __future__ import annotations

from pathlib import Path

from mcserver.contract.sdk import golang, java, python, rust, typescript
from mcserver.contract.sdk.model import model
from mcserver.contract.sdk.same_source import same_files

LANGUAGES = {
    "rust": rust.files,
    "java": java.files,
    "go": golang.files,
    "python": python.files,
    "typescript": typescript.files,
}


def files() -> dict[str, str]:
    """Return every file by its path below `clients`."""
    made = {folder: make(model()) for folder, make in LANGUAGES.items()}
    made["python"] |= same_files()
    return {f"{folder}/{name}": text for folder, each in made.items() for name, text in each.items()}


def write(clients: Path) -> None:
    """Write all of them."""
    for name, text in files().items():
        (clients / name).write_text(text, "utf-8")
