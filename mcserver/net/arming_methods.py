"""Remote methods for runs that a person has to approve: ``request_run``, ``arm``, ``run_armed``, and more."""

from __future__ import annotations

import asyncio
import datetime
import math
from collections import Counter
from typing import Any

import msgspec

from mcserver.errors import Diagnostic, Refused, ServiceError
from mcserver.gcode.axes_used import axes_named, axes_used
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.gcode.text.source import split_lines
from mcserver.net import arming_messages as wire
from mcserver.net.certified_runs import RECERTIFY, approval_of, refuse_other_motion, refuse_other_run
from mcserver.net.servo_messages import ServoReply, ServoRequest
from mcserver.net.servo_methods import bounds_asked
from mcserver.planning.start_state import StartState, axis_word
from mcserver.service.approval_basis import ApprovalBasis, extents_of, tools_of
from mcserver.service.arming import (
    MOST_WARNINGS,
    OPEN,
    WITHIN_S,
    Arming,
    Changes,
    RunPath,
    RunRequest,
    RunState,
    hash_of,
    refuse_changed,
    user_of,
)
from mcserver.service.program_options import ProgramOptions
from mcserver.service.reports import wire_diagnostic
from mcserver.service.run_certificate import CertifiedRun, verified
from mcserver.service.service import MachineService
from mcserver.service.servo import open_servo, streamed
from mcserver.simulation.preview import Preview
from mcserver.simulation.program_checker import ProgramChecker


