"""The remote methods of a machine: from requests to calls of the service, and to replies."""

from __future__ import annotations

from collections.abc import Awaitable
from typing import TYPE_CHECKING

from mcserver.canopen import views
from mcserver.errors import Refused, ServiceError
from mcserver.gcode.profiles.codes import ACTING
from mcserver.gcode.profiles.frame import LENGTH_AXIS
from mcserver.gcode.switches import Switches
from mcserver.net import drive_messages as drive_wire
from mcserver.net import messages as wire
from mcserver.net.arming_methods import ArmingMethods
from mcserver.net.info_messages import Info
from mcserver.net.machine_file_methods import MachineFileMethods
from mcserver.net.method_binding import bound_handlers
from mcserver.net.method_table import METHODS
from mcserver.net.model_methods import ModelMethods
from mcserver.net.recording_methods import RecordingMethods
from mcserver.net.recovery_methods import RecoveryMethods
from mcserver.net.rpc import Handler
from mcserver.net.servo_methods import ServoMethods
from mcserver.net.status import EdgeUnits, machine_info, machine_status
from mcserver.net.table_messages import SetTableRowRequest, Tables, TablesRequest
from mcserver.net.text_forecast import TextForecast
from mcserver.net.text_methods import TextMethods
from mcserver.recorder.client import RecorderClient
from mcserver.service.approach import Confirmation
from mcserver.service.axes_of_requests import positions_in_si
from mcserver.service.homing import HomingService
from mcserver.service.jog import Jogging
from mcserver.service.program import Program
from mcserver.service.program_options import ProgramOptions
from mcserver.service.reports import MachineStatus
from mcserver.service.service import MachineService
from mcserver.service.servo import close_targets
from mcserver.simulation.program_checker import ProgramChecker
from mcserver.units import MINUTE

if TYPE_CHECKING:
    # needs the packages of CANopen
    from mcserver.canopen.access import OperatorAccess


def machine_methods(
    service: MachineService,
    jogging: Jogging,
    checker: ProgramChecker,
    drives: OperatorAccess | None,
    recorder: RecorderClient | None = None,
) -> dict[str, Handler]:
    """Return the handler of each method by its name, for one machine's service."""
    forecast = TextForecast(service, checker)
    return bound_handlers(
        (
            ProgramMethods(service, jogging, drives, forecast),
            TextMethods(service, checker, forecast),
            ArmingMethods(service, checker),
            RecordingMethods(service, recorder),
            ModelMethods(service.machine),
            RecoveryMethods(service, forecast),
            ServoMethods(service),
            MachineFileMethods(service),
        )
    )


