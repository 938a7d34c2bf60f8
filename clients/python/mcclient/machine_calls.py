# Made by `python -m mcserver.contract.sdk clients`: change the server's messages instead.
"""Every remote method of a machine (docs/wire/calls.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mcclient import types as wire
from mcclient.calls import Caller


class MachineCalls:
    """The calls of a machine, each repeated under one number until it is answered or ``deadline_s`` is over.

    Raises, each of them: NobodyAnswers (MC530, MC532), RequestRefused with the server's code, ProtocolError.
    """

    _caller: Caller

    def _declare_token(self) -> None:
        """Let the server notice when this client goes."""
        raise NotImplementedError

    async def ask_info(self, *, deadline_s: float = 5.0) -> wire.Info:
        """Describe the machine and the service."""
        return await self._caller.ask(wire.Info, "info", {}, deadline_s)

    async def status(self, *, deadline_s: float = 5.0) -> wire.MachineStatus:
        """Tell the state of the machine now."""
        return await self._caller.ask(wire.MachineStatus, "status", {}, deadline_s)

    async def programs(
        self, program: str | None = None, *, ended: bool = True, limit: int = 100, deadline_s: float = 5.0
    ) -> tuple[wire.ProgramStatus, ...]:
        """List the programs that the server knows: running, queued, ended and interrupted, the newest first.

        Args:
            program: only this one.
            ended: those that have ended too.
        """
        return (
            await self._caller.ask(
                wire.ProgramsReply,
                "programs",
                {"program": program, "ended": ended, "limit": limit},
                deadline_s,
            )
        ).programs

    async def past_events(
        self, since: int = 0, *, limit: int = 500, deadline_s: float = 5.0
    ) -> wire.EventsReply:
        """Repeat events by number, the oldest first."""
        return await self._caller.ask(
            wire.EventsReply, "events", {"since": since, "limit": limit}, deadline_s
        )

    async def open_program(
        self,
        name: str = "",
        *,
        axes: Sequence[int] | None = None,
        on_disconnect: wire.OnDisconnectWord = "stop",
        grace_s: float = 10.0,
        start_line: int = 1,
        before: Sequence[str] = (),
        resume_of: str | None = None,
        step: bool = False,
        hold: bool = False,
        sha256: str | None = None,
        at_pause: bool = False,
        way: bool = False,
        outputs: wire.OutputsWord | None = None,
        block_delete: bool | None = None,
        optional_stop: bool | None = None,
        deadline_s: float = 5.0,
    ) -> wire.OpenReply:
        """Open a program, queued for its axes.

        Args:
            name: for people: a file's name.
            axes: the axes to lease; None: all of the machine.
            on_disconnect: what happens when the client's liveliness token disappears, or it calls ``leave``.
            grace_s: how long the token may be absent before that; a client that returns in this time
                continues.
            start_line: number of the first line that will run.
            before: lines 1 … start_line - 1. They do not run; the axes move to where these lines end,
                energized, in the modal state that they leave.
            resume_of: id of an earlier program; its journaled lines before ``start_line`` serve as
                ``before``.
            step: single-line mode: a line starts only on a ``step`` call.
            hold: begin held; ``resume`` starts it.
            sha256: of the whole text; its times, from ``simulate`` or ``put_text``, are used for the program.
            at_pause: run now, also on axes of a program that is at a pause, such as to set zero with a new
                tool; refused (MC512) if it would have to wait. Without it a program waits for the other's
                end.
            way: of a start in the middle, as in `ContinueRequest`.
            outputs: of a start in the middle, as in `ContinueRequest`.
            block_delete: lines that begin with ``/`` are skipped, until the program ends; None: they are
                executed as if it were not there, but ``resume_of`` keeps its setting (D-98).
            optional_stop: whether M01 pauses; None: it does, but ``resume_of`` keeps its setting.
        """
        self._declare_token()
        return await self._caller.ask(
            wire.OpenReply,
            "open",
            {
                "name": name,
                "axes": None if axes is None else list(axes),
                "on_disconnect": on_disconnect,
                "grace_s": grace_s,
                "start_line": start_line,
                "before": list(before),
                "resume_of": resume_of,
                "step": step,
                "hold": hold,
                "sha256": sha256,
                "at_pause": at_pause,
                "way": way,
                "outputs": outputs,
                "block_delete": block_delete,
                "optional_stop": optional_stop,
            },
            deadline_s,
        )

    async def continuation(
        self,
        program: str | None = None,
        *,
        line: int | None = None,
        before: Sequence[str] = (),
        axes: Sequence[int] | None = None,
        block_delete: bool | None = None,
        optional_stop: bool | None = None,
        deadline_s: float = 15.0,
    ) -> wire.Continuation:
        """Tell how a program would go on in its middle: what is certain, where the axes are and where it has
        them, and the way between.

        Args:
            program: one that has ended; if others have continued it, the last of these is meant.
            line: the first that would run; None: the one after the last that is done.
            before: lines 1 … line - 1 of a text, instead of ``program``.
            axes: of it; None: all of the machine.
            block_delete: of the text, as in `OpenRequest`; a program keeps its settings.
            optional_stop: of the text, as in `OpenRequest`; a program keeps its settings.
        """
        return await self._caller.ask(
            wire.Continuation,
            "continuation",
            {
                "program": program,
                "line": line,
                "before": list(before),
                "axes": None if axes is None else list(axes),
                "block_delete": block_delete,
                "optional_stop": optional_stop,
            },
            deadline_s,
        )

    async def open_continuation(
        self,
        program: str,
        line: int | None = None,
        *,
        way: bool = False,
        outputs: wire.OutputsWord | None = None,
        on_disconnect: wire.OnDisconnectWord = "stop",
        grace_s: float = 10.0,
        hold: bool = False,
        deadline_s: float = 15.0,
    ) -> wire.ContinueReply:
        """Go on with a program that has ended: energize what it had, bring the axes to where the line starts,
        and run it to its end from the lines that the journal has.

        Args:
            program: as in `ContinuationRequest`.
            line: as in `ContinuationRequest`.
            way: axes may move as `continuation` shows, if the machine file names no safe way.
            outputs: set what the program had switched, or leave it as it is; None: not specified.
            on_disconnect: as in `OpenRequest`.
            grace_s: as in `OpenRequest`.
            hold: begin held.
        """
        self._declare_token()
        return await self._caller.ask(
            wire.ContinueReply,
            "continue_program",
            {
                "program": program,
                "line": line,
                "way": way,
                "outputs": outputs,
                "on_disconnect": on_disconnect,
                "grace_s": grace_s,
                "hold": hold,
            },
            deadline_s,
        )

    async def leave(self, *, deadline_s: float = 5.0) -> tuple[str, ...]:
        """End this client's programs as their ``on_disconnect`` says, without their grace: it goes."""
        return (await self._caller.ask(wire.Done, "leave", {}, deadline_s)).programs

    async def submit_lines(
        self,
        program: str,
        first: int,
        lines: Sequence[str],
        *,
        judge: bool = True,
        rejections: int | None = None,
        deadline_s: float = 5.0,
    ) -> wire.SubmitReply:
        """Send lines, and get the verdict on their words."""
        return await self._caller.ask(
            wire.SubmitReply,
            "submit",
            {
                "program": program,
                "first": first,
                "lines": list(lines),
                "judge": judge,
                "rejections": rejections,
            },
            deadline_s,
        )

    async def close_program(
        self, program: str, last: int | None = None, *, deadline_s: float = 5.0
    ) -> wire.CloseReply:
        """Say that no more lines will come."""
        return await self._caller.ask(
            wire.CloseReply, "close", {"program": program, "last": last}, deadline_s
        )

    async def hold(self, program: str | None = None, *, deadline_s: float = 5.0) -> tuple[str, ...]:
        """Hold the feed along the path, of one program or all."""
        return (await self._caller.ask(wire.Done, "hold", {"program": program}, deadline_s)).programs

    async def resume(self, program: str | None = None, *, deadline_s: float = 5.0) -> tuple[str, ...]:
        """End a hold, M00 or M01, of one program or all."""
        return (await self._caller.ask(wire.Done, "resume", {"program": program}, deadline_s)).programs

    async def step(self, program: str, *, deadline_s: float = 5.0) -> tuple[str, ...]:
        """Start the next line of a program opened with ``step``."""
        return (await self._caller.ask(wire.Done, "step", {"program": program}, deadline_s)).programs

    async def abort(self, program: str | None = None, *, deadline_s: float = 5.0) -> tuple[str, ...]:
        """Stop along the path, then drop the rest of the program, of one or all."""
        return (await self._caller.ask(wire.Done, "abort", {"program": program}, deadline_s)).programs

    async def override(
        self, percent: float, program: str | None = None, *, deadline_s: float = 5.0
    ) -> wire.OverrideReply:
        """Set the feed override of one program, or of all and those to come."""
        return await self._caller.ask(
            wire.OverrideReply, "override", {"percent": percent, "program": program}, deadline_s
        )

    async def jog(
        self,
        axis: int,
        distance: float | None = None,
        *,
        velocity: float | None = None,
        hold_s: float | None = None,
        program: str | None = None,
        by: str = "",
        deadline_s: float = 5.0,
    ) -> str:
        """Move one axis by hand.

        Args:
            distance: from where it is, signed [mm, deg]; None: until stopped or the limit, by the sign of
                ``velocity``.
            velocity: [mm/s, deg/s]; None: a tenth of the axis's limit.
            hold_s: dead-man timeout: the axis stops unless the same jog is requested again within it; None:
                no timeout. A jog without distance always has one (default 0.5 s).
            program: id of the running jog that this request keeps alive.
            by: the person, if a client serves several: steps of one person follow each other, those of
                another person are refused (MC512) while the axis moves.
        """
        self._declare_token()
        return (
            await self._caller.ask(
                wire.JogReply,
                "jog",
                {
                    "axis": axis,
                    "distance": distance,
                    "velocity": velocity,
                    "hold_s": hold_s,
                    "program": program,
                    "by": by,
                },
                deadline_s,
            )
        ).program

    async def jog_tool(
        self,
        tool: int,
        word: wire.ToolDirectionWord,
        velocity: float,
        frame: wire.ToolFrameWord = "base",
        *,
        hold_s: float | None = None,
        program: str | None = None,
        by: str = "",
        deadline_s: float = 5.0,
    ) -> wire.ToolJogReply:
        """Move a tool by hand while it is held: straight on, or turning, until a joint ends its way.

        Args:
            tool: number of the machine file.
            word: X Y Z to move along that axis of ``frame``, A B C to turn about it with the tip at rest.
            velocity: of the tip [mm/s], of a turn [deg/s], signed. Near a singular position, and where a
                joint's limit is lower, it is slower.
            frame: the base, or the tool itself.
            hold_s: dead-man timeout, as in ``jog`` (default 0.5 s).
            program: id of the running jog that this request keeps alive.
            by: the person, if a client serves several.
        """
        self._declare_token()
        return await self._caller.ask(
            wire.ToolJogReply,
            "jog_tool",
            {
                "tool": tool,
                "word": word,
                "velocity": velocity,
                "frame": frame,
                "hold_s": hold_s,
                "program": program,
                "by": by,
            },
            deadline_s,
        )

    async def machine_file(self, *, deadline_s: float = 5.0) -> wire.MachineFileReply:
        """The machine file that the server was started with."""
        return await self._caller.ask(wire.MachineFileReply, "machine_file", {}, deadline_s)

    async def write_machine_file(
        self, text: str, sha256: str, *, only_check: bool = False, by: str = "", deadline_s: float = 5.0
    ) -> wire.WriteMachineFileReply:
        """Check another text of the machine file and, where it has no error, write it at rest.

        The old one is kept beside it; the server goes by the new one when it is restarted.

        Args:
            text: all of the new file.
            sha256: of the text that was edited, as ``machine_file`` returned it.
            only_check: nothing is written.
            by: the person, if a client serves several.
        """
        return await self._caller.ask(
            wire.WriteMachineFileReply,
            "write_machine_file",
            {"text": text, "sha256": sha256, "only_check": only_check, "by": by},
            deadline_s,
        )

    async def open_servo(
        self,
        axes: Sequence[int] | None = None,
        *,
        name: str = "",
        low: Mapping[int, float] | None = None,
        high: Mapping[int, float] | None = None,
        deadline_s: float = 5.0,
    ) -> wire.ServoReply:
        """Let axes follow targets that this client streams.

        They are energized and leased until ``close``, or until no targets come in time.

        Args:
            axes: the axes to lease, all free now; None: all of the machine.
            name: for people.
            low: lowest position that targets may command, by axis number as text [mm or deg]; only together
                with ``high``. A machine with bodies or zones needs both: if these would not stay clear
                everywhere between, the program ends as faulted and nothing moves.
            high: highest position that targets may command, by axis number as text [mm or deg].
        """
        self._declare_token()
        return await self._caller.ask(
            wire.ServoReply,
            "open_servo",
            {
                "axes": None if axes is None else list(axes),
                "name": name,
                "low": None if low is None else {str(key): each for key, each in low.items()},
                "high": None if high is None else {str(key): each for key, each in high.items()},
            },
            deadline_s,
        )

    async def servo_armed(
        self,
        axes: Sequence[int] | None = None,
        *,
        name: str = "",
        low: Mapping[int, float] | None = None,
        high: Mapping[int, float] | None = None,
        deadline_s: float = 5.0,
    ) -> wire.ServoReply:
        """Let axes follow targets, as ``open_servo``, inside of what an operator has approved for a while:
        ``arm`` with ``standing_s`` and ``servo``.

        Args:
            axes: the axes to lease, all free now; None: all of the machine.
            name: for people.
            low: lowest position that targets may command, by axis number as text [mm or deg]; only together
                with ``high``. A machine with bodies or zones needs both: if these would not stay clear
                everywhere between, the program ends as faulted and nothing moves.
            high: highest position that targets may command, by axis number as text [mm or deg].
        """
        self._declare_token()
        return await self._caller.ask(
            wire.ServoReply,
            "servo_armed",
            {
                "axes": None if axes is None else list(axes),
                "name": name,
                "low": None if low is None else {str(key): each for key, each in low.items()},
                "high": None if high is None else {str(key): each for key, each in high.items()},
            },
            deadline_s,
        )

    async def home(self, axes: Sequence[int] | None = None, *, deadline_s: float = 5.0) -> wire.HomeReply:
        """Let axes find their references.

        It goes on after the reply: the events ``axis.homing``, ``axis.homed`` and ``program.ended`` say how.
        """
        self._declare_token()
        return await self._caller.ask(
            wire.HomeReply, "home", {"axes": None if axes is None else list(axes)}, deadline_s
        )

    async def reference(self, positions: Mapping[int, float], *, deadline_s: float = 5.0) -> tuple[str, ...]:
        """Say where axes are; nothing moves."""
        return (
            await self._caller.ask(
                wire.Done,
                "reference",
                {"positions": {str(key): each for key, each in positions.items()}},
                deadline_s,
            )
        ).programs

    async def reset(self, axes: Sequence[int] | None = None, *, deadline_s: float = 5.0) -> tuple[str, ...]:
        """Clear a latched fault or emergency stop.

        Axes stay without energy until captured (G1010).
        """
        return (
            await self._caller.ask(
                wire.Done, "reset", {"axes": None if axes is None else list(axes)}, deadline_s
            )
        ).programs

    async def tables(self, *, deadline_s: float = 5.0) -> wire.Tables:
        """Tell the work offsets and tools that programs start with, and who changed them.

        They are changed by programs: G10 L2, L20 and L1.
        """
        return await self._caller.ask(wire.Tables, "tables", {}, deadline_s)

    async def set_table_row(
        self,
        row: str,
        name: str | None = None,
        *,
        life_min: float | None = None,
        used_min: float | None = None,
        by: str = "",
        deadline_s: float = 5.0,
    ) -> tuple[str, ...]:
        """Name a work offset or a tool, or say how long a tool may cut and has cut.

        Args:
            row: ``G54`` to ``G59.3``, or ``T3``.
            name: for people; empty removes it.
            life_min: how long the tool may cut; 0: no limit.
            used_min: how long it has cut, 0 when a new one is fitted.
            by: the person, if a client serves several.
        """
        return (
            await self._caller.ask(
                wire.Done,
                "set_table_row",
                {"row": row, "name": name, "life_min": life_min, "used_min": used_min, "by": by},
                deadline_s,
            )
        ).programs

    async def set_output(self, output: str, value: bool | float, *, deadline_s: float = 5.0) -> wire.SetReply:
        """Set an output by hand."""
        return await self._caller.ask(
            wire.SetReply, "set_output", {"output": output, "value": value}, deadline_s
        )

    async def set_simulated_input(
        self, input: str, value: bool | float, *, deadline_s: float = 5.0
    ) -> wire.SetReply:
        """Set a simulated input."""
        return await self._caller.ask(
            wire.SetReply, "set_simulated_input", {"input": input, "value": value}, deadline_s
        )

    async def call_estop(
        self, reason: str = "", *, client: str = "", deadline_s: float = 5.0
    ) -> tuple[str, ...]:
        """Stop everything at once: emergency stop.

        No safety function; the key ``estop`` is the faster way.

        Args:
            reason: for people.
            client: on the key ``estop``, who stops, by its own account; a call has it in its key.
        """
        return (
            await self._caller.ask(wire.Done, "estop", {"reason": reason, "client": client}, deadline_s)
        ).programs

    async def check(
        self,
        text: str | None = None,
        *,
        positions: Mapping[int, float] | None = None,
        sha256: str | None = None,
        block_delete: bool | None = None,
        optional_stop: bool | None = None,
        deadline_s: float = 300.0,
    ) -> wire.CheckReply:
        """Find every fault of a program's text; nothing runs.

        Args:
            text: the whole text; or sha256: of one that was uploaded by ``put_text``.
            positions: start the axes there [mm, deg].
            block_delete: as of `OpenRequest`.
            optional_stop: as of `OpenRequest`.
        """
        return await self._caller.ask(
            wire.CheckReply,
            "check",
            {
                "text": text,
                "positions": None
                if positions is None
                else {str(key): each for key, each in positions.items()},
                "sha256": sha256,
                "block_delete": block_delete,
                "optional_stop": optional_stop,
            },
            deadline_s,
        )

    async def simulate(
        self,
        text: str,
        positions: Mapping[int, float] | None = None,
        *,
        path_points: int = 0,
        lines: bool = True,
        assertions: Sequence[wire.Assertion] = (),
        against: str | None = None,
        role: wire.RunRoleWord | None = None,
        block_delete: bool | None = None,
        optional_stop: bool | None = None,
        deadline_s: float = 300.0,
    ) -> wire.SimulateReply:
        """Run a program's text on a virtual clock: its times, travels and faults.

        Args:
            positions: start the axes there [mm, deg]; None: where the machine file starts simulated drives.
            path_points: maximum number of points in the reply's `path`; 0: no path.
            lines: whether the reply has the times of every line.
            assertions: are judged on every setpoint; one that does not hold is a fault (MC330).
            against: another program's text, from the same start: the reply has the `difference` to its
                motion.
            role: whose run it is: `agent`, one that a person approves, or `operator`, any other; zones of the
                other role do not count. None: all zones count.
            block_delete: as of `OpenRequest`.
            optional_stop: as of `OpenRequest`.
        """
        return await self._caller.ask(
            wire.SimulateReply,
            "simulate",
            {
                "text": text,
                "positions": None
                if positions is None
                else {str(key): each for key, each in positions.items()},
                "path_points": path_points,
                "lines": lines,
                "assertions": list(assertions),
                "against": against,
                "role": role,
                "block_delete": block_delete,
                "optional_stop": optional_stop,
            },
            deadline_s,
        )

    async def put_text_part(
        self, sha256: str, size: int, offset: int, part: bytes, *, deadline_s: float = 60.0
    ) -> wire.PutTextReply:
        """Hand a long text over by parts.

        Args:
            sha256: of the whole text in UTF-8.
            size: of the whole text [bytes].
            offset: where the part begins [bytes].
            part: its bytes; characters may be split.
        """
        return await self._caller.ask(
            wire.PutTextReply,
            "put_text",
            {"sha256": sha256, "size": size, "offset": offset, "part": part},
            deadline_s,
        )

    async def request_run(
        self,
        text: str,
        name: str = "",
        *,
        axes: Sequence[int] | None = None,
        certificate: str | None = None,
        block_delete: bool | None = None,
        optional_stop: bool | None = None,
        deadline_s: float = 300.0,
    ) -> wire.RunRequestReply:
        """Ask for a run that an operator has to arm.

        The text is checked and simulated from where the axes stand, and nothing moves.

        Args:
            text: the program.
            name: for people.
            axes: the only axes that it may move; None: those named in the text.
            certificate: a file of ``mcserver certify`` for exactly this run, which arms it; None: a person
                must.
            block_delete: as in `OpenRequest`, and part of what is approved; a certificate has its own.
            optional_stop: as in `OpenRequest`, and part of what is approved; a certificate has its own.
        """
        self._declare_token()
        return await self._caller.ask(
            wire.RunRequestReply,
            "request_run",
            {
                "text": text,
                "name": name,
                "axes": None if axes is None else list(axes),
                "certificate": certificate,
                "block_delete": block_delete,
                "optional_stop": optional_stop,
            },
            deadline_s,
        )

    async def run_requests(self, *, deadline_s: float = 5.0) -> tuple[wire.RunRequestStatus, ...]:
        """List what waits for an operator, is armed, or was started lately."""
        return (await self._caller.ask(wire.RunRequestsReply, "run_requests", {}, deadline_s)).requests

    async def run_approvals(self, *, deadline_s: float = 5.0) -> tuple[wire.RunRequestStatus, ...]:
        """List the runs whose envelope was approved for a while."""
        return (await self._caller.ask(wire.RunRequestsReply, "run_approvals", {}, deadline_s)).requests

    async def run_preview(self, sha256: str, *, deadline_s: float = 5.0) -> wire.RunPreviewReply:
        """Show what an operator looks at before arming: the text and its simulated path.

        Args:
            sha256: of the text, or at least its first 8 digits.
        """
        return await self._caller.ask(wire.RunPreviewReply, "run_preview", {"sha256": sha256}, deadline_s)

    async def arm(
        self,
        sha256: str,
        seconds: float = 60.0,
        *,
        override: float = 100.0,
        number: int | None = None,
        standing_s: float = 0.0,
        servo: bool = False,
        deadline_s: float = 5.0,
    ) -> wire.RunRequestStatus:
        """Allow a requested run to be started once.

        Args:
            sha256: of the text, or at least its first 8 digits.
            seconds: how long it may be started.
            override: the greatest feed override [%].
            number: of the request that was reviewed: one that was repeated since is not armed; None: any.
            standing_s: for this time every other run that the same client requests, and that stays inside the
                envelope of this run, is armed at its request; 0: only this run, once.
            servo: for the same time it may also stream targets, inside the extents, speeds and duration of
                this run (`servo_armed`); no simulation shows these beforehand.
        """
        return await self._caller.ask(
            wire.RunRequestStatus,
            "arm",
            {
                "sha256": sha256,
                "seconds": seconds,
                "override": override,
                "number": number,
                "standing_s": standing_s,
                "servo": servo,
            },
            deadline_s,
        )

    async def reject(
        self, sha256: str, reason: str = "", *, number: int | None = None, deadline_s: float = 5.0
    ) -> wire.RunRequestStatus:
        """Say no to a requested run, and why.

        Args:
            sha256: of the text, or at least its first 8 digits.
            number: as in `ArmRequest`.
        """
        return await self._caller.ask(
            wire.RunRequestStatus,
            "reject",
            {"sha256": sha256, "reason": reason, "number": number},
            deadline_s,
        )

    async def withdraw(self, sha256: str, *, deadline_s: float = 5.0) -> tuple[wire.RunRequestStatus, ...]:
        """Take a requested run back; only the user who asked may.

        Args:
            sha256: of the text, or at least its first 8 digits.
        """
        return (
            await self._caller.ask(wire.RunRequestsReply, "withdraw", {"sha256": sha256}, deadline_s)
        ).requests

    async def run_armed(
        self, text: str, grace_s: float = 10.0, *, deadline_s: float = 15.0
    ) -> wire.RunArmedReply:
        """Start a program that is armed.

        Args:
            grace_s: as in `OpenRequest`.
        """
        self._declare_token()
        return await self._caller.ask(
            wire.RunArmedReply, "run_armed", {"text": text, "grace_s": grace_s}, deadline_s
        )

    async def record_start(
        self, name: str = "", *, max_s: float | None = None, deadline_s: float = 5.0
    ) -> str:
        """Record every cycle into a file on the server from now on.

        Args:
            name: of the recording; empty: the time.
            max_s: when it ends by itself; None: only when it is stopped.
        """
        return (
            await self._caller.ask(
                wire.RecordReply, "record_start", {"name": name, "max_s": max_s}, deadline_s
            )
        ).name

    async def record_stop(self, name: str = "", *, deadline_s: float = 90.0) -> str:
        """End a recording; answered once the file is whole."""
        return (await self._caller.ask(wire.RecordReply, "record_stop", {"name": name}, deadline_s)).name

    async def record_save(self, reason: str = "asked", *, deadline_s: float = 90.0) -> str:
        """Write out the black box, the last minutes."""
        return (await self._caller.ask(wire.RecordReply, "record_save", {"reason": reason}, deadline_s)).name

    async def recordings(self, *, deadline_s: float = 5.0) -> wire.RecordingsReply:
        """List the recordings on the server's disk."""
        return await self._caller.ask(wire.RecordingsReply, "recordings", {}, deadline_s)

    async def recording_read(
        self, name: str, offset: int = 0, *, size: int = 1048576, deadline_s: float = 15.0
    ) -> wire.RecordingPart:
        """Read part of a recording's file."""
        return await self._caller.ask(
            wire.RecordingPart, "recording_read", {"name": name, "offset": offset, "size": size}, deadline_s
        )

    async def model(self, *, deadline_s: float = 15.0) -> wire.ModelReply:
        """Tell what the machine looks like: its URDF."""
        return await self._caller.ask(wire.ModelReply, "model", {}, deadline_s)

    async def model_mesh(
        self, mesh: int, offset: int = 0, *, size: int = 1048576, deadline_s: float = 15.0
    ) -> wire.ModelPart:
        """Read part of a mesh's file."""
        return await self._caller.ask(
            wire.ModelPart, "model_mesh", {"mesh": mesh, "offset": offset, "size": size}, deadline_s
        )

    async def drives(self, *, deadline_s: float = 5.0) -> tuple[wire.DriveInfo, ...]:
        """List every drive on a bus, by axis."""
        return (await self._caller.ask(wire.DrivesReply, "drives", {}, deadline_s)).drives

    async def drives_scan(self, bus: str = "", *, deadline_s: float = 15.0) -> tuple[wire.BusScan, ...]:
        """Ask who is on a bus, or on all: every node number of CAN, the slaves of EtherCAT.

        Nothing is configured.
        """
        return (await self._caller.ask(wire.DrivesScanReply, "drives_scan", {"bus": bus}, deadline_s)).buses

    async def drive_parameters(self, axis: int, *, deadline_s: float = 5.0) -> wire.DriveParameters:
        """List the objects of a drive's dictionary by the names of its EDS, with types, access and limits.

        The drive is not asked.
        """
        return await self._caller.ask(wire.DriveParameters, "drive_parameters", {"axis": axis}, deadline_s)

    async def drives_health(
        self, seconds: float = 5.0, *, deadline_s: float = 15.0
    ) -> tuple[wire.BusHealth, ...]:
        """Listen on the buses for some seconds and count load, lost and late frames.

        Nothing is sent.
        """
        return (
            await self._caller.ask(wire.DrivesHealthReply, "drives_health", {"seconds": seconds}, deadline_s)
        ).buses

    async def drive_scope(
        self,
        axis: int,
        seconds: float = 2.0,
        *,
        trigger: str = "",
        level: bool = False,
        before_s: float | None = None,
        timeout_s: float = 10.0,
        deadline_s: float = 90.0,
    ) -> wire.DriveTrace:
        """Record every mapped object of an axis in each cycle, around a trigger.

        Nothing is sent.

        Args:
            seconds: time kept.
            trigger: such as ``following error > 0.05``; empty: at once.
            level: fires also if the level is already met.
            before_s: kept before the trigger; None: a quarter.
            timeout_s: how long the trigger may take.
        """
        return await self._caller.ask(
            wire.DriveTrace,
            "drive_scope",
            {
                "axis": axis,
                "seconds": seconds,
                "trigger": trigger,
                "level": level,
                "before_s": before_s,
                "timeout_s": timeout_s,
            },
            deadline_s,
        )

    async def drive_tune(
        self, axis: int, seconds: float = 20.0, *, deadline_s: float = 90.0
    ) -> wire.DriveTuning:
        """Judge the gains of an axis in mode cst or csv by the motion of a program.

        Nothing is sent.
        """
        return await self._caller.ask(
            wire.DriveTuning, "drive_tune", {"axis": axis, "seconds": seconds}, deadline_s
        )

    async def sdo_read(
        self,
        index: int,
        subindex: int = 0,
        *,
        axis: int | None = None,
        node: int | None = None,
        bus: str = "",
        type: wire.SdoTypeWord | None = None,
        deadline_s: float = 15.0,
    ) -> wire.SdoReply:
        """Read an object of a drive's dictionary.

        Args:
            index: of the object.
            subindex: of the object.
            axis: whose drive; or ``node``, with ``bus`` where several buses have that number.
            type: how to read the bytes; None: by the drive's EDS, or the standard's objects.
        """
        return await self._caller.ask(
            wire.SdoReply,
            "sdo_read",
            {"index": index, "subindex": subindex, "axis": axis, "node": node, "bus": bus, "type": type},
            deadline_s,
        )

    async def sdo_write(
        self,
        index: int,
        value: wire.Value,
        subindex: int = 0,
        *,
        axis: int | None = None,
        node: int | None = None,
        bus: str = "",
        type: wire.SdoTypeWord | None = None,
        deadline_s: float = 15.0,
    ) -> wire.SdoReply:
        """Write an object of a drive's dictionary, unless that would fight the cycle."""
        return await self._caller.ask(
            wire.SdoReply,
            "sdo_write",
            {
                "index": index,
                "subindex": subindex,
                "axis": axis,
                "node": node,
                "bus": bus,
                "type": type,
                "value": value,
            },
            deadline_s,
        )
