"""The remote methods ``request_run``, ``withdraw``, ``run_preview``, ``arm``, ``reject``, ``run_armed``."""

from __future__ import annotations

import asyncio
from collections import Counter
from typing import Any

import msgspec

from mcserver.errors import Diagnostic, Refused, ServiceError
from mcserver.gcode.axes_used import axes_used
from mcserver.gcode.text.source import split_lines
from mcserver.machine.machine_file import Machine
from mcserver.net import arming_messages as wire
from mcserver.service.arming import OPEN, Arming, Extent, RunPath, RunRequest, hash_of
from mcserver.service.reports import wire_diagnostic
from mcserver.service.service import MachineService
from mcserver.simulation.program_checker import ProgramChecker

# a started program begins within so many in-position tolerances of where its simulation began
START_TOLERANCES = 10.0


class ArmingMethods:
    """Binds the messages to one machine's service."""

    def __init__(self, service: MachineService, checker: ProgramChecker) -> None:
        self._service = service
        self._checker = checker
        self._clock = asyncio.get_running_loop().time
        self._arming = Arming(self._clock)
        self._stops = service.latch.stops
        # clients whose requests are being simulated, and those of them that went meanwhile
        self._asking: Counter[str] = Counter()
        self._gone: set[str] = set()
        service.when_gone.append(self._client_gone)

    def _forget_armings(self) -> None:
        """Take every arming back after an emergency stop: the operator looks at the machine again."""
        if self._stops != self._service.latch.stops:
            self._stops = self._service.latch.stops
            self._arming.disarm()

    async def request_run(self, client: str, request: wire.RunRequestRequest) -> wire.RunRequestReply:
        machine = self._service.machine
        self._arming.check_room(client, request.text)
        named = axes_used(request.text, machine)
        axes = named if request.axes is None else tuple(sorted(set(request.axes)))
        if not axes:
            raise Refused("MC511", "the text names no axis, so there is nothing to run", "check the text")
        if not set(named) <= set(axes):
            raise Refused(
                "MC511", f"the text needs the axes {', '.join(map(str, named))}", "ask for all of them"
            )
        positions = self._positions()
        self._asking[client] += 1
        try:
            report, path, marks = await self._checker.preview(
                client, request.text, positions, axes, self._service.work_systems
            )
            if client in self._gone:
                raise Refused("MC570", f"{client} went while its run was simulated", "request the run again")
        finally:
            self._asking -= Counter([client])
            self._gone.intersection_update(self._asking)
        found = [wire_diagnostic(msgspec.convert(each, Diagnostic)) for each in report["diagnostics"]]
        if not report["ok"] or marks is None:
            return wire.RunRequestReply(False, found)
        kept = self._arming.request(
            RunRequest(
                client=client,
                sha256=hash_of(request.text),
                text=request.text,
                name=request.name,
                axes=axes,
                start={axis: positions[axis] for axis in axes},
                duration_s=report["duration_s"],
                extents=_extents(machine, report, axes),
                until=0.0,
                path=msgspec.convert(path, RunPath),
            )
        )
        self._service.foresee(kept.sha256, marks)
        self._publish("run.requested", client, kept)
        return wire.RunRequestReply(True, found, self._status(kept))

    def run_requests(self, _client: str, _request: wire.RunRequestsRequest) -> wire.RunRequestsReply:
        self._forget_armings()
        return wire.RunRequestsReply([self._status(each) for each in self._arming.requests()])

    def run_preview(self, _client: str, request: wire.RunPreviewRequest) -> wire.RunPreviewReply:
        self._forget_armings()
        found = self._arming.find(request.sha256)
        return wire.RunPreviewReply(self._status(found), found.text, found.path)

    def arm(self, client: str, request: wire.ArmRequest) -> wire.RunRequestStatus:
        self._forget_armings()
        armed = self._arming.arm(
            client,
            request.sha256,
            seconds=request.seconds,
            override=request.override / 100.0,
            number=request.number,
        )
        self._publish("run.armed", client, armed)
        return self._status(armed)

    def reject(self, client: str, request: wire.RejectRequest) -> wire.RunRequestStatus:
        rejected = self._arming.reject(client, request.sha256, request.reason, number=request.number)
        self._publish("run.rejected", client, rejected)
        return self._status(rejected)

    def withdraw(self, client: str, request: wire.WithdrawRequest) -> wire.RunRequestsReply:
        withdrawn = self._arming.withdraw(client, request.sha256)
        self._publish("run.withdrawn", client, withdrawn)
        return self.run_requests(client, wire.RunRequestsRequest())

    def _client_gone(self, client: str) -> None:
        """End the requests of a client with its liveliness."""
        if client in self._asking:
            self._gone.add(client)
        for each in self._arming.client_gone(client):
            self._publish("run.withdrawn", client, each)

    async def run_armed(self, client: str, request: wire.RunArmedRequest) -> wire.RunArmedReply:
        service = self._service
        self._forget_armings()
        tolerance = {axis.index: START_TOLERANCES * axis.in_position for axis in service.machine.axes}
        busy = {axis.index for axis in service.machine.axes if service.holder(axis.index) is not None}
        run = self._arming.start(client, request.text, self._positions(), tolerance, busy)
        # from here on the arming is used up, whatever happens
        program = await service.open(client, name=run.name, axes=run.axes, sha256=run.sha256)
        program.override_limit = run.override
        service.set_override(min(service.override, run.override), program.program)
        lines = split_lines(run.text)
        try:
            if program.state == "queued":
                # another program came first, and would move the axes away from where the simulation began
                raise Refused("MC572", "the axes are in use", "request the run again")
            if len(lines) > program.credit:
                raise Refused(
                    "MC574", f"the text has more than {program.credit} lines", "an operator runs it"
                )
            await service.lines.submit(client, program.program, 1, lines)
            await service.lines.close(client, program.program, len(lines))
        except ServiceError:
            if not program.ended:
                service.abort(program.program, "an armed program could not be started as a whole")
            raise
        self._publish("run.started", client, run, program.program)
        return wire.RunArmedReply(program.program, 100.0 * program.override)

    def _positions(self) -> dict[int, float]:
        """Return where all axes stand [m or rad]."""
        position = self._service.port.snapshot().position
        return {axis.index: position[at] for at, axis in enumerate(self._service.machine.axes)}

    def _status(self, run: RunRequest) -> wire.RunRequestStatus:
        return wire.RunRequestStatus(
            sha256=run.sha256,
            client=run.client,
            name=run.name,
            state=run.state.value,
            axes=list(run.axes),
            duration_s=run.duration_s,
            extents=list(run.extents),
            remaining_s=max(0.0, run.until - self._clock()) if run.state in OPEN else 0.0,
            override=100.0 * run.override,
            operator=run.operator,
            number=run.number,
            reason=run.reason,
        )

    def _publish(self, kind: Any, client: str, run: RunRequest, program: str | None = None) -> None:
        axes = ", ".join(map(str, run.axes))
        message = f"{run.sha256[:12]}: axes {axes}, {run.duration_s:.3f} s"
        if run.reason:
            message += f"; {run.reason}"
        self._service.record_command(client, kind, program, message)


def _extents(machine: Machine, report: dict[str, Any], axes: tuple[int, ...]) -> tuple[Extent, ...]:
    units = {axis.index: axis.type.unit for axis in machine.axes}
    return tuple(
        Extent(axis, report["axes"][str(axis)]["min"], report["axes"][str(axis)]["max"], units[axis])
        for axis in axes
    )