class ProgramMethods:
    """Handles messages about programs, axes, channels and drives for one machine's service."""

    def __init__(
        self, service: MachineService, jogging: Jogging, drives: OperatorAccess | None, forecast: TextForecast
    ) -> None:
        self._service = service
        self._record = service.record_command
        self._jogging = jogging
        self._drives = drives
        self._forecast = forecast
        self._units = EdgeUnits(service.machine)
        self._homing = HomingService(service)

    async def open(self, client: str, request: wire.OpenRequest) -> wire.OpenReply:
        program = await self._service.open(
            client,
            ProgramOptions(
                name=request.name,
                axes=request.axes,
                on_disconnect=request.on_disconnect,
                grace_s=request.grace_s,
                start_line=request.start_line,
                before=request.before,
                resume_of=request.resume_of,
                step=request.step,
                switches=Switches.of(request.block_delete, request.optional_stop),
                hold=request.hold,
                sha256=request.sha256,
                at_pause=request.at_pause,
                confirmed=Confirmation(request.way, request.outputs),
            ),
        )
        if request.at_pause and program.state == "queued":
            self._service.abort(program.program, "8 programs run")
            raise Refused("MC512", "8 programs run", "wait until one has ended")
        self._forecast.begin(request.sha256)
        await self._service.recorded(program)
        return wire.OpenReply(
            program=program.program,
            state=program.state,
            axes=list(program.axes),
            expected=program.queue.expected,
            credit=program.credit,
            instance=self._service.options.instance,
        )

    def leave(self, client: str, _request: wire.LeaveRequest) -> wire.Done:
        return _done(self._service.absences.leave(client))

    def submit(self, client: str, request: wire.SubmitRequest) -> Awaitable[wire.SubmitReply]:
        taken = self._service.lines.submit(
            client, request.program, request.first, request.lines, request.rejections, judge=request.judge
        )
        return _submit_reply(taken)

    def close(self, client: str, request: wire.CloseRequest) -> Awaitable[wire.CloseReply]:
        closed = self._service.lines.close(client, request.program, request.last)
        close_targets(self._service, self._service.program(request.program))
        return _close_reply(closed)

    def hold(self, client: str, request: wire.ProgramRequest) -> wire.Done:
        held = self._service.hold(request.program)
        self._record(client, "hold", request.program)
        return _done(held)

    def resume(self, client: str, request: wire.ProgramRequest) -> wire.Done:
        resumed = self._service.resume(request.program)
        self._record(client, "resume", request.program)
        return _done(resumed)

    def abort(self, client: str, request: wire.ProgramRequest) -> wire.Done:
        aborted = self._service.abort(request.program, f"aborted by {client}")
        self._record(client, "abort", request.program)
        return _done(aborted)

    def step(self, client: str, request: wire.StepRequest) -> wire.Done:
        return _done([self._service.step(client, request.program)])

    def override(self, client: str, request: wire.OverrideRequest) -> wire.OverrideReply:
        programs = self._service.set_override(request.percent / 100.0, request.program)
        self._record(client, "override", request.program, f"{request.percent:g} %")
        return wire.OverrideReply(request.percent, [program.program for program in programs])

    async def jog(self, client: str, request: wire.JogRequest) -> wire.JogReply:
        program = await self._jogging.jog(
            client,
            request.axis,
            by=request.by,
            distance=request.distance,
            velocity=request.velocity,
            hold_s=request.hold_s,
            program_id=request.program,
        )
        if request.program is None:
            self._record(client, "jog", program, f"axis {request.axis}")
        return wire.JogReply(program)

    async def jog_tool(self, client: str, request: wire.ToolJogRequest) -> wire.ToolJogReply:
        program, obstacle = await self._jogging.jog_tool(
            client,
            request.tool,
            request.word,
            request.velocity,
            frame=request.frame,
            by=request.by,
            hold_s=request.hold_s,
            program_id=request.program,
        )
        if request.program is None:
            self._record(client, "jog_tool", program, f"tool {request.tool} {request.word}")
        return wire.ToolJogReply(program, obstacle)

    async def home(self, client: str, request: wire.HomeRequest) -> wire.HomeReply:
        program = await self._homing.home(client, request.axes)
        self._record(client, "home", program.program, " ".join(f"axis {axis}" for axis in program.axes))
        return wire.HomeReply(program.program, list(program.axes))

    async def reference(self, client: str, request: wire.ReferenceRequest) -> wire.Done:
        positions = positions_in_si(self._service.machine, request.positions)
        program = await self._homing.reference(client, positions)
        shown = ", ".join(f"axis {axis} at {at:g}" for axis, at in request.positions.items())
        self._record(client, "reference", program.program, shown)
        return _done([program])

    def reset(self, client: str, request: wire.ResetRequest) -> wire.Done:
        self._service.reset(request.axes)
        self._record(client, "reset")
        return wire.Done([])

    def set_output(self, client: str, request: wire.SetOutputRequest) -> wire.SetReply:
        value = self._service.set_output(request.output, request.value)
        self._record(client, "set_output", None, f"{request.output} = {value:g}")
        return wire.SetReply(request.output, value)

    def set_simulated_input(self, client: str, request: wire.SetInputRequest) -> wire.SetReply:
        value = self._service.channels.set_input(request.input, request.value)
        self._record(client, "set_simulated_input", None, f"{request.input} = {value:g}")
        return wire.SetReply(request.input, value)

    def estop(self, client: str, request: wire.EstopRequest) -> wire.Done:
        self._service.latch.emergency_stop(client, request.reason)
        return wire.Done([])

    def status(self, _client: str, _request: wire.StatusRequest) -> MachineStatus:
        return machine_status(self._service, self._units)

    async def programs(self, _client: str, request: wire.ProgramsRequest) -> wire.ProgramsReply:
        return wire.ProgramsReply(
            await self._service.known(program_id=request.program, ended=request.ended, limit=request.limit)
        )

    def events(self, _client: str, request: wire.EventsRequest) -> wire.EventsReply:
        log = self._service.events
        return wire.EventsReply(
            instance=self._service.options.instance,
            oldest=log.oldest,
            newest=log.newest,
            events=log.since(request.since, request.limit),
        )

    async def drives(self, _client: str, _request: drive_wire.DrivesRequest) -> drive_wire.DrivesReply:
        return drive_wire.DrivesReply([] if self._drives is None else await self._drives.drives())

    async def drives_scan(
        self, _client: str, request: drive_wire.DrivesScanRequest
    ) -> drive_wire.DrivesScanReply:
        return drive_wire.DrivesScanReply(await self._reachable.scan(request.bus))

    def drive_parameters(
        self, _client: str, request: drive_wire.DriveParametersRequest
    ) -> views.DriveParameters:
        return self._reachable.parameters(request.axis)

    async def drives_health(
        self, _client: str, request: drive_wire.DrivesHealthRequest
    ) -> drive_wire.DrivesHealthReply:
        return drive_wire.DrivesHealthReply(await self._reachable.listening.health(request.seconds))

    async def drive_scope(self, _client: str, request: drive_wire.DriveScopeRequest) -> views.DriveTrace:
        return await self._reachable.listening.scope(
            request.axis,
            request.seconds,
            request.trigger,
            request.timeout_s,
            request.before_s,
            level=request.level,
        )

    async def drive_tune(self, _client: str, request: drive_wire.DriveTuneRequest) -> views.DriveTuning:
        return await self._reachable.listening.tune(request.axis, request.seconds)

    async def sdo_read(self, _client: str, request: drive_wire.SdoReadRequest) -> views.SdoReply:
        return await self._reachable.sdo_read(_target(request), request.type)

    async def sdo_write(self, client: str, request: drive_wire.SdoWriteRequest) -> views.SdoReply:
        reply = await self._reachable.sdo_write(_target(request), request.type, request.value)
        where = f"axis {request.axis}" if request.axis is not None else f"node {request.node}"
        self._record(client, "sdo_write", None, f"{where} {request.index:04X}h.{request.subindex}")
        return reply

    @property
    def _reachable(self) -> OperatorAccess:
        if self._drives is None:
            raise ServiceError(
                "MC559",
                "this machine has no drives on a bus",
                "give a machine file with drives on a [[bus]]",
            )
        return self._drives

    def tables(self, _client: str, _request: TablesRequest) -> Tables:
        machine = self._service.machine
        tool_table = "G43" in ACTING[machine.dialect.profile] and machine.axis(LENGTH_AXIS) is not None
        return self._units.tables(self._service.work_tables, tool_table=tool_table)

    def set_table_row(self, client: str, request: SetTableRowRequest) -> wire.Done:
        change = self._service.work_tables.annotate(
            request.row,
            name=request.name,
            life_s=None if request.life_min is None else request.life_min * MINUTE,
            used_s=None if request.used_min is None else request.used_min * MINUTE,
            wall=self._service.options.clock(),
            client=client,
            by=request.by,
        )
        if change is not None:
            who = f" by {request.by}" if request.by else ""
            said = {"name": request.name, "life": request.life_min, "used": request.used_min}
            shown = ", ".join(f"{key} {value!r}" for key, value in said.items() if value is not None)
            self._record(client, "set_table_row", None, f"{request.row}{who}: {shown}")
        return wire.Done([])

    def info(self, _client: str, _request: wire.InfoRequest) -> Info:
        return machine_info(self._service, [method.name for method in METHODS])


def _target(request: drive_wire.SdoReadRequest) -> views.SdoTarget:
    if (request.axis is None) == (request.node is None):
        raise ServiceError("MC511", "an SDO goes to one drive", "give either `axis` or `node`")
    return views.SdoTarget(request.index, request.subindex, request.axis, request.node, request.bus)


async def _submit_reply(taken: Awaitable[Program]) -> wire.SubmitReply:
    program = await taken
    return wire.SubmitReply(program.program, program.journaled, program.done, program.credit, program.epoch)


async def _close_reply(closed: Awaitable[Program]) -> wire.CloseReply:
    program = await closed
    return wire.CloseReply(program.program, program.journaled, program.done, program.state)


def _done(programs: list[Program]) -> wire.Done:
    return wire.Done(programs=[program.program for program in programs])
