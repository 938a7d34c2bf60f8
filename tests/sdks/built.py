"""Builds of SDKs, each done once for the sources that it has been made of, whichever process asks first."""

from __future__ import annotations

import fcntl
import hashlib
import os
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.e2e.servers import ROOT

NOTES = ROOT / "build" / "sdks"
# Zenoh, or Maven's downloads, on a busy computer [s].
BUILD_LIMIT_S = 900.0


def build_once(
    name: str,
    sources: Sequence[Path],
    outputs: Sequence[Path],
    build: Callable[[], object],
    notes: Path = NOTES,
) -> None:
    """Run a build, unless one of these very sources has ended well and its outputs are there still.

    Others that ask for the same build meanwhile, in this process or another one, wait for its end.

    Args:
        name: of the build, and of its note in ``notes``.
        sources: files, and folders with all that is in them.
        outputs: what it makes; any that is missing is reason to build.

    Raises:
        Exception: of the build; the next who asks builds again.
    """
    notes.mkdir(parents=True, exist_ok=True)
    with (notes / name).open("a+", encoding="ascii") as note:
        fcntl.flock(note, fcntl.LOCK_EX)
        note.seek(0)
        digest = digest_of(sources)
        if note.read() == digest and all(each.exists() for each in outputs):
            return
        note.truncate(0)
        build()
        note.write(digest)


def build(command: list[str], folder: Path, **variables: str) -> str:
    """Run a tool, with the registry's proxy if there is one, and say why where it fails; what was printed."""
    done = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        timeout=BUILD_LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def digest_of(sources: Sequence[Path]) -> str:
    """Return a digest of the paths and contents of files, and of all files in folders."""
    digest = hashlib.sha256()
    for source in sources:
        for file in sorted(source.rglob("*")) if source.is_dir() else [source]:
            if file.is_file():
                digest.update(f"{file}\0{file.stat().st_size}\0".encode())
                digest.update(file.read_bytes())
    return digest.hexdigest()
