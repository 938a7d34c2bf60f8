"""Programs that stand at a tool change: what a person may do meanwhile, and where they go on (D-05)."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mcserver.errors import Refused, ServiceError
from mcserver.executor.envelope_bounds import Envelope
from mcserver.machine.machine_file import Machine, load_machine, parse_machine
from mcserver.service.approach import Confirmation
from mcserver.service.program import Program
from mcserver.service.program_options import ProgramOptions
from tests.executor.rig import Array
from tests.machine_text import axes_text
from tests.service.virtual_cell import VirtualCell

MM = 1e-3
SPINDLE = axes_text([3], rotary=True, velocity=36000.0, acceleration=360000.0)
PROBE = "[probe]\nsimulated_at = { Z = -3.2 }\n"


def mill(more: str = "", *, profile: str = "cnc", drive: str = "ideal") -> Machine:
    keys = "max_jerk = 50000.0\nmin_position = -200.0\nmax_position = 500.0\nmax_following_error = 5.0"
    axes = axes_text(range(3), keys=keys, drive=drive)
    cutters = "".join(f"[[cutter]]\nnumber = {number}\nlength_mm = 0.0\n" for number in (1, 2))
    return parse_machine(f'[machine]\nname = "mill"\n{axes}[dialect]\nprofile = "{profile}"\n{more}{cutters}')


def homed_mill() -> Machine:
    axes = axes_text(
        range(3), keys='min_position = -200.0\nmax_position = 500.0\nhoming = { method = "manual" }'
    )
    return parse_machine(f'[machine]\nname = "mill"\n{axes}[dialect]\nprofile = "cnc"\n')


class Shop(VirtualCell):
    """A cell whose setpoints are watched at every cycle."""

    def __init__(self, made: Machine, folder: Path, instance: str = "shop") -> None:
        self.setpoints: list[Array] = []
        super().__init__(made, folder, instance)
        self.executor.recorder = self._record

    def _record(self, _time: float, _line: int, setpoint: Array, _actual: Array) -> None:
        self.setpoints.append(setpoint[:3].copy())

    async def begin_part(
        self, lines: Sequence[str], *, close: bool = True, envelope: Envelope | None = None
    ) -> Program:
        program = await self.service.open("cam", ProgramOptions(name="part.nc", envelope=envelope))
        self.service.lines.submit("cam", program.program, 1, lines)
        if close:
            self.service.lines.close("cam", program.program)
        return program

    async def at_pause(self, lines: Sequence[str], **more: Any) -> Program:
        """A program that has come to its pause."""
        program = await self.begin_part(lines, **more)
        await self.paused(program)
        return program

    async def paused(self, program: Program) -> None:
        await self.until(lambda: program.state == "paused")

    async def by_hand(self, *lines: str, axes: list[int] | None = None) -> Program:
        program = await self.service.open("page", ProgramOptions(axes=axes, at_pause=True))
        self.service.lines.submit("page", program.program, 1, lines)
        self.service.lines.close("page", program.program)
        return await self.ended(program)

    async def jogged(self, axis: int, distance: float) -> None:
        program = await self.ended(await self.jog(axis, distance))
        assert program.state == "finished", program.fault

    async def resumed(self, program: Program) -> Program:
        self.service.resume(program.program)
        return await self.ended(program)

    def at(self) -> tuple[float, ...]:
        return tuple(self.position(axis) / MM for axis in range(3))

    def check_limits(self) -> None:
        """No setpoint jumps, and every cycle keeps the limits."""
        path = np.array(self.setpoints)
        velocity = np.diff(path, axis=0) * 1000.0
        assert np.abs(velocity).max() <= 0.2 * (1 + 1e-6)
        assert np.abs(np.diff(velocity, axis=0)).max() * 1000.0 <= 2.0 * (1 + 1e-3)


@pytest.fixture
async def shop(tmp_path: Path) -> AsyncIterator[Shop]:
    made = Shop(mill(PROBE), tmp_path)
    yield made
    made.check_limits()
    await made.stop()


CHANGE = ["T1 M6", "G0 X10 Y20 Z30", "G1 Z5 F3000", "T2 M6", "G1 X40 F3000", "G0 Z30"]


async def test_behind_a_tool_change_an_absolute_move_starts_where_the_axes_were_jogged_to(shop: Shop) -> None:
    program = await shop.at_pause(CHANGE)
    assert (program.notice, program.status().line) == ("fit tool 2, then resume", 4)
    await shop.jogged(2, 60.0)
    await shop.jogged(0, -25.0)
    assert shop.at() == pytest.approx((-15.0, 20.0, 65.0))
    assert program.state == "paused"
    begun = len(shop.setpoints)
    assert (await shop.resumed(program)).state == "finished"
    assert (program.done, shop.at()) == (6, pytest.approx((40.0, 20.0, 30.0)))
    # straight to X40 at the height to which Z was jogged
    heights = [row[2] for row in shop.setpoints[begun:] if row[0] < 0.039]
    assert heights == pytest.approx([0.065] * len(heights))


async def test_zero_that_was_set_at_the_pause_counts_for_lines_that_were_there_before(shop: Shop) -> None:
    program = await shop.at_pause(CHANGE)
    assert (await shop.by_hand("G21 G90 G10 L20 P0 X0 Z0")).state == "finished"
    await shop.resumed(program)
    assert shop.at() == pytest.approx((10.0 + 40.0, 20.0, 5.0 + 30.0))


async def test_a_length_that_was_set_at_the_pause_counts_for_g43_in_the_line_of_the_tool_change(
    shop: Shop,
) -> None:
    program = await shop.at_pause(["T1 M6 G43 H1", "G0 Z10", "T2 M6 G43 H2 G0 Z20", "G0 X5"])
    assert shop.at()[2] == pytest.approx(10.0)
    assert (await shop.by_hand("G10 L1 P2 Z45")).state == "finished"
    await shop.resumed(program)
    assert (program.state, program.done) == ("finished", 4)
    assert shop.at() == pytest.approx((5.0, 0.0, 20.0 + 45.0))


async def test_what_a_probe_met_at_the_pause_sets_zero_for_the_lines_behind_it(shop: Shop) -> None:
    program = await shop.at_pause(["T1 M6", "G0 Z10", "T2 M6", "G0 Z2"])
    probing = await shop.by_hand("G90 G38.2 Z-20 F300", "G10 L20 P1 Z0", "G0 Z8")
    assert (probing.state, probing.fault) == ("finished", None)
    await shop.resumed(program)
    met = shop.service.axis_reports.probe
    assert met is not None
    # the axis had come to rest a little further when zero was set
    assert shop.at()[2] == pytest.approx(met.positions["2"] + 2.0, abs=0.2)


async def test_increments_behind_the_pause_count_from_where_the_axes_stand(shop: Shop) -> None:
    program = await shop.at_pause(["T1 M6", "G0 X10 Z10", "T2 M6", "G91 G1 X5 Z-1 F600"])
    await shop.jogged(0, 20.0)
    await shop.resumed(program)
    assert shop.at() == pytest.approx((35.0, 0.0, 9.0))


async def test_an_arc_that_no_longer_fits_is_refused_and_nothing_of_it_moves(shop: Shop) -> None:
    program = await shop.at_pause(["T1 M6", "G0 X10 Y0", "T2 M6", "G2 X20 Y0 I5 J0 F600"])
    await shop.jogged(0, 3.0)
    await shop.resumed(program)
    assert (program.state, program.rejected, shop.at()[0]) == ("rejected", 4, pytest.approx(13.0))


async def test_without_anybody_at_the_pause_the_path_is_the_same_to_the_bit(tmp_path: Path) -> None:
    ends = []
    for name, rule in (("one", "ignore"), ("two", "pause")):
        folder = tmp_path / name
        folder.mkdir()
        shop = Shop(mill(f'tool_change = "{rule}"\n' if rule == "ignore" else ""), folder)
        lines = ["T1 M6", "G0 X10", "G91 G1 X3.3 Y1.7 F3000", "T2 M6", "G1 X0.1", "G2 X4 I2 J0"]
        program = await shop.begin_part(lines)
        if rule == "pause":
            await shop.paused(program)
            shop.service.resume(None)
        await shop.ended(program)
        ends.append([shop.service.port.snapshot().setpoint, program.done])
        await shop.stop()
    assert ends[0] == ends[1]


async def test_one_resume_behind_a_hold_does_not_end_the_tool_change(shop: Shop) -> None:
    program = await shop.at_pause(CHANGE)
    shop.service.hold(program.program)
    await shop.jogged(0, 1.0)
    shop.service.resume(program.program)
    assert program.state == "paused"
    await shop.jogged(0, 1.0)
    assert (await shop.resumed(program)).state == "finished"


async def test_nobody_resumes_while_somebody_jogs(shop: Shop) -> None:
    program = await shop.at_pause(CHANGE)
    jog = await shop.jog(1, None, 50.0)
    await shop.until(lambda: jog.progress.started > 0)
    for which in (program.program, None):
        with pytest.raises(Refused) as refused:
            shop.service.resume(which)
        assert (refused.value.code, "jog axis 1" in refused.value.message) == ("MC512", True)
    assert program.state == "paused"
    shop.service.abort(jog.program)
    await shop.ended(jog)
    assert (await shop.resumed(program)).state == "finished"


async def test_nobody_jogs_once_it_goes_on(shop: Shop) -> None:
    program = await shop.at_pause([*CHANGE[:4], "G1 X200 F1000"])
    shop.service.resume(None)
    with pytest.raises(Refused, match="MC512: "):
        await shop.jog(0, 1.0)
    await shop.ended(program)
    assert shop.at()[0] == pytest.approx(200.0)


async def test_a_program_that_waits_for_the_axes_does_not_begin_at_the_pause(shop: Shop) -> None:
    program = await shop.begin_part(CHANGE)
    waiting = await shop.begin_part(["G0 X99"])
    await shop.paused(program)
    later = await shop.begin_part(["G0 X77"])
    await shop.jogged(0, 5.0)
    assert (waiting.state, later.state) == ("queued", "queued")
    await shop.resumed(program)
    await shop.ended(later)
    assert (waiting.state, shop.at()[0]) == ("finished", pytest.approx(77.0))


async def test_two_at_the_pause_do_not_share_an_axis(shop: Shop) -> None:
    program = await shop.at_pause(CHANGE)
    jog = await shop.jog(0, None, 20.0)
    with pytest.raises(Refused):
        await shop.jog(0, 1.0, 10.0, client="other")
    with pytest.raises(Refused):
        await shop.service.open("other", ProgramOptions(axes=[0], at_pause=True))
    shop.service.abort(jog.program)
    await shop.ended(jog)
    assert (await shop.resumed(program)).state == "finished"


async def test_an_emergency_stop_at_the_pause_ends_both(shop: Shop) -> None:
    program = await shop.at_pause(CHANGE)
    jog = await shop.jog(1, None, 50.0)
    await shop.until(lambda: jog.progress.started > 0)
    shop.service.latch.emergency_stop("page", "a hand")
    await shop.ended(jog)
    await shop.ended(program)
    assert (program.state, jog.state) == ("faulted", "faulted")
    await shop.until(lambda: set(shop.service.port.snapshot().states) == {"off"})


async def test_whoever_aborts_the_program_at_the_pause_leaves_the_jog_alone(shop: Shop) -> None:
    program = await shop.at_pause(CHANGE)
    jog = await shop.jog(1, 30.0, 50.0)
    waiting = await shop.begin_part(["G0 Y1"])
    shop.service.abort(program.program)
    await shop.ended(program)
    assert (jog.over, waiting.state) == (False, "queued")
    await shop.ended(waiting)
    assert (jog.state, shop.at()[1]) == ("finished", pytest.approx(1.0))


async def test_a_move_that_a_probe_ends_in_a_fault_leaves_the_pause_alone(shop: Shop) -> None:
    program = await shop.at_pause(["T1 M6", "G0 Z10", "T2 M6", "G0 Z2"])
    probing = await shop.by_hand("G90 G38.2 Z0 F600")
    assert (probing.state, program.state) == ("faulted", "paused")
    assert shop.at()[2] == pytest.approx(0.0)
    assert (await shop.resumed(program)).state == "finished"


async def test_an_axis_that_loses_its_drive_at_the_pause_has_to_be_energized_before_it_goes_on(
    shop: Shop,
) -> None:
    program = await shop.at_pause(CHANGE)
    assert (await shop.by_hand("G1001 P0", axes=[0])).state == "finished"
    await shop.resumed(program)
    assert program.fault is not None
    assert (program.state, program.done, program.fault.axis) == ("faulted", 4, 0)
    again = await shop.begin_part(CHANGE)
    await shop.paused(again)
    await shop.by_hand("G1001 P0", axes=[0])
    await shop.jogged(0, 2.0)
    assert (await shop.resumed(again)).state == "finished"


async def test_an_axis_that_moves_on_by_itself_holds_the_resume_up(shop: Shop) -> None:
    program = await shop.at_pause(CHANGE)
    assert (await shop.by_hand("G1020 Y400", axes=[1])).state == "finished"
    with pytest.raises(Refused) as refused:
        shop.service.resume(None)
    assert (refused.value.code, "Y moves by itself" in refused.value.message) == ("MC512", True)
    await shop.until(lambda: shop.service.port.snapshot().states[1] == "standstill")
    assert (await shop.resumed(program)).state == "finished"


async def test_the_spindle_that_turns_on_at_the_pause_is_not_lent(tmp_path: Path) -> None:
    shop = Shop(mill("spindle_axis = 3\n" + SPINDLE), tmp_path)
    program = await shop.at_pause(["T1 M6", "S600 M3", "G1 X10 F3000", "M0 (measure)", "G1 X20", "M5"])
    # the line that asks for it, though motion has come to the one before
    assert program.status().line == 4
    with pytest.raises(Refused, match="MC512: "):
        await shop.jog(3, 1.0)
    await shop.jogged(0, 2.0)
    assert shop.service.port.snapshot().states[3] == "speed"
    await shop.resumed(program)
    assert (program.state, shop.at()[0]) == ("finished", pytest.approx(20.0))
    await shop.stop()


async def test_axes_can_be_homed_at_the_pause(tmp_path: Path) -> None:
    shop = Shop(homed_mill(), tmp_path)
    await shop.homing.reference("page", {0: 0.0, 1: 0.0, 2: 0.0})
    program = await shop.at_pause(["T1 M6", "G0 X10", "T2 M6", "G0 X20"])
    # the axis stands 90 mm further than was thought
    await shop.homing.reference("page", {0: 0.1})
    await shop.resumed(program)
    assert (program.state, shop.at()[0]) == ("finished", pytest.approx(20.0))
    await shop.stop()


async def test_an_approved_run_goes_on_only_from_within_what_was_approved(tmp_path: Path) -> None:
    shop = Shop(homed_mill(), tmp_path)
    await shop.homing.reference("page", {0: 0.0, 1: 0.0, 2: 0.0})
    envelope = Envelope(low=(-0.001,) * 3, high=(0.05,) * 3, speed=(0.3,) * 3, seconds=60.0)
    program = await shop.at_pause(CHANGE, envelope=envelope)
    await shop.jogged(1, 100.0)
    with pytest.raises(Refused) as refused:
        shop.service.resume(None)
    assert (refused.value.code, program.state) == ("MC460", "paused")
    await shop.jogged(1, -90.0)
    # its bounds are places by the references of now
    with pytest.raises(Refused, match="MC512: "):
        await shop.homing.reference("page", {0: 0.1})
    assert (await shop.resumed(program)).state == "finished"
    await shop.stop()


async def test_streamed_lines_wait_at_the_pause_and_are_read_with_the_zero_of_then(shop: Shop) -> None:
    program = await shop.begin_part(["T1 M6", "G0 X10"], close=False)
    shop.service.lines.submit("cam", program.program, 3, ["M0", "G0 X20"])
    await shop.paused(program)
    shop.service.lines.submit("cam", program.program, 5, ["G0 Y5"])
    await shop.by_hand("G10 L20 P1 X0")
    shop.service.lines.close("cam", program.program)
    await shop.resumed(program)
    assert (program.done, shop.at()) == (5, pytest.approx((30.0, 5.0, 0.0)))


async def test_a_pause_in_a_loop_counts_each_time(shop: Shop) -> None:
    program = await shop.begin_part(["G91", "o1 repeat [2]", "G0 X10", "M0", "o1 endrepeat", "G0 X1"])
    for distance in (5.0, 7.0):
        await shop.paused(program)
        await shop.jogged(0, distance)
        shop.service.resume(None)
        await shop.until(lambda: program.state != "paused")
    await shop.ended(program)
    assert shop.at()[0] == pytest.approx(33.0)


class Restarts:
    """Servers on one journal, one after the other, each killed."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.shop: Shop | None = None
        self._starts = 0

    def start(self) -> Shop:
        if self.shop is not None:
            self.shop.kill()
        self._starts += 1
        made = mill("[recovery]\nsafe_axis = 2\nsafe_position = 100.0\n")
        self.shop = Shop(made, self._folder, f"s{self._starts}")
        return self.shop

    async def killed(self, shop: Shop, program: Program, done: int) -> Shop:
        await shop.until(lambda: program.ack().done >= done)
        return self.start()