class ArmingMethods:
    """Handles the messages for one machine's service."""

    def __init__(self, service: MachineService, checker: ProgramChecker) -> None:
        self._service = service
        self._checker = checker
        self._clock = asyncio.get_running_loop().time
        self._arming = Arming(self._clock)
        self._basis = ApprovalBasis(service.machine)
        self._stops = service.latch.stops
        # clients whose requests are being simulated, and those of them that have disappeared
        self._asking: Counter[str] = Counter()
        self._gone: set[str] = set()
        service.absences.when_gone.append(self._client_gone)

    def _revoke_armings(self) -> None:
        """Revoke all armings after an emergency stop: an operator has to look at the machine again."""
        if self._stops != self._service.latch.stops:
            self._stops = self._service.latch.stops
            self._arming.disarm()

    async def request_run(self, client: str, request: wire.RunRequestRequest) -> wire.RunRequestReply:
        machine = self._service.machine
        self._arming.check_room(client, request.text)
        named = axes_named(request.text, machine)
        axes = axes_used(request.text, machine) if request.axes is None else tuple(sorted(set(request.axes)))
        if not axes:
            raise Refused("MC511", "the text names no axis, so there is nothing to run", "check the text")
        if not set(named) <= set(axes):
            raise Refused(
                "MC511", f"the text needs the axes {', '.join(map(str, named))}", "ask for all of them"
            )
        switches = Switches.of(request.block_delete, request.optional_stop)
        start = msgspec.structs.replace(self._service.start_state(), switches=switches or AS_WRITTEN)
        references = dict(self._service.axis_reports.offsets)
        self._refuse_unsettled(start, axes)
        certified = self._certified(client, request, axes)
        if certified is not None:
            # simulate from the certified state, and compare it with the machine's present one
            start = certified.approval.start
            if switches not in (None, start.switches):
                raise Refused("MC579", "the certificate is of a run with other switches", RECERTIFY)
        self._asking[client] += 1
        try:
            seen = await self._checker.preview(client, request.text, start, axes)
            if client in self._gone:
                raise Refused("MC570", f"{client} went while its run was simulated", "request the run again")
        finally:
            self._asking -= Counter([client])
            self._gone.intersection_update(self._asking)
        found = [wire_diagnostic(msgspec.convert(each, Diagnostic)) for each in seen.report["diagnostics"]]
        if seen.marks is None or seen.envelope is None:
            return wire.RunRequestReply(False, found)
        self._refuse_unbounded(seen)
        wanted = RunRequest(
            client=client,
            sha256=hash_of(request.text),
            text=request.text,
            name=request.name,
            axes=axes,
            start=start,
            duration_s=seen.report["duration_s"],
            extents=extents_of(machine, seen.envelope, axes),
            until=0.0,
            path=msgspec.convert(seen.path, RunPath),
            inputs=seen.inputs,
            envelope=seen.envelope,
            references=references,
            effects=seen.effects,
            tools=tools_of(seen.envelope),
            digest=self._basis.digest(request.text, axes, start),
            outputs=seen.outputs,
            # runs with errors are not stored
            warnings=tuple(found[:MOST_WARNINGS]),
            unshown=max(0, len(found) - MOST_WARNINGS),
            certifiable=msgspec.json.encode(
                approval_of(self._basis, request.text, axes, start, seen)
            ).decode(),
        )
        if certified is not None:
            self._refuse_uncertified(certified, seen, wanted)
        kept = self._arming.request(wanted)
        self._revoke_armings()
        if certified is not None:
            override = certified.approval.override
            kept = self._arming.arm(certified.signer, kept.sha256, seconds=WITHIN_S, override=override)
        else:
            kept = self._arming.arm_within(kept, self._basis.beyond)
        self._service.forecasts.take(kept.sha256, seen.marks, switches=start.switches)
        self._publish("run.requested", client, kept)
        if kept.state is RunState.ARMED:
            self._publish("run.armed", kept.operator, kept)
        return wire.RunRequestReply(True, found, self._status(kept))

    def run_requests(self, _client: str, _request: wire.RunRequestsRequest) -> wire.RunRequestsReply:
        self._revoke_armings()
        return wire.RunRequestsReply([self._status(each) for each in self._arming.requests()])

    def run_approvals(self, _client: str, _request: wire.RunApprovalsRequest) -> wire.RunRequestsReply:
        self._revoke_armings()
        return wire.RunRequestsReply([self._status(each, rests=False) for each in self._arming.approvals()])

    def run_preview(self, _client: str, request: wire.RunPreviewRequest) -> wire.RunPreviewReply:
        self._revoke_armings()
        found = self._arming.find(request.sha256)
        return wire.RunPreviewReply(
            self._status(found), found.text, found.path, found.certifiable, [*found.warnings], found.unshown
        )

    def arm(self, client: str, request: wire.ArmRequest) -> wire.RunRequestStatus:
        self._revoke_armings()
        armed = self._arming.arm(
            client,
            request.sha256,
            seconds=request.seconds,
            override=request.override / 100.0,
            number=request.number,
            standing=request.standing_s,
            servo=request.servo,
            changes=self._changes_now(),
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
        """End the requests of a client whose liveliness token has disappeared."""
        if client in self._asking:
            self._gone.add(client)
        for each in self._arming.client_gone(client):
            self._publish("run.withdrawn", client, each)

    async def run_armed(self, client: str, request: wire.RunArmedRequest) -> wire.RunArmedReply:
        service = self._service
        self._revoke_armings()
        busy = {axis.index for axis in service.machine.axes if service.holder(axis.index) is not None}
        now = service.start_state()
        run = self._arming.start(client, request.text, busy, self._changes_now(now))
        # the arming is used up from here on; there is no await before the program has begun
        envelope = self._basis.envelope(run, now)
        program = await service.open(
            client,
            ProgramOptions(
                name=run.name,
                axes=run.axes,
                grace_s=request.grace_s,
                sha256=run.sha256,
                switches=run.start.switches,
                override_limit=run.override,
                envelope=envelope,
            ),
        )
        lines = split_lines(run.text)
        try:
            if program.state == "queued":
                # an earlier program would move the axes away from the initial state of the simulation
                raise Refused("MC572", "the axes are in use", "request the run again")
            if len(lines) > program.credit:
                raise Refused(
                    "MC574", f"the text has more than {program.credit} lines", "an operator runs it"
                )
            taken = service.lines.submit(client, program.program, 1, lines)
            # at once, so that the program takes no lines but the armed ones
            closed = service.lines.close(client, program.program, len(lines))
            await taken
            await closed
        except ServiceError:
            if not program.over:
                service.abort(program.program, "an armed program could not be started as a whole")
            raise
        self._publish("run.started", client, run, program.program)
        return wire.RunArmedReply(program.program, 100.0 * program.override)

    async def servo_armed(self, client: str, request: ServoRequest) -> ServoReply:
        service = self._service
        self._revoke_armings()
        approval = self._arming.approved_targets(client, frozenset(request.axes or ()))
        program = await open_servo(
            service,
            client,
            approval.axes if request.axes is None else request.axes,
            request.name,
            bounds_asked(service.machine, request),
            approval,
        )
        self._publish("run.started", client, approval, program.program)
        return ServoReply(program.program, streamed(service.machine, program.axes))

    def _certified(
        self, client: str, request: wire.RunRequestRequest, axes: tuple[int, ...]
    ) -> CertifiedRun | None:
        """Return the approval in a request's certificate, after checking that it is for this run."""
        if request.certificate is None:
            return None
        options = self._service.options
        now = datetime.datetime.fromtimestamp(options.clock(), datetime.UTC)
        certified = verified(request.certificate, options.authority, now)
        if user_of(client) == user_of(certified.signer):
            raise Refused("MC575", "who asks for a run may not approve it", "another person has to sign")
        refuse_other_run(self._basis, certified.approval, request.text, axes)
        return certified

    def _refuse_uncertified(self, certified: CertifiedRun, seen: Preview, wanted: RunRequest) -> None:
        """Refuse a certified run if this computer plans it differently, or the machine's state differs."""
        refuse_other_motion(certified.approval, seen)
        refuse_changed(self._changes_now()(wanted))

    def _changes_now(self, start: StartState | None = None) -> Changes:
        """Return a function that names changes since a simulation; ``start``: present state, if known."""
        now = start or self._service.start_state()
        return lambda run: self._basis.changes(run, now, self._service.axis_reports.offsets)

    def _refuse_unsettled(self, start: StartState, axes: tuple[int, ...]) -> None:
        """Refuse to simulate from a state that is changing."""
        channels = self._service.channels
        channels.refuse_interlocked(channels.holding(), "request the run again")
        moving = [axis_word(self._service.machine, axis) for axis in axes if axis in start.unsettled]
        if moving:
            raise Refused(
                "MC572",
                f"{', '.join(moving)} move, turn or push now",
                "stop them, then request the run again",
            )

    def _refuse_unbounded(self, seen: Preview) -> None:
        """Refuse motion without extents: torques, and speeds of axes with limited travel."""
        machine = self._service.machine
        assert seen.envelope is not None
        unbounded = set(seen.pushed)
        for column, axis in enumerate(machine.axes):
            limited = math.isfinite(axis.min_position) or math.isfinite(axis.max_position)
            if limited and seen.envelope.turning >> column & 1:
                unbounded.add(axis.index)
        if unbounded:
            words = ", ".join(axis_word(machine, axis) for axis in sorted(unbounded))
            raise Refused(
                "MC577",
                f"a torque, or a speed of an axis with limited travel, has no extents to approve: {words}",
                "leave G1040 and G1030 of such axes out, or let an operator run it: mcctl run",
            )

    def _status(self, run: RunRequest, *, rests: bool = True) -> wire.RunRequestStatus:
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
            effects=list(run.effects),
            tools=list(run.tools),
            digest=run.digest,
            changed=self._changes_now()(run) if rests and run.state in OPEN else [],
            approval=run.approval,
            servo=run.servo,
            beyond=list(run.beyond),
            block_delete=run.start.switches.block_delete,
            optional_stop=run.start.switches.optional_stop,
        )

    def _publish(self, kind: Any, client: str, run: RunRequest, program: str | None = None) -> None:
        axes = ", ".join(map(str, run.axes))
        message = f"{run.sha256[:12]}: axes {axes}, {run.duration_s:.3f} s"
        if run.reason:
            message += f"; {run.reason}"
        if run.approval:
            message += f"; inside of {run.approval[:12]}, approved for a while by {run.operator}"
        self._service.record_command(client, kind, program, message)
