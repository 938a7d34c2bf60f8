"""Servo mode through the service, on a virtual executor: leases, the stream, its end, and who is refused."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np
import pytest
from mckinematics.solver import MachineKinematics

from mcserver.errors import Refused
from mcserver.executor.entries import Control, ControlKind
from mcserver.machine.machine_file import Machine, load_machine, parse_machine
from mcserver.service.program import Program
from mcserver.service.program_options import ProgramOptions
from mcserver.service.servo import close_targets, open_servo, put_targets
from mcserver.service.target_stream import TargetMessage
from tests.kinematics import arm7
from tests.machine_text import axes_text
from tests.service.virtual_cell import VirtualCell

TRAVEL = "max_jerk = 40000.0\nmin_position = -10.0\nmax_position = 500.0"
ARM = f'[machine]\nname = "arm"\n{axes_text(range(3), keys=TRAVEL)}'


def machine() -> Machine:
    return parse_machine(ARM)


class Streamer:
    """A client that sends a position every 10 ms of the cell's time."""

    def __init__(self, cell: VirtualCell, program: Program) -> None:
        self.cell, self.program = cell, program
        self.seq = 0
        self.next_s = 0.0

    async def stream(self, position: list[float], seconds: float, *, counts_s: float = 1.0) -> None:
        service = self.cell.service
        begun = service.port.snapshot().time
        while (now := service.port.snapshot().time) < begun + seconds and not self.program.over:
            if now >= self.next_s:
                self.seq += 1
                self.next_s = now + 0.01
                message = TargetMessage(self.seq, now, counts_s, np.array([position]), None, None)
                put_targets(service, self.program, message)
            await asyncio.sleep(0)


async def opened(cell: VirtualCell, axes: list[int] | None = None) -> Streamer:
    return Streamer(cell, await open_servo(cell.service, "policy", axes))


async def test_targets_are_followed_and_a_close_ends_it_at_rest_there(cell: VirtualCell) -> None:
    streamer = await opened(cell, [0, 1])
    await streamer.stream([0.05, 0.02], 1.5)
    close_targets(cell.service, streamer.program)
    program = await cell.ended(streamer.program)
    assert (program.state, program.fault) == ("finished", None)
    assert [cell.position(axis) for axis in (0, 1, 2)] == pytest.approx([0.05, 0.02, 0.0])
    status = program.status().servo
    assert status is not None
    assert status.taken == streamer.seq


async def test_silence_aborts_the_program_says_why_and_needs_no_reset(cell: VirtualCell) -> None:
    streamer = await opened(cell)
    await streamer.stream([0.4, 0.0, 0.0], 0.3, counts_s=0.2)
    program = await cell.ended(streamer.program)
    assert program.state == "aborted"
    assert program.reason.startswith("MC465")
    assert any(event.kind == "warning" and event.reason == "MC465" for event in cell.events)
    assert not cell.service.latch.faults
    await streamer.stream([0.4, 0.0, 0.0], 0.1)
    again = await opened(cell)
    await again.stream([0.01, 0.0, 0.0], 0.2)
    assert again.program.state == "running"


async def test_a_program_s_axes_are_not_to_be_had_and_who_has_them_is_named(cell: VirtualCell) -> None:
    await cell.service.open("mill", ProgramOptions(name="part 7", axes=[1]))
    with pytest.raises(Refused, match="part 7") as refusal:
        await opened(cell, [0, 1])
    assert (refusal.value.code, refusal.value.details["client"]) == ("MC512", "mill")
    assert (await opened(cell, [0, 2])).program.state == "running"


async def test_axes_in_servo_mode_are_refused_to_a_jog_and_a_program_waits_for_them(
    cell: VirtualCell,
) -> None:
    streamer = await opened(cell, [0])
    with pytest.raises(Refused, match="servo mode") as refusal:
        await cell.jog(0, 1.0, 1.0)
    assert refusal.value.code == "MC512"
    program = await cell.service.open("mill", ProgramOptions(axes=[0]))
    assert program.state == "queued"
    close_targets(cell.service, streamer.program)
    await cell.until(lambda: program.state == "running")


async def test_lines_are_refused_in_servo_mode(cell: VirtualCell) -> None:
    streamer = await opened(cell, [0])
    with pytest.raises(Refused, match="MC510: "):
        await cell.service.lines.submit("policy", streamer.program.program, 1, ["G01 X1 F100"])


async def test_a_client_that_is_gone_stops_at_once(cell: VirtualCell) -> None:
    streamer = await opened(cell, [0])
    await streamer.stream([0.4], 0.3)
    cell.service.absences.gone("policy")
    assert (await cell.ended(streamer.program)).state == "aborted"