@pytest.fixture
async def restarts(tmp_path: Path) -> AsyncIterator[Restarts]:
    made = Restarts(tmp_path)
    yield made
    if made.shop is not None:
        await made.shop.stop()


async def test_a_program_whose_server_is_killed_at_the_pause_pauses_there_again(restarts: Restarts) -> None:
    shop = restarts.start()
    program = await shop.at_pause(CHANGE)
    await shop.by_hand("G10 L20 P1 X0 Z0")
    shop = await restarts.killed(shop, program, 3)
    again = await shop.service.continue_program("page", program.program, confirmed=Confirmation(way=True))
    await shop.paused(again)
    assert (again.start_line, again.notice) == (4, "fit tool 2, then resume")
    await shop.resumed(again)
    assert shop.at() == pytest.approx((50.0, 20.0, 35.0))


async def test_a_program_that_is_gone_on_with_has_the_zero_and_place_of_its_pause(restarts: Restarts) -> None:
    lines = [*CHANGE[:4], "G91 G1 Y1 F3000", "G1 Y1", "M0", "G90 G1 X40", "G1 Z1"]
    shop = restarts.start()
    program = await shop.at_pause(lines)
    await shop.by_hand("G10 L20 P1 X0 Z0")
    await shop.jogged(1, 50.0)
    shop.service.resume(None)
    await shop.until(lambda: program.state == "paused" and program.progress.done >= 6)
    shop = await restarts.killed(shop, program, 6)
    again = await shop.service.continue_program("page", program.program, confirmed=Confirmation(way=True))
    await shop.paused(again)
    assert shop.at()[:2] == pytest.approx((10.0, 72.0))
    # once more, from the one that went on
    shop = await restarts.killed(shop, again, 6)
    again = await shop.service.continue_program("page", again.program, confirmed=Confirmation(way=True))
    await shop.paused(again)
    assert shop.at()[:2] == pytest.approx((10.0, 72.0))
    await shop.resumed(again)
    assert shop.at() == pytest.approx((50.0, 72.0, 6.0))


