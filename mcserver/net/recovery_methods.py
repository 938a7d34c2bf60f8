"""Remote methods ``continuation`` and ``continue_program``."""

from __future__ import annotations

from collections.abc import Sequence

from mcserver.errors import Refused
from mcserver.gcode.modal_codes import modal_codes
from mcserver.gcode.switches import Switches
from mcserver.net import recovery_messages as wire
from mcserver.net.text_forecast import TextForecast
from mcserver.service.approach import Confirmation
from mcserver.service.axes_of_requests import axes_of
from mcserver.service.journal_reader import RecordedProgram
from mcserver.service.recovering import Start
from mcserver.service.service import MachineService


class RecoveryMethods:
    """Handles the messages for one machine's service."""

    def __init__(self, service: MachineService, forecast: TextForecast) -> None:
        self._service = service
        self._forecast = forecast

    async def continuation(self, _client: str, request: wire.ContinuationRequest) -> wire.Continuation:
        recovery = self._service.recovery
        if request.program is None:
            if not request.before:
                raise Refused("MC511", "neither a program nor lines before are given", "give one of them")
            axes, line = axes_of(self._service.machine, request.axes), len(request.before) + 1
            switches = Switches.of(request.block_delete, request.optional_stop)
            start = await recovery.start_of(axes, line, before=request.before, switches=switches)
            return self._shown(None, line, (1, []), start, axes)
        found = await recovery.recorded(request.program)
        status = found.status
        line = status.done + 1 if request.line is None else request.line
        start = await recovery.start_of(status.axes, line, program=status.program)
        return self._shown(found, line, await recovery.excerpt(status.program, line), start, status.axes)

    async def continue_program(self, client: str, request: wire.ContinueRequest) -> wire.ContinueReply:
        program = await self._service.continue_program(
            client,
            request.program,
            request.line,
            confirmed=Confirmation(request.way, request.outputs),
            on_disconnect=request.on_disconnect,
            grace_s=request.grace_s,
            hold=request.hold,
        )
        self._forecast.begin(program.sha256)
        detail = f"line {program.start_line}"
        self._service.record_command(client, "continue_program", program.program, detail)
        await self._service.recorded(program)
        return wire.ContinueReply(
            program=program.program,
            state=program.state,
            axes=list(program.axes),
            expected=program.queue.expected,
            credit=program.credit,
            instance=self._service.options.instance,
            line=program.start_line,
            resume_of=program.resume_of or "",
            whole=program.closed,
        )

    def _shown(
        self,
        found: RecordedProgram | None,
        line: int,
        excerpt: tuple[int, list[str]],
        start: Start,
        axes: Sequence[int],
    ) -> wire.Continuation:
        approach = None if start.state is None else self._service.recovery.plan(start, axes)
        status = None if found is None else found.status
        first, lines = excerpt
        return wire.Continuation(
            program="" if status is None else status.program,
            name="" if status is None else status.name,
            state=None if status is None else status.state,
            done=line - 1 if status is None else status.done,
            accepted=line - 1 if status is None else status.accepted,
            whole=found is not None and found.whole,
            sha256=None if found is None else found.sha256,
            line=line,
            first=first,
            lines=lines,
            block_delete=start.switches.block_delete,
            optional_stop=start.switches.optional_stop,
            modal=[] if start.state is None else modal_codes(start.state.modal),
            energize=[] if approach is None else list(approach.energize),
            axes=[] if approach is None else list(approach.axes),
            way=[] if approach is None else list(approach.way),
            switched=[] if approach is None else list(approach.switched),
            needs=[] if approach is None else list(approach.needs),
        )
