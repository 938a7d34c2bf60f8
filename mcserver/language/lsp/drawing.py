"""Draw an open program: a page with its path, made by ``mcserver plot`` in a process of its own."""

from __future__ import annotations

import asyncio
import hashlib
import sys
import tempfile
from pathlib import Path

DRAWING_S = 300.0  # longest time for a drawing
MAX_DRAWN = 1_000_000  # characters of a program
COMMAND = "mcserver.draw"


class NotDrawn(Exception):
    """There is no drawing; the text says why, for the person at the editor."""


async def plot(text: str, machine: str, output: Path) -> None:
    """Draw a program into a file by ``mcserver plot``, as far as it comes.

    Raises:
        NotDrawn: the program is rejected, or takes too long.
    """
    command = [sys.executable, "-m", "mcserver", "plot", "-", "-o", str(output), "-m", machine]
    process = await asyncio.create_subprocess_exec(
        *command,
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        _, narration = await asyncio.wait_for(process.communicate(text.encode("utf-8", "replace")), DRAWING_S)
    except TimeoutError:
        raise NotDrawn(f"drawing took longer than {DRAWING_S:.0f} s; use mcserver plot") from None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    if not output.exists():
        first = narration.decode("utf-8", "replace").strip().partition("\n")[0]
        raise NotDrawn(first[:300] or f"mcserver plot ended with {process.returncode}")


class Drawings:
    """The pages that were drawn, in a folder that goes with the language server.

    Args:
        machine: a built-in machine or a machine file, as it was named on the command line.
    """

    def __init__(self, machine: str) -> None:
        self._machine = machine
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._one_at_a_time = asyncio.Lock()

    async def draw(self, uri: str, text: str) -> Path:
        """Draw a program and return the page; drawn again, a program keeps its page.

        Raises:
            NotDrawn: the program is rejected, too long, or takes too long.
        """
        if len(text) > MAX_DRAWN:
            raise NotDrawn(f"the program has more than {MAX_DRAWN} characters; use mcserver plot")
        async with self._one_at_a_time:
            if self._folder is None:
                self._folder = tempfile.TemporaryDirectory(prefix="mcserver-")
            page = Path(self._folder.name) / f"{hashlib.sha256(uri.encode()).hexdigest()[:16]}.html"
            page.unlink(missing_ok=True)
            await plot(text, self._machine, page)
            return page

    def close(self) -> None:
        """Remove the pages."""
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None