async def test_an_axis_that_holds_a_speed_comes_to_rest_before_it_follows(cell: VirtualCell) -> None:
    speed = [
        Control(ControlKind.SPEED, 0.0, 0, axes=1, values=(0.1, 0.0, 0.0)),
        Control(ControlKind.FINISH, 0.0, 0),
    ]
    spinning = await cell.service.open("mill", ProgramOptions(axes=[0], controls=speed))
    await cell.ended(spinning)
    await cell.until(lambda: cell.position(0) > 0.02)
    streamer = await opened(cell, [0])
    await streamer.stream([0.05], 2.0)
    close_targets(cell.service, streamer.program)
    program = await cell.ended(streamer.program)
    assert (program.state, program.fault) == ("finished", None)
    assert cell.position(0) == pytest.approx(0.05)


async def test_a_program_moves_an_axis_from_where_servo_mode_left_it(cell: VirtualCell) -> None:
    streamer = await opened(cell, [0])
    await streamer.stream([0.0501234], 1.0)
    close_targets(cell.service, streamer.program)
    await cell.ended(streamer.program)
    program = await cell.service.open("mill", ProgramOptions(axes=[0]))
    await cell.service.lines.submit("mill", program.program, 1, ["G90", "G01 X60 F3000", "M02"])
    ended = await cell.ended(program)
    assert (ended.state, ended.fault) == ("finished", None)
    assert cell.position(0) == pytest.approx(0.06)


async def test_numbers_at_the_end_of_all_numbers_are_counted_and_warn_of_nothing(cell: VirtualCell) -> None:
    streamer = await opened(cell, [0])
    for seq, position in enumerate((1.7e308, -1.7e308, 1.7e308, 0.0), start=1):
        message = TargetMessage(seq, seq * 0.01, 1.0, np.array([[position]]), None, None)
        put_targets(cell.service, streamer.program, message)
    status = streamer.program.status().servo
    assert status is not None
    assert (status.taken + status.jumped, status.refused) == (4, 0)


async def test_a_twist_and_a_pose_of_a_tool_lead_the_axes_from_where_they_are(tmp_path: Path) -> None:
    arm = VirtualCell(load_machine("arm6"), tmp_path)
    kinematics = MachineKinematics(arm.service.machine)

    def reached() -> list[float]:
        found = kinematics.pose(1, dict(enumerate(arm.service.port.snapshot().setpoint)))
        return [*found.position, *found.angles]

    streamer = await opened(arm)
    start = reached()
    twist, pose = np.array([[0.0, 0.0, 0.1, 0.0, 0.0, 0.0]]), np.array([[0.4, 0.05, 0.6, 0.0, 0.0, 0.1]])
    for seq in range(1, 120):
        now, targets = arm.service.port.snapshot().time, (pose, None) if seq > 60 else (None, twist)
        put_targets(arm.service, streamer.program, TargetMessage(seq, now, 1.0, *targets, None, 1))
        await asyncio.sleep(0)
        if seq == 60:
            # straight up from where the arm stands, with its wrist at 90°
            assert reached()[:2] == pytest.approx(start[:2], abs=1e-3)
            assert reached()[2] > start[2] + 3e-3
    close_targets(arm.service, streamer.program)
    program = await arm.ended(streamer.program)
    assert (program.state, program.fault) == ("finished", None)
    assert reached() == pytest.approx(pose[0], abs=1e-9)
    status = program.status().servo
    assert status is not None
    assert (status.refused, status.slowed > 0) == (0, True)
    await arm.stop()


async def test_torques_that_are_limited_slow_all_of_it_and_bounds_leave_more(tmp_path: Path) -> None:
    torques = (25.0, 70.0, 25.0, 30.0, 7.0, 6.0, 0.6)
    arm = VirtualCell(arm7.machine(tmp_path, torques=torques), tmp_path)
    fastest = []
    start = [math.radians(each) for each in arm7.START]
    near = tuple({axis: at + way for axis, at in enumerate(start)} for way in (-0.3, 0.3))
    for within in (None, (near[0], near[1])):
        program = await open_servo(arm.service, "policy", None, within=within)
        assert program.targets is not None
        fastest.append(float(program.targets._top[0]))
        arm.service.abort(program.program, "seen")
        await arm.ended(program)
    assert 0.0 < fastest[0] < fastest[1] < arm.service.machine.axes[0].max_velocity
    await arm.stop()


async def test_axes_that_cannot_be_held_wherever_targets_may_lead_them_are_refused(tmp_path: Path) -> None:
    arm = VirtualCell(arm7.machine(tmp_path, torques=(160.0, 45.0, 90.0, 90.0, 50.0, 40.0, 40.0)), tmp_path)
    with pytest.raises(Refused, match="MC600: "):
        await open_servo(arm.service, "policy", None)
    await arm.stop()