async def test_increments_gone_on_with_twice_start_from_where_the_program_began(restarts: Restarts) -> None:
    shop = restarts.start()
    program = await shop.at_pause(["G91", "G0 X10", "G0 X10", "M0", "G0 X10", "M0", "G0 X10"])
    shop = await restarts.killed(shop, program, 3)
    again = await shop.service.continue_program("page", program.program, confirmed=Confirmation(way=True))
    await shop.paused(again)
    shop.service.resume(None)
    await shop.until(lambda: again.state == "paused" and again.progress.done >= 5)
    shop = await restarts.killed(shop, again, 5)
    again = await shop.service.continue_program("page", again.program, confirmed=Confirmation(way=True))
    await shop.paused(again)
    assert shop.at()[0] == pytest.approx(30.0)
    await shop.resumed(again)
    assert shop.at()[0] == pytest.approx(40.0)


async def test_zero_that_is_changed_elsewhere_still_refuses_to_go_on(restarts: Restarts) -> None:
    shop = restarts.start()
    program = await shop.at_pause(CHANGE)
    shop = await restarts.killed(shop, program, 3)
    await shop.run("G10 L2 P1 X3")
    with pytest.raises(ServiceError, match="MC594: "):
        await shop.service.continue_program("page", program.program, confirmed=Confirmation(way=True))
    await asyncio.sleep(0)


async def test_a_tool_of_an_arm_goes_on_from_the_pose_to_which_its_joints_were_jogged(tmp_path: Path) -> None:
    shop = Shop(load_machine("arm6"), tmp_path)
    program = await shop.at_pause(
        ["G1010", "G94 F3000", "T1 G01 Z600", "M00", "G91 G01 X-10", "G90 G01 Z650"]
    )
    before = shop.at()
    await shop.jogged(0, 5.0)
    await shop.resumed(program)
    assert (program.state, program.done, program.fault) == ("finished", 6, None)
    # the base was jogged by 5 degrees, and ten millimetres in X turn it on a little
    assert np.degrees(shop.position(0)) == pytest.approx(before[0] * MM * 57.2958 + 5.0, abs=0.3)
    path = np.array(shop.setpoints)
    machine = load_machine("arm6")
    fastest = np.array([axis.max_velocity for axis in machine.axes[:3]])
    assert (np.abs(np.diff(path, axis=0)) * 1000.0 <= fastest * (1 + 1e-6)).all()
    await shop.stop()
