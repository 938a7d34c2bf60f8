"""The path of the Go SDK's module: Go fetches it from where that points, a folder of a repository."""

from __future__ import annotations

import re
from pathlib import Path

from deploy.release.commands import run
from deploy.release.versions import NotReleasable

FOLDER = "clients/go"
MODULE = re.compile(rf"[a-z0-9-]+(\.[a-z0-9-]+)+(/[\w.~-]+)+/{FOLDER}")
# what names it, with the tests that are built with it
NAMING = ("clients", "docs", "tests", "deploy/release.md")


def set_go_module(root: Path, path: str) -> list[str]:
    """Give the Go SDK its module's path in all that names it; the files that are changed.

    Raises:
        NotReleasable: no module in this folder of a repository has such a path.
    """
    if not MODULE.fullmatch(path):
        raise NotReleasable([f"{path} is no path such as github.com/OWNER/REPOSITORY/{FOLDER}"])
    before = (root / FOLDER / "go.mod").read_bytes().split()[1]
    changed = []
    for name in run(["git", "ls-files", *NAMING], root).splitlines():
        text = (root / name).read_bytes()
        if before in text:
            (root / name).write_bytes(text.replace(before, path.encode()))
            changed.append(name)
    return changed