SIZE = "size_mm = [10, 10, 10]\n"
# the head comes to the post's margin at X89
POST = f'[clearance]\n[[zone]]\nname = "post"\nat_mm = [100, 0, 50]\n{SIZE}'
POST += f'[[zone]]\nname = "gate"\nat_mm = [60, 60, 50]\n{SIZE}'
POST += f'[[body]]\nname = "head"\nshape = "box"\ncarried_by = [0, 1, 2]\nat_mm = [0, 0, 50]\n{SIZE}'


@pytest.fixture
async def guarded(tmp_path: Path) -> AsyncIterator[VirtualCell]:
    made = VirtualCell(parse_machine(ARM + POST), tmp_path)
    yield made
    await made.stop()


async def bounded(cell: VirtualCell, low: float, high: float) -> Streamer:
    """Axis 0 follows between two places [m]."""
    return Streamer(cell, await open_servo(cell.service, "policy", [0], within=({0: low}, {0: high})))


async def test_targets_for_a_machine_with_clearance_need_bounds(guarded: VirtualCell) -> None:
    with pytest.raises(Refused, match="MC595: "):
        await opened(guarded, [0])


@pytest.mark.parametrize("end", ["close", "abort", "estop", "silence", "hold"])
async def test_bounded_targets_lead_no_axis_beyond_their_bounds(guarded: VirtualCell, end: str) -> None:
    streamer = await bounded(guarded, 0.0, 0.08)
    service, program = guarded.service, streamer.program
    if end == "close":
        # at once and slowly, and as far as it goes
        await streamer.stream([0.3], 2.5)
        assert guarded.position(0) == pytest.approx(0.08)
        await streamer.stream([-0.3], 2.5)
        assert guarded.position(0) == pytest.approx(0.0, abs=1e-6)
        await streamer.stream([0.05], 1.0)
        close_targets(service, program)
        assert (await guarded.ended(program)).state == "finished"
        assert guarded.position(0) == pytest.approx(0.05)
        return
    while guarded.position(0) < 0.05:
        await streamer.stream([0.3], 0.01, counts_s=0.1)
    # on its way to the bound
    assert guarded.position(0) < 0.08
    if end == "abort":
        service.abort(program.program, "")
    elif end == "estop":
        service.latch.emergency_stop("anna", "")
    elif end == "hold":
        service.hold(program.program)
    last = guarded.service.port.snapshot().time + 0.5
    await guarded.until(lambda: guarded.service.port.snapshot().time > last)
    assert 0.06 < guarded.position(0) < 0.08 + 1e-9


async def test_bounds_hold_on_a_machine_without_bodies_too(cell: VirtualCell) -> None:
    streamer = await bounded(cell, 0.0, 0.02)
    await streamer.stream([0.3], 1.5)
    assert cell.position(0) == pytest.approx(0.02)


async def test_bounds_in_which_bodies_do_not_stay_clear_end_it_before_anything_moves(
    guarded: VirtualCell,
) -> None:
    streamer = await bounded(guarded, 0.0, 0.12)
    await streamer.stream([0.12], 0.5)
    program = await guarded.ended(streamer.program)
    assert program.fault is not None
    assert (program.fault.code, guarded.position(0)) == ("MC321", 0.0)
    assert "narrower low and high" in program.fault.hint


async def test_a_program_waits_for_bounded_targets_before_all_places_between_them(
    guarded: VirtualCell,
) -> None:
    async def begun() -> Program:
        beside = await guarded.service.open("mill", ProgramOptions(axes=[1]))
        await guarded.service.lines.submit("mill", beside.program, 1, ["G1010", "G1 Y120 F6000", "G1 Y0"])
        guarded.service.lines.close("mill", beside.program)
        return beside

    # the head passes the gate at X60 where it stands at X0, and not where it may come there
    assert (await guarded.ended(await begun())).state == "finished"
    streamer = await bounded(guarded, 0.0, 0.08)
    await streamer.stream([0.0], 0.2, counts_s=600.0)
    beside = await begun()
    said = [streamer.program.program, "waits"]
    await guarded.until(lambda: any(all(each in event.message for each in said) for event in guarded.events))
    assert guarded.position(1) < 0.12
    assert not beside.over
    close_targets(guarded.service, streamer.program)
    await guarded.ended(streamer.program)
    assert (await guarded.ended(beside)).state == "finished"


@pytest.mark.parametrize(
    "within", [({0: 0.1}, {0: 0.0}), ({0: 0.0}, {}), ({0: float("nan")}, {0: 1.0}), ({0: 1.0}, {0: 2.0})]
)
async def test_bounds_that_fit_no_axis_are_refused(
    guarded: VirtualCell, within: tuple[dict[int, float], dict[int, float]]
) -> None:
    with pytest.raises(Refused, match="MC327: "):
        await open_servo(guarded.service, "policy", [0], within=within)
