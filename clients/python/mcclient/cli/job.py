"""One run of a program: checked, streamed, followed, recorded, and interrupted by Ctrl-C."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from typing import Any

from mcclient.cli.ahead import Ahead, JobOptions
from mcclient.cli.go_on import outputs_of
from mcclient.cli.interrupt import Interrupts
from mcclient.cli.output import error_as_json, exit_code_of, narration, say, show_error, write_json
from mcclient.cli.progress import Display, LiveDisplay, NoDisplay, PlainDisplay, Snapshot, duration
from mcclient.cli.source import ProgramSource
from mcclient.cli.tables import awaited, axes_text
from mcclient.cli.terminal import show_diagnostics
from mcclient.errors import (
    MotionError,
    NobodyAnswers,
    ProgramAborted,
    ProgramInterrupted,
    ProgramRejected,
    RequestRefused,
)
from mcclient.lines import from_thread
from mcclient.machine import Machine
from mcclient.program import Program
from mcclient.recording import Recorder
from mcclient.types import ENDED, MachineStatus, ProgramStatus

REFRESH_S = 0.1
REJECTED = 4
EMERGENCY_STOP = "MC400"


def behind(waiting: ProgramStatus, programs: Sequence[ProgramStatus]) -> str:
    """Return which programs have axes that this one waits for, and which axes; empty: none is known."""
    before = [
        each
        for each in programs
        if each.program != waiting.program
        and each.state not in ENDED
        and each.opened_at <= waiting.opened_at
        and set(each.axes) & set(waiting.axes)
    ]
    if waiting.state != "queued" or not before:
        return ""
    shared = sorted({axis for each in before for axis in each.axes} & set(waiting.axes))
    return f"{', '.join(each.name or each.program for each in before)}, axes {axes_text(shared)}"


class Left(Exception):
    """The program goes on without this command."""


class Job:
    """Runs once; `run` gives the exit code."""

    def __init__(self, options: JobOptions, source: ProgramSource) -> None:
        self._options = options
        self._source = source
        self._started_at = time.monotonic()
        self._ran_s = 0.0
        self._display = self._choose_display()
        self._status: ProgramStatus | None = None
        self._behind = self._awaited = ""
        self._ahead = Ahead(options, source)
        self._all_accepted = False
        self._rejection_shown = False

    def _choose_display(self) -> Display:
        if self._options.step:
            return NoDisplay()
        console = narration()
        return (
            LiveDisplay(console, self._source.name)
            if console.is_terminal
            else PlainDisplay(self._source.name)
        )

    async def run(self) -> int:
        """Return the exit code; errors of the program are shown here, others are raised."""
        async with self._options.target.open() as machine:
            await self._refuse_under_emergency_stop(machine)
            before = self._source.take(self._options.from_line - 1)
            if not await self._ahead.is_sound(machine):
                return REJECTED
            recorder = await self._start_recording(machine)
            try:
                async with self._ahead.foreseen(machine):
                    return await self._run_on(machine, before, recorder)
            finally:
                if recorder is not None:
                    await recorder.close()

    # ------------------------------------------------------------ before

    async def _refuse_under_emergency_stop(self, machine: Machine) -> None:
        """Say so first: any other fault would send somebody the wrong way."""
        status = await machine.status()
        if status.state == "estop":
            reason = next((fault.message for fault in status.faults if fault.code == EMERGENCY_STOP), "")
            raise RequestRefused(
                "MC509",
                f"{machine.name}: the emergency stop is latched" + (f" ({reason})" if reason else ""),
                "remove the cause, then mcctl reset",
            )

    async def _start_recording(self, machine: Machine) -> Recorder | None:
        if self._options.record is None:
            return None
        recorder = Recorder(machine, self._options.record)
        try:
            await recorder.start()
        except BaseException:
            await recorder.close()
            raise
        return recorder

    # ------------------------------------------------------------ running

    async def _run_on(self, machine: Machine, before: list[str], recorder: Recorder | None) -> int:
        options = self._options
        program = await machine.program(
            self._source.name,
            options.axes,
            on_disconnect=options.on_disconnect,
            start_line=options.from_line,
            before=before,
            step=options.step,
            **options.switches,
            sha256=self._ahead.sha256,
            way=options.way,
            outputs=outputs_of(options.outputs),
        )
        if recorder is not None:
            recorder.follow(program)
        self._started_at = time.monotonic()
        error: MotionError | None = None
        try:
            async with self._followed(machine, program):
                await self._stream(program)
        except Left:
            return self._tell_left(program)
        except MotionError as failure:
            error = failure
            if not program.ended and not isinstance(failure, NobodyAnswers):
                await self._abort_quietly(program)
        finally:
            await program.leave()
        if recorder is not None:
            await self._save(recorder)
        return self._tell_end(program, error)

    async def _stream(self, program: Program) -> None:
        """Sends the lines and waits for the end; Ctrl-C and steps beside it."""
        working = asyncio.create_task(self._send_and_finish(program))
        interrupts = Interrupts(program, self._display, self._options, lambda: self._all_accepted)
        others = [asyncio.create_task(interrupts.serve())]
        if self._options.step:
            others.append(asyncio.create_task(self._serve_steps(program)))
        try:
            await asyncio.wait([working, others[0]], return_when=asyncio.FIRST_COMPLETED)
            if working.done():
                working.result()
            else:
                others[0].result()
                raise Left
        finally:
            interrupts.close()
            for task in (working, *others):
                task.cancel()
            await asyncio.gather(working, *others, return_exceptions=True)

    async def _send_and_finish(self, program: Program) -> None:
        try:
            await program.send_lines(from_thread(self._source.lines()))
            self._all_accepted = True
        except ProgramRejected as error:
            self._display.stop()
            self._show_rejection(error)
            self._display.start()
            # what is before the rejected line runs to its end
            await program.finish()
            raise
        await program.finish()

    async def _serve_steps(self, program: Program) -> None:
        """Each line of standard input, Enter, starts the next line of the program."""
        say("Enter starts the next line")
        stepped = self._options.from_line - 1
        async for _ in from_thread(sys.stdin):
            stepped = max(stepped, program.done_through) + 1
            await program.wait_accepted(stepped)
            say(f"{stepped:>6} | {self._source.text_of(stepped) or ''}")
            try:
                await program.step()
            except RequestRefused as error:
                show_error(error)
        say("standard input has ended: no further line starts; Ctrl-C aborts", "yellow")

    @asynccontextmanager
    async def _followed(self, machine: Machine, program: Program) -> AsyncIterator[None]:
        """Shows progress inside the block."""
        telemetry = asyncio.create_task(self._follow_telemetry(machine, program.id))
        shown = asyncio.create_task(self._show(machine, program))
        self._display.start()
        try:
            yield
        finally:
            for task in (telemetry, shown):
                task.cancel()
            await asyncio.gather(telemetry, shown, return_exceptions=True)
            self._display.stop()

    async def _follow_telemetry(self, machine: Machine, program: str) -> None:
        status: MachineStatus
        async for status in machine.telemetry():
            for each in status.programs:
                if each.program == program:
                    said = self._status.notice if self._status is not None else ""
                    if each.notice not in ("", said) and each.state != "paused":
                        say(f"{self._source.name}: {each.notice}")
                    before, self._status = self._status, each
                    if before is not None and before.simulated < each.simulated == 1.0:
                        say(
                            f"{self._source.name}: {duration(each.duration_s)} at 100 %, simulated to its end"
                        )
                    self._behind = behind(each, status.programs)
                    self._awaited = awaited(each, status.programs)

    async def _show(self, machine: Machine, program: Program) -> None:
        while True:
            shown, since = self._snapshot(program, machine.online), time.monotonic()
            self._display.update(shown)
            self._source.forget(program.done_through - 1)
            await asyncio.sleep(REFRESH_S)
            begun = self._status is not None and self._status.line > 0
            if shown.state == "running" and begun and not shown.waits_for:
                self._ran_s += time.monotonic() - since

    def _snapshot(self, program: Program, online: bool) -> Snapshot:
        status = self._status
        first = self._options.from_line
        done = max(program.done_through, first - 1)
        line = max(done, status.line if status is not None else 0)
        override = status.override if status is not None else 100.0
        foreseen = status if status is not None and status.duration_s is not None else None
        # why it is paused stands in the status, which may come a moment later
        late = program.state == "paused" and status is not None and status.state == "running"
        return Snapshot(
            state="running" if late else program.state,
            first=first,
            total=self._source.total,
            line=line,
            done=done,
            text=self._source.text_of(line) or "",
            override=override,
            elapsed_s=self._ran_s,
            planned_s=status.eta_s if status is not None else None,
            remaining_s=None if foreseen is None else foreseen.eta_s,
            share=None if foreseen is None else foreseen.progress,
            behind=self._behind,
            online=online,
            notice=status.notice if status is not None else "",
            simulated=1.0 if status is None else status.simulated,
            pauses=0 if status is None else status.pauses,
            waits_for=self._awaited,
        )

    # ------------------------------------------------------------ after

    async def _abort_quietly(self, program: Program) -> None:
        """What went wrong is shown anyway."""
        try:
            await program.abort()
        except MotionError as error:
            say(f"the program could not be aborted: {error.message}", "yellow")

    async def _save(self, recorder: Recorder) -> None:
        await recorder.save()
        say(f"recorded {recorder.rows} cycles to {self._options.record}")
        if recorder.filled:
            say(f"warning: {recorder.filled} cycles were lost on the way and are interpolated", "yellow")

    def _show_rejection(self, error: ProgramRejected) -> None:
        """Once: it is known when the line is judged, and again when what is before it has run."""
        if not self._rejection_shown:
            self._rejection_shown = True
            show_diagnostics(error.diagnostics, self._source.text_of, self._source.name)

    def _tell_left(self, program: Program) -> int:
        say(f"left program {program.id} running; mcctl watch shows it")
        if self._options.json:
            write_json({"ok": True, "left": True, "program": program.id, "state": program.state})
        return 0

    def _tell_end(self, program: Program, error: MotionError | None) -> int:
        took = time.monotonic() - self._started_at
        result: dict[str, Any] = {
            "ok": error is None,
            "program": program.id,
            "state": program.state,
            "accepted": program.accepted_through,
            "done": program.done_through,
            "elapsed_s": round(took, 3),
            "diagnostics": [],
        }
        if error is None:
            lines = program.done_through - self._options.from_line + 1
            say(f"{self._source.name}: finished, {lines} lines in {duration(took)}", "green")
        elif isinstance(error, ProgramRejected):
            self._show_rejection(error)
            say(f"{self._source.name} is rejected at line {error.line}; lines before it have run", "bold red")
        elif isinstance(error, ProgramAborted):
            say(f"{self._source.name}: {error.message}", "yellow")
        else:
            show_error(error)
        if isinstance(error, ProgramInterrupted):
            say(f"  = here: mcctl continue {error.program}")
        if error is not None:
            result |= error_as_json(error)
        if self._options.json:
            write_json(result)
        return 0 if error is None else exit_code_of(error)
