"""Recordings of a machine's server, taken over by the page: as files, as plots, and to be played.

Plots and replays are made by processes of their own, one at a time: a recording may hold gigabytes of
numbers, and the page has to go on.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import shutil
import sys
from collections.abc import AsyncIterator
from pathlib import Path

from mcclient import Machine, MotionError

from mcserver.web.translation import mark

# Files that are kept on the page's disk: the newest this many of a machine.
KEPT = 4
MOST_BYTES = 1 << 30
LIMIT_S = 300.0
NICE = 10
# as servers name them: nothing that leads out of the folder
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")


class RecordedFiles:
    """Recordings of one machine.

    Args:
        folder: keeps what was taken over last; made when it is first needed.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._busy = asyncio.Lock()

    async def pieces(self, machine: Machine, name: str) -> AsyncIterator[bytes]:
        """The file piece by piece. Raises MotionError where it is not there, or changes meanwhile."""
        async for piece, _ in machine.read_recording(name):
            yield piece

    async def plot(self, machine: Machine, name: str) -> Path:
        """Return the page that ``mcserver plot`` makes of a recording.

        Raises:
            MotionError: it cannot be had, is too large (MC589), or cannot be drawn (MC588).
        """
        return await self._made(machine, name, ".html", "-m", "mcserver", "plot", "--output")

    async def replay(self, machine: Machine, name: str) -> Path:
        """Return a recording as `mcserver.web.replay` thins it. Raises as `plot`."""
        return await self._made(machine, name, ".json", "-m", "mcserver.web.replay")

    async def _made(self, machine: Machine, name: str, suffix: str, *command: str) -> Path:
        async with self._busy:
            if _NAME.fullmatch(name) is None:
                raise MotionError(
                    "MC585",
                    mark("{name!r} is no recording's name", name=name),
                    mark("the list shows what is there"),
                )
            listed = (await machine.recordings()).recordings
            size = next((each.size for each in listed if each.name == name), None)
            if size is None:
                raise MotionError(
                    "MC585",
                    mark("there is no recording {name!r}", name=name),
                    mark("the list shows what is there"),
                )
            # another recording may come by a name that was used before
            folder = self._folder / f"{name}.{size}"
            output = folder / f"{name}{suffix}"
            if output.is_file():
                return output
            try:
                source = await self._taken_over(machine, name, folder, size)
                await _run(*command, str(output), str(source))
            except OSError as error:
                raise MotionError(
                    "MC061",
                    mark("{name} cannot be kept: {why}", name=name, why=error.strerror),
                    mark("make room on the page's disk"),
                ) from error
            return output

    async def _taken_over(self, machine: Machine, name: str, folder: Path, size: int) -> Path:
        path = folder / f"{name}.mcap"
        if path.is_file():
            return path
        if size > MOST_BYTES:
            raise MotionError(
                "MC589",
                mark("{name} is larger than {size} MiB", name=name, size=MOST_BYTES >> 20),
                mark("download it, and use mcserver plot"),
            )
        self._make_room()
        folder.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f"{path.name}.part")
        try:
            with part.open("wb") as file:
                async for piece in self.pieces(machine, name):
                    file.write(piece)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
        return path

    def _make_room(self) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        found = sorted(self._folder.iterdir(), key=lambda path: path.stat().st_mtime)
        for old in found[: max(0, len(found) - KEPT + 1)]:
            shutil.rmtree(old, ignore_errors=True)


async def _run(*arguments: str) -> None:
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        *arguments,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
    )
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, process.pid, NICE)
    try:
        _, said = await asyncio.wait_for(process.communicate(), LIMIT_S)
    except TimeoutError as error:
        raise MotionError(
            "MC588",
            mark("it took more than {limit:g} s", limit=LIMIT_S),
            mark("download it, and use mcserver plot"),
        ) from error
    finally:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
    if process.returncode:
        lines = said.decode("utf-8", "replace").strip().splitlines()
        raise MotionError(
            "MC588",
            mark("it cannot be drawn: {why}", why=lines[0] if lines else mark("no reason was given")),
            mark("download it"),
        )
