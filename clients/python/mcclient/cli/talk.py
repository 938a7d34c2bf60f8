"""A conversation with one machine: lines of one program, whose modal state lasts, and the operator's
orders.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from rich.text import Text

from mcclient.cli.codes import COMMANDS
from mcclient.cli.render import render
from mcclient.cli.tables import machine_view
from mcclient.cli.terminal import TerminalConsole
from mcclient.errors import MotionError, ProgramClosed, ProgramError, ProgramRejected, RequestRefused
from mcclient.feed import Feed
from mcclient.machine import Machine
from mcclient.program import Line, Program
from mcclient.reports import Report
from mcclient.types import LineReport

# a verdict that takes longer comes later, above the prompt
VERDICT_S = 0.5
REPORTS_KEPT = 1000


class Talk:
    """Takes what is typed, one line after the other.

    Attributes:
        failure: the last error; what a script's exit code comes from.
    """

    def __init__(
        self, machine: Machine, out: Callable[[], TerminalConsole], *, axes: list[int] | None
    ) -> None:
        self.failure: MotionError | None = None
        self._machine = machine
        self._out = out
        self._axes = axes
        self._program: Program | None = None
        self._reports: Feed[Report] | None = None
        self._timings: dict[int, LineReport] = {}
        self._pending: set[asyncio.Task[None]] = set()
        self._listening: asyncio.Task[None] | None = None

    @property
    def moving(self) -> bool:
        """Whether lines wait or run."""
        program = self._program
        return program is not None and not program.ended and program.done_through < program.given_through

    @property
    def held(self) -> bool:
        """Whether the program stands still until it is resumed."""
        return self._program is not None and self._program.state in ("held", "paused")

    @property
    def number(self) -> int:
        """The number of the next line."""
        return 1 if self._program is None or self._program.ended else self._program.given_through + 1

    async def enter(self, text: str, *, wait: bool) -> bool:
        """Takes one line; False: the conversation is over.

        Args:
            wait: return only once the line has ended; else its end is shown when it comes.
        """
        stripped = text.strip()
        if stripped in (":quit", ":q", ":exit"):
            return False
        if stripped.startswith(":"):
            await self._command(stripped)
        elif stripped:
            task = asyncio.create_task(self._send(text))
            self._pending.add(task)
            task.add_done_callback(self._pending.discard)
            await asyncio.wait([task], timeout=None if wait else VERDICT_S)
        return True

    async def hold(self) -> None:
        await self._command(":hold")

    async def finish(self) -> None:
        """Waits for the motion's end, and closes the program."""
        if self._pending:
            await asyncio.wait(self._pending)
        program = self._program
        try:
            if program is not None and not program.ended:
                await program.finish()
        except MotionError as error:
            self._tell(error)
        finally:
            await self._drop_program()

    async def abort(self) -> None:
        """Stops the program; the next line begins another one."""
        if self._program is not None and not self._program.ended:
            await self._program.abort()

    # ------------------------------------------------------------ lines

    async def _send(self, text: str) -> None:
        number = self.number
        try:
            program = await self._open()
            number = program.given_through + 1
            line = await program.send(text)
            self._say(f"  {line.number} accepted", "dim")
            await line.done()
            self._say(f"  {line.number} done{await self._timing(line)}", "green")
        except ProgramRejected as error:
            self.failure = error
            for diagnostic in error.diagnostics:
                shown = text if diagnostic.line in (number, 0) else None
                for row in render(diagnostic, shown, "console"):
                    self._say(row, "red")
        except MotionError as error:
            self._tell(error)

    async def _timing(self, line: Line) -> str:
        """The event may come a moment after the acknowledgement."""
        for _ in range(5):
            report = self._timings.pop(line.number, None)
            if report is not None:
                took = f" in {report.end_s - report.start_s:.3f} s"
                if report.requested_s is not None and report.bound_by:
                    took += f", asked for {report.requested_s:.3f} s (bound by {report.bound_by})"
                return took
            await asyncio.sleep(0.01)
        return ""

    async def _open(self) -> Program:
        if self._program is None or self._program.ended:
            again = self._program is not None
            await self._drop_program()
            self._program = await self._machine.program("mcctl console", self._axes)
            self._reports = self._program.reports
            self._listening = asyncio.create_task(self._listen(self._reports))
            if again:
                self._say(f"a new program, {self._program.id}, with modal state afresh", "yellow")
        return self._program

    async def _listen(self, reports: Feed[Report]) -> None:
        async for report in reports:
            if report.timing is not None:
                self._timings[report.line] = report.timing
                while len(self._timings) > REPORTS_KEPT:
                    self._timings.pop(next(iter(self._timings)))
            elif report.kind == "warning":
                self._say(f"warning: {report.message}", "yellow")

    async def _drop_program(self) -> None:
        if self._program is not None:
            await self._program.leave()
        if self._reports is not None:
            self._reports.close()
        if self._listening is not None:
            self._listening.cancel()
            await asyncio.gather(self._listening, return_exceptions=True)
        self._timings.clear()

    # ------------------------------------------------------------ orders

    async def _command(self, text: str) -> None:
        word, _, rest = text.partition(" ")
        try:
            if word == ":status":
                self._out().print(
                    machine_view(self._machine.name, self._machine.info, await self._machine.status())
                )
            elif word == ":hold":
                await self._living().hold()
                self._say("  holding; :resume goes on", "yellow")
            elif word == ":resume":
                await self._living().resume()
                self._say("  resumed")
            elif word == ":abort":
                await self._living().abort()
                self._say("  aborted", "yellow")
            elif word == ":override":
                self._say(f"  override {(await self._machine.override(_percent(rest))).percent:g} %")
            elif word == ":help":
                for name, what in COMMANDS.items():
                    self._say(f"  {name:<10} {what}")
            else:
                raise RequestRefused("MC511", f"there is no command {word}", ":help lists them")
        except MotionError as error:
            self._tell(error)

    def _living(self) -> Program:
        if self._program is None or self._program.ended:
            raise RequestRefused("MC517", "no program is under way", "send a line first")
        return self._program

    def _tell(self, error: MotionError) -> None:
        if isinstance(error, ProgramClosed) and self.failure is not None:
            return
        if isinstance(error, ProgramError) and self.failure is error:
            return
        self.failure = error
        self._out().print(Text.assemble((f"error[{error.code}]", "bold red"), f": {error.message}"))
        if error.hint:
            self._out().print(Text(f"  = help: {error.hint}"))

    def _say(self, text: str, style: str = "") -> None:
        self._out().print(Text(text, style=style))


def _percent(text: str) -> float:
    """Raises RequestRefused (MC511) where it is no number."""
    try:
        return float(text.strip().rstrip("%"))
    except ValueError:
        raise RequestRefused("MC511", f"{text!r} is no percentage", "such as :override 50") from None
