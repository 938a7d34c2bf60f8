"""What a page of the documentation has people type: its files, and its commands in their order."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

from mcserver.cli.app import run_command_line
from tests.cli.command import ROOT

# a name before a block of code: `gantry.toml`:
FILE = re.compile(r"`([\w.-]+)`[^`\n]*:\n\n```\w+\n(.*?)```\n", re.DOTALL)


def read_page(name: str) -> str:
    return (ROOT / "docs" / name).read_text("utf-8")


def commands_of(page: str) -> list[str]:
    """Lines after a prompt, in reading order."""
    return [line[2:] for line in page.splitlines() if line.startswith("$ ")]


def write_files(page: str, folder: Path) -> list[str]:
    """Write what the page names and shows; the names."""
    found = FILE.findall(page)
    for name, text in found:
        (folder / name).write_text(text, "utf-8")
    return [name for name, _ in found]


def run_here(command: str) -> int:
    """Run one, and give its exit code: those of mcserver in this process, those of the shell by a shell."""
    words = shlex.split(command)
    if words[0] == "mcserver" and ">" not in words:
        return run_command_line(words[1:])
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    return subprocess.run(["bash", "-c", command], env={**os.environ, "PATH": path}, check=False).returncode
