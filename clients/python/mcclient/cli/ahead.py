"""What is found out about a program before it runs, and while it runs: its faults, and how long it takes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from mcclient.cli.go_on import OutputsChoice
from mcclient.cli.options import Target
from mcclient.cli.output import as_plain, say, write_json
from mcclient.cli.progress import duration
from mcclient.cli.source import ProgramSource
from mcclient.cli.terminal import show_diagnostics
from mcclient.errors import MotionError, RequestRefused
from mcclient.machine import Machine
from mcclient.texts import hash_of_file
from mcclient.types import ENDED, CheckReply, OnDisconnectWord

# A longer text is handed over as a file, and simulated by the server while it runs.
SHORT_BYTES = 2 * 1024 * 1024
# how long the server's first check may take
FIRST_CHECK_S = 30.0
# how long the start may wait for the simulation that tells the program's times
FORESIGHT_S = 3.0
# the check is a service: where it is busy or missing, the server judges the lines as they come
NO_CHECK = frozenset({"MC501", "MC508", "MC523", "MC590", "MC591"})


class Switches(TypedDict):
    """The operator's switches as the calls take them."""

    block_delete: bool
    optional_stop: bool


@dataclass(frozen=True, slots=True)
class JobOptions:
    """What was asked for; ``interactive``: somebody sits at a terminal and can be asked."""

    target: Target
    axes: list[int] | None
    from_line: int
    record: Path | None
    step: bool
    check: bool
    on_disconnect: OnDisconnectWord
    json: bool
    interactive: bool
    way: bool = False
    outputs: OutputsChoice | None = None
    block_delete: bool = False
    optional_stop: bool = True

    @property
    def switches(self) -> Switches:
        """Return the operator's switches as the calls take them."""
        return {"block_delete": self.block_delete, "optional_stop": self.optional_stop}


class Ahead:
    """Looks at one program's text as a whole, if there is one: standard input has none.

    Attributes:
        sha256: of the text; None: it is not known.
    """

    def __init__(self, options: JobOptions, source: ProgramSource) -> None:
        self._options = options
        self._source = source
        # of a short one all of it, of a long one its file
        self._text: str | None = None
        self._file: Path | None = None
        self._handed_over = False
        # where the axes stood before it; None: not known
        self._standing: dict[int, float] | None = None
        self.sha256: str | None = None

    async def is_sound(self, machine: Machine) -> bool:
        """Return whether the whole text has no fault; a text that cannot be known beforehand counts as sound.

        Raises:
            RequestRefused: the text cannot be read, or the server's check fails otherwise.
        """
        self._text = self._source.whole_text(SHORT_BYTES)
        if self._text is not None:
            self.sha256 = machine.hash_of(self._text)
        elif self._source.total is not None:
            self._file = Path(self._source.path)
            self.sha256 = await asyncio.to_thread(hash_of_file, self._file)
        else:
            return True
        status = await machine.status()
        self._standing = dict(zip(status.axes.index, status.axes.setpoint, strict=True))
        if not self._options.check or self._options.from_line > 1:
            return True
        if any(program.state not in ENDED for program in status.programs):
            # where the axes will be when this one begins is not known yet
            return True
        try:
            found = await self._check(machine)
        except RequestRefused as error:
            if error.code in NO_CHECK:
                if self._file is not None:
                    say(f"{self._source.name} is not checked ahead: {error.message}", "yellow")
                return True
            raise
        self._show(found)
        return found.ok

    async def _check(self, machine: Machine) -> CheckReply:
        # a router drops what its access rules forbid without a word: no text at all is checked as soon as the
        # server's first check has its process, which takes seconds on a busy computer
        await machine.check("", deadline_s=FIRST_CHECK_S)
        if self._file is None:
            return await machine.check(self._text, positions=self._standing, **self._options.switches)
        say(f"checking {self._source.total} lines of {self._source.name}; --no-check starts at once")
        await self._hand_over(machine)
        return await machine.check(positions=self._standing, sha256=self.sha256, **self._options.switches)

    def _show(self, found: CheckReply) -> None:
        show_diagnostics(found.diagnostics, self._source.line_at, self._source.name)
        if not found.ok:
            say(f"{self._source.name} is rejected; nothing moved", "bold red")
            if self._options.json:
                write_json({"ok": False, "state": "rejected", "diagnostics": as_plain(found.diagnostics)})

    async def _hand_over(self, machine: Machine) -> None:
        assert self._file is not None
        await machine.put_text(self._file, self.sha256)
        self._handed_over = True

    @asynccontextmanager
    async def foreseen(self, machine: Machine) -> AsyncIterator[None]:
        """Let the server simulate the text: a short one before anything moves, a long one while it runs.

        With the times of its lines the program's status has its whole duration and the true time left.
        """
        if self._options.step or (self._text is None and self._file is None) or self._handed_over:
            yield
            return
        looking = asyncio.create_task(self._look_ahead(machine))
        try:
            if self._text is not None:
                await asyncio.wait([looking], timeout=FORESIGHT_S)
            yield
        finally:
            looking.cancel()
            await asyncio.gather(looking, return_exceptions=True)

    async def _look_ahead(self, machine: Machine) -> None:
        try:
            if self._text is None:
                await self._hand_over(machine)
                return
            report = await machine.simulate(
                self._text,
                positions=self._standing,
                lines=False,
                role="operator",
                **self._options.switches,
            )
        except MotionError:
            # the run says its own faults; the time left is estimated from the lines then
            return
        if report.ok and self._options.from_line == 1:
            say(f"{self._source.name}: {duration(report.duration_s)} at 100 %")
