"""Programs, jogs and homing stop before their bodies touch, whatever is ordered meanwhile."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import random
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from mcserver.clearance.scene import Scene
from mcserver.errors import Refused
from mcserver.executor.entries import Control, ControlKind
from mcserver.executor.shm.feedback import SlotFeedback, SlotState
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.motion.canonical import AxisOperation
from mcserver.motion.pieces import Rows
from mcserver.planning.clearance_guard import ClearanceGuards
from mcserver.planning.shared_space import Claim, Extent, SharedSpace, Tenant
from mcserver.service.program import Program
from mcserver.service.program_options import ProgramOptions
from mcserver.simulation.simulation import simulate
from mcserver.simulation.virtual_executor import VirtualExecutor
from mcserver.units import MM
from tests.clearance.cells import Start, fault_of, place
from tests.clearance.machines import MILL, TOOL, VISE, block, mill, shaped_mill
from tests.service.virtual_cell import VirtualCell

Make = Callable[..., VirtualCell]

# face of the vise at X100, its top at Z40; the tool has a radius of 5 mm, the margin is 1 mm
LAST_X, LAST_Z = 94.0, 41.0


@pytest.fixture
def make(start: Start) -> Make:
    return lambda *more: start(mill(VISE, *more))


async def test_a_program_stops_before_what_it_would_hit_and_names_line_and_bodies(make: Make) -> None:
    cell = make()
    program = await cell.run("G1010", "G1 Z20 F6000", "G1 X150", "G1 Z100")
    assert (program.state, fault_of(program)) == ("faulted", ("MC320", 3))
    assert program.fault is not None
    assert "'tool'" in program.fault.message
    assert "'vise'" in program.fault.message
    assert program.fault.hint
    assert [event.fault for event in cell.events if event.kind == "fault"] == [program.fault]
    assert program.done == 2
    assert LAST_X - 0.3 <= place(cell, 0) <= LAST_X + 0.02


async def test_a_line_that_is_clear_by_more_than_the_margin_runs(make: Make) -> None:
    cell = make()
    program = await cell.run("G1010", f"G1 Z{LAST_Z + 0.1} F6000", "G1 X300", "G0 X0")
    assert (program.state, program.done) == ("finished", 4)


async def test_a_rapid_into_the_vise_does_not_begin(make: Make) -> None:
    cell = make()
    program = await cell.run("G1010", "G0 Z20", "G0 X150")
    assert (program.state, fault_of(program), program.done) == ("faulted", ("MC320", 3), 2)
    assert (place(cell, 0), place(cell, 2)) == pytest.approx((0.0, 20.0))


async def test_a_rapid_whose_axes_could_meet_the_vise_on_another_way_does_not_begin(make: Make) -> None:
    cell = make()
    program = await cell.run("G1010", "G0 X150 Z45", "G0 X300 Z20")
    assert (program.state, fault_of(program)) == ("faulted", ("MC320", 3))
    assert place(cell, 0) == pytest.approx(150.0)


async def jog(cell: VirtualCell, axis: int, velocity: float, distance: float | None = None) -> Program:
    return await cell.ended(await cell.jog(axis, distance, velocity))


async def test_a_held_jog_stops_at_the_margin_and_may_go_back(make: Make) -> None:
    cell = make()
    await cell.run("G1010", "G0 Z20")
    program = await jog(cell, 0, 200.0)
    assert (program.state, fault_of(program)) == ("faulted", ("MC320", 2))
    assert LAST_X - 0.3 <= place(cell, 0) <= LAST_X + 0.02
    here = place(cell, 0)
    for _ in range(3):
        assert (await jog(cell, 0, 5.0, distance=1.0)).state == "faulted"
    # whoever jogs sees it: nobody else is called
    assert not [event for event in cell.events if event.kind == "fault"]
    assert here <= place(cell, 0) <= LAST_X + 0.02
    back = await jog(cell, 0, 50.0, distance=-10.0)
    assert (back.state, back.fault) == ("finished", None)


async def test_a_step_that_would_hit_stops_at_the_margin(make: Make) -> None:
    cell = make()
    await cell.run("G1010", "G0 X150")
    assert (await jog(cell, 2, 50.0, distance=-80.0)).state == "faulted"
    assert LAST_Z - 0.02 <= place(cell, 2) <= LAST_Z + 0.3


async def test_what_touches_already_may_come_apart_and_no_nearer(make: Make) -> None:
    cell = make(block("lump", (0.0, 8.0, 130.0), 10.0))
    assert (await cell.run("G1010", "G1 Y1 F600")).state == "faulted"
    assert place(cell, 1) == pytest.approx(0.0, abs=0.01)
    assert (await cell.run("G1010", "G1 Y-5 F600")).state == "finished"
    assert (await cell.run("G1010", "G1 Y0 F600")).state == "faulted"
    assert place(cell, 1) < -1.9


async def test_a_line_into_a_zone_stops_before_it(make: Make) -> None:
    zone = '[[zone]]\nname = "door"\nsize_mm = [20.0, 400.0, 400.0]\nat_mm = [-60.0, 0.0, 100.0]\n'
    cell = make(zone)
    program = await cell.run("G1010", "G1 X-100 F3000")
    assert (program.state, fault_of(program)) == ("faulted", ("MC321", 2))
    assert program.fault is not None
    assert "would enter the keep-out zone 'door'" in program.fault.message
    assert place(cell, 0) == pytest.approx(-44.0, abs=0.3)


async def test_a_line_out_of_a_zone_that_keeps_in_stops_before_its_edge(make: Make) -> None:
    cell = make('[[zone]]\nname = "cell"\nkind = "keep_in"\nsize_mm = [200.0, 300.0, 400.0]\n')
    program = await cell.run("G1010", "G1 X98 F6000")
    assert fault_of(program) == ("MC321", 2)
    assert program.fault is not None
    assert "would leave the keep-in zone 'cell'" in program.fault.message


async def test_lines_that_come_one_by_one_stop_too(make: Make) -> None:
    cell = make()
    program = await cell.service.open("test")
    for number, line in enumerate(("G1010", "G1 Z20 F6000", "G1 X80", "G1 X150"), start=1):
        await cell.service.lines.submit("test", program.program, number, [line])
    assert fault_of(await cell.ended(program)) == ("MC320", 4)
    assert program.done == 3
    assert place(cell, 0) <= LAST_X + 0.02


@pytest.mark.parametrize("lines", [("G1 X90 F12000", "G1 X150"), ("G1 X150 F12000",)])
async def test_orders_on_the_way_do_not_let_it_pass(make: Make, lines: tuple[str, ...]) -> None:
    cell = make()
    await cell.run("G1010", "G0 Z20")
    program = await cell.begin(*lines)
    for number, ratio in enumerate((0.3, 2.0, 0.05, 1.5, 2.0)):
        await cell.until(lambda at=20.0 * number: place(cell, 0) > at or program.ended)  # type: ignore[misc]
        cell.service.set_override(ratio, program.program)
        cell.service.hold(program.program)
        cell.service.resume(program.program)
    cell.service.set_override(1.0, program.program)
    await cell.ended(program)
    assert program.state == "faulted"
    assert LAST_X - 0.5 <= place(cell, 0) <= LAST_X + 0.02


def straight(first: int, line: int, column: int, way: Sequence[float]) -> Rows:
    """Rows of one axis from place to place [mm]."""
    position = np.zeros((len(way), 3))
    position[:, column] = np.array(way) * MM
    driven = np.full(len(way), 1 << column, np.uint64)
    return Rows(first, position, np.zeros_like(position), driven, np.full(len(way), line))


@pytest.mark.parametrize("operation", [each for each in AxisOperation if each is not AxisOperation.CAPTURE])
def test_an_axis_that_is_let_go_counts_where_its_motion_ends(operation: AxisOperation) -> None:
    executor = VirtualExecutor(mill(VISE))
    executor.step()
    guards = ClearanceGuards(executor.machine, SharedSpace(executor.machine, lambda: executor.feedback))
    guard = guards.guard("one", 0, frozenset((0, 1, 2)))
    # nothing of it is played yet
    assert guard.admit_rows(straight(1, 1, 2, np.linspace(100.0, 43.0, 50).tolist())) == 50
    assert guard.admit_rows(straight(51, 2, 0, np.linspace(0.0, 100.0, 50).tolist())) == 50
    assert guard.admit_control(
        Control(ControlKind.AXIS, 101.0, 3, axes=1, operation=list(AxisOperation).index(operation))
    )
    assert guard.admit_rows(straight(102, 4, 2, np.linspace(43.0, 38.0, 50).tolist())) < 50
    assert guard.contact is not None
    assert guard.contact.line == 4


def test_an_axis_that_moves_since_before_the_planner_may_be_anywhere_on_its_way() -> None:
    executor = VirtualExecutor(mill(VISE))
    executor.step()
    sink = executor.open_slot(0, 0b111)
    sink.put_control(Control(ControlKind.RAPID, 0.0, 1, axes=1, values=(100.0 * MM, 0.0, 0.0)))
    sink.put_control(Control(ControlKind.FINISH, 0.0, 1))
    executor.step(50)
    assert executor.feedback.setpoint[0] < 10.0 * MM
    # it was started anew, and knows nothing of the rapid
    guards = ClearanceGuards(executor.machine, SharedSpace(executor.machine, lambda: executor.feedback))
    guard = guards.guard("two", 1, frozenset((0, 1, 2)))
    assert guard.admit_rows(straight(1, 2, 2, np.linspace(100.0, 30.0, 50).tolist())) < 50


# a ram along X and a shuttle along Y, which meet where both are at 100
SHARED = """
[[body]]
name = "ram"
shape = "box"
size_mm = [20.0, 20.0, 20.0]
carried_by = [0]
[[body]]
name = "shuttle"
shape = "box"
size_mm = [20.0, 20.0, 20.0]
at_mm = [100.0, -100.0, 0.0]
carried_by = [1]
"""


def shared() -> Machine:
    return parse_machine("\n".join((MILL, SHARED)))


class Watch:
    """Looks at the setpoints of every cycle of a cell."""

    def __init__(self, cell: VirtualCell) -> None:
        self._cell = cell
        self._rows: list[Any] = []
        self._task = asyncio.ensure_future(self._run())

    async def _run(self) -> None:
        seen = 0
        while True:
            history = self._cell.executor.history
            first, rows = history.since(seen)
            assert first == seen
            self._rows.append(history.block(rows, "setpoint").copy())
            seen += len(rows)
            await asyncio.sleep(0)

    async def least(self, machine: Machine) -> float:
        """End, and return the least distance of any pair in any cycle [mm]."""
        await asyncio.sleep(0)
        self._task.cancel()
        scene = Scene(machine)
        rows = np.concatenate(self._rows)
        kept = np.append(True, np.diff(rows, axis=0).any(axis=1))
        least = np.inf
        for row in rows[kept]:
            scene.place(row)
            least = min(least, *(scene.distance(pair) for pair in range(len(scene.pairs))))
        return float(least) / MM


def said_of(cell: VirtualCell, program: Program) -> list[str]:
    """What a program has said to the operator."""
    said = [event for event in cell.events if event.kind == "program.message"]
    return [event.message for event in said if event.program == program.program]


async def test_a_program_stops_before_the_axis_that_another_one_has_left_in_its_way(start: Start) -> None:
    cell = start(shared())
    assert (await cell.run("G1010 P1", "G1 Y100 F6000", axes=[1])).state == "finished"
    program = await cell.run("G1010 P0", "G1 X200 F6000", axes=[0])
    assert fault_of(program) == ("MC320", 2)
    assert place(cell, 0) == pytest.approx(79.0, abs=0.3)


@pytest.mark.parametrize("word", ["G1 X200 F6000", "G0 X200"])
async def test_the_later_of_two_programs_waits_before_the_other_and_names_it(start: Start, word: str) -> None:
    cell = start(shared())
    watch = Watch(cell)
    # comes by for four seconds
    other = await cell.begin("G1010 P1", "G1 Y85 F12000", "G1 Y115 F300", "G1 Y200 F12000", axes=[1])
    await cell.until(lambda: place(cell, 1) > 86.0)
    program = await cell.begin("G1010 P0", word, "G1 X10 F6000", axes=[0])
    await cell.until(lambda: any(other.program in each for each in said_of(cell, program)))
    assert place(cell, 0) < 79.1
    assert (await cell.ended(program)).state == "finished"
    assert (await cell.ended(other)).state == "finished"
    assert place(cell, 0) == pytest.approx(10.0)
    [said] = said_of(cell, program)
    assert all(each in said for each in ("waits", "'ram'", "'shuttle'", other.program))
    assert await watch.least(shared()) >= 0.98


async def test_a_program_that_waits_is_aborted_where_it_stands(start: Start) -> None:
    cell = start(shared())
    other = await cell.begin("G1010 P1", "G1 Y100 F12000", "G4 P600", axes=[1])
    await cell.until(lambda: place(cell, 1) > 99.0)
    program = await cell.begin("G1010 P0", "G1 X200 F6000", axes=[0])
    await cell.until(lambda: bool(said_of(cell, program)) and not any(cell.executor.feedback.velocity))
    cell.service.abort(program.program)
    assert (await cell.ended(program)).state == "aborted"
    assert 78.0 < place(cell, 0) < 79.1
    # a jog does not wait: nothing moves by itself behind a button
    step = await cell.ended(await cell.jog(0, 30.0, 50.0))
    assert fault_of(step)[0] == "MC320"
    assert other.state == "running"


# with which the ram and the shuttle stand in each other's way
ARM_OF_THE_RAM = """
[[body]]
name = "arm"
shape = "box"
size_mm = [20.0, 20.0, 20.0]
at_mm = [21.0, 30.0, 0.0]
carried_by = [0]
"""


async def test_of_two_programs_that_wait_for_each_other_the_later_ends_and_says_so(start: Start) -> None:
    machine = parse_machine("\n".join((MILL, SHARED, ARM_OF_THE_RAM)))
    cell = start(machine)
    watch = Watch(cell)
    below = await cell.begin("G1010 P1", "G1 Y85 F12000", "G1 Y95 F300", "G1 Y200 F12000", axes=[1])
    across = await cell.begin("G1010 P0", "G1 X200 F6000", axes=[0])
    assert fault_of(await cell.ended(below)) == ("MC320", 4)
    assert below.fault is not None
    assert across.program in below.fault.message
    assert "wait for each other" in below.fault.message
    # what the other waited for stands there now
    assert fault_of(await cell.ended(across)) == ("MC320", 2)
    assert await watch.least(machine) >= 0.98


@pytest.mark.parametrize("left", [6, 14])
async def test_one_that_was_held_shortly_before_where_it_waits_ends_when_both_wait_for_each_other(
    start: Start, left: int
) -> None:
    cell = start(parse_machine("\n".join((MILL, SHARED, ARM_OF_THE_RAM))), turn_s=0.001)
    below = await cell.begin("G1010 P1", "G1 Y85 F12000", "G1 Y95 F300", "G1 Y200 F300", axes=[1])
    across = await cell.begin("G1010 P0", "G1 X200 F12000", axes=[0])
    await cell.until(lambda: bool(said_of(cell, below)))
    assert below.slot is not None
    rows = cell.executor.executor._slots[below.slot].playback
    await cell.until(lambda: cell.executor.feedback.slots[below.slot or 0].u > rows.last_u - left)
    cell.service.hold(below.program)
    await cell.until(lambda: below.state == "held")
    assert cell.executor.feedback.slots[below.slot].u < rows.last_u
    cell.service.resume(below.program)
    assert fault_of(await cell.ended(below)) == ("MC320", 4)
    assert fault_of(await cell.ended(across)) == ("MC320", 2)


async def test_the_status_of_a_program_that_waits_says_for_which_one(start: Start) -> None:
    cell = start(shared())
    other = await cell.begin("G1010 P1", "G1 Y85 F12000", "G1 Y115 F300", "G1 Y200 F12000", axes=[1])
    await cell.until(lambda: place(cell, 1) > 86.0)
    program = await cell.begin("G1010 P0", "G1 X200 F6000", "G1 X10 F6000", axes=[0])
    await cell.until(lambda: bool(program.status().waits_for))
    assert (program.status().state, program.status().waits_for) == ("running", other.program)
    await cell.until(lambda: not program.status().waits_for)
    assert not program.ended
    assert (await cell.ended(program)).state == "finished"


@pytest.mark.parametrize("seed", range(4))
async def test_two_programs_never_touch_whatever_is_ordered_and_both_end(start: Start, seed: int) -> None:
    draw = random.Random(seed)
    cell = start(shared())
    watch = Watch(cell)
    programs = []
    for axis, letter in enumerate("XY"):
        lines = [f"G1010 P{axis}"]
        for _ in range(12):
            word = draw.choice(("G0", "G1", "G1", "G1020"))
            lines.append(
                f"{word} {letter}{draw.uniform(0.0, 200.0):.2f}"
                + (f" F{draw.choice((600, 3000, 12000))}" if word == "G1" else "")
            )
        programs.append(await cell.begin(*lines, axes=[axis]))
    for _ in range(20):
        now = cell.executor.feedback.time
        await cell.until(
            lambda now=now: (
                cell.executor.feedback.time > now + 0.3  # type: ignore[misc]
                or all(program.ended for program in programs)
            )
        )
        one = draw.choice(programs)
        # one that is ending already takes no order
        with contextlib.suppress(Refused):
            cell.service.set_override(draw.choice((0.3, 1.0, 2.0)), one.program)
            cell.service.hold(one.program)
            cell.service.resume(one.program)
    ended = [await cell.ended(program) for program in programs]
    await cell.until(lambda: not any(cell.executor.feedback.velocity))
    for program in ended:
        assert program.state == "finished" or fault_of(program)[0] == "MC320"
    assert await watch.least(shared()) >= 0.98


def homed(order: int, length: float) -> Machine:
    """A mill whose tool stands in the midst of the table's posts, with switches at X-10 and Z210."""
    text = '[machine]\nname = "mill"\n'
    for index, (start, direction, first, switch) in enumerate(
        (
            (0.0, "negative", 1, "[-1000.0, -10.0]"),
            (0.0, "negative", 9, ""),
            (100.0, "positive", order, "[210.0, 1000.0]"),
        )
    ):
        text += (
            f'[[axis]]\nindex = {index}\ntype = "linear"\nmax_velocity = 200.0\nmax_acceleration = 2000.0\n'
        )
        text += "min_position = -20.0\nmax_position = 220.0\nmax_following_error = 5.0\n"
        if switch:
            text += f'[axis.homing]\nmethod = "switch"\nvelocity = 50.0\ndirection = "{direction}"\n'
            text += f"order = {first}\n"
            text += f"position = {-10.0 if direction == 'negative' else 210.0}\n"
        text += f"[axis.drive]\ninitial_position = {start}\n" + (
            f"home_switch = {switch}\n" if switch else ""
        )
    post = """
[[body]]
name = "post"
shape = "box"
size_mm = [10.0, 10.0, 200.0]
at_mm = [-15.0, 0.0, 50.0]
"""
    return parse_machine("\n".join((text, TOOL.replace("length_mm = 60.0", f"length_mm = {length}"), post)))


async def test_homing_that_would_sweep_a_post_does_not_begin(start: Start) -> None:
    cell = start(homed(1, 60.0))
    program = await cell.ended(await cell.homing.home("test", None))
    assert fault_of(program)[0] == "MC320"
    assert place(cell, 0) == pytest.approx(0.0, abs=0.01)
    assert not any(cell.homed()[each] for each in (0, 2))


async def test_an_axis_that_is_homed_first_lifts_the_tool_over_the_post(start: Start) -> None:
    cell = start(homed(0, 60.0))
    program = await cell.ended(await cell.homing.home("test", None))
    assert (program.state, program.fault) == ("finished", None)
    assert [event.axis for event in cell.events if event.kind == "axis.homed"] == [2, 0]


@pytest.mark.parametrize("seed", range(5))
async def test_feed_lines_stop_at_the_line_of_the_simulation_or_run_as_it_does(make: Make, seed: int) -> None:
    draw = random.Random(seed)
    lines = ["G1010"]
    for _ in range(6):
        x, y, z = draw.uniform(0.0, 300.0), draw.uniform(-60.0, 60.0), draw.uniform(30.0, 100.0)
        lines.append(f"G1 X{x:.2f} Y{y:.2f} Z{z:.2f} F{draw.choice((2000, 12000))}")
    found = simulate("\n".join(lines), mill(VISE))
    expected = [("MC320", each["line"]) for each in found.report["diagnostics"]][:1]
    cell = make()
    watch = Watch(cell)
    program = await cell.run(*lines)
    assert [fault_of(program)] == expected if expected else program.state == "finished"
    assert await watch.least(mill(VISE)) >= 0.98


@pytest.mark.parametrize("seed", range(3))
async def test_whatever_a_program_and_its_operator_do_nothing_touches(make: Make, seed: int) -> None:
    draw = random.Random(100 + seed)
    cell = make()
    watch = Watch(cell)
    for _ in range(4):
        lines = ["G1010"]
        for _ in range(5):
            words = [
                f"{letter}{draw.uniform(0.0, 200.0):.2f}" for letter in draw.sample("XYZ", draw.randint(1, 3))
            ]
            code = draw.choice(("G0", "G1020", "G1 F12000", "G1 F3000"))
            lines.append(f"{code} {' '.join(words)}")
        program = await cell.begin(*lines, axes=[0, 1, 2])
        for _ in range(6):
            await asyncio.sleep(draw.uniform(0.0, 0.02))
            if program.over:
                break
            if draw.random() < 0.5:
                cell.service.set_override(draw.choice((0.2, 1.0, 1.7)), program.program)
            elif program.held:
                cell.service.resume(program.program)
            else:
                cell.service.hold(program.program)
        if program.held and not program.over:
            cell.service.resume(program.program)
        if draw.random() < 0.3 and not program.over:
            cell.service.abort(program.program, "enough")
        await cell.ended(program)
        if program.fault is not None:
            assert fault_of(program)[0] == "MC320"
    await cell.until(lambda: not any(cell.executor.feedback.velocity))
    assert await watch.least(mill(VISE)) >= 0.98


@pytest.mark.parametrize("last", ["G0 Y20", "G1 Y20 F12000", "G1020 Y20"])
async def test_a_program_that_has_nothing_more_for_now_is_where_it_stands(start: Start, last: str) -> None:
    cell = start(shared())
    open_still = await cell.service.open("test", ProgramOptions(axes=[1]))
    await cell.service.lines.submit("test", open_still.program, 1, ["G1010 P1", "G0 Y200", last])
    await cell.until(lambda: open_still.done == 3 and not any(cell.executor.feedback.velocity))
    assert (await cell.run("G1010 P0", "G1 X200 F6000", axes=[0])).state == "finished"
    cell.service.abort(open_still.program, "enough")


async def test_a_rapid_under_way_has_all_of_its_way_for_itself(start: Start) -> None:
    cell = start(shared())
    other = await cell.begin("G1010 P1", "G0 Y200", axes=[1])
    await cell.until(lambda: place(cell, 1) > 5.0)
    cell.service.hold(other.program)
    program = await cell.begin("G1010 P0", "G0 X200", axes=[0])
    await cell.until(lambda: any(other.program in each for each in said_of(cell, program)))
    assert place(cell, 0) == pytest.approx(0.0)
    cell.service.resume(other.program)
    assert (await cell.ended(other)).state == "finished"
    assert (await cell.ended(program)).state == "finished"


async def test_at_a_pause_a_jog_is_judged_and_so_is_the_program_from_where_the_jog_left_the_axes(
    make: Make,
) -> None:
    cell = make()
    program = await cell.begin("G1010", "G1 Z20 F6000", "G1 X20", "M00", "G1 X90", "G1 X20", "G1 X90")
    await cell.until(lambda: program.state == "paused")
    assert (await jog(cell, 0, 100.0, distance=200.0)).state == "faulted"
    assert LAST_X - 0.3 <= place(cell, 0) <= LAST_X + 0.02
    assert program.state == "paused"
    # over the vise, from where down to the program's height is no way
    assert (await jog(cell, 2, 50.0, distance=50.0)).state == "finished"
    assert (await jog(cell, 0, 100.0, distance=60.0)).state == "finished"
    cell.service.resume(None)
    await cell.ended(program)
    # at the height to which it was jogged all lines are clear
    assert (program.state, program.done, place(cell, 2)) == ("finished", 7, pytest.approx(70.0))


async def test_a_line_behind_a_pause_that_would_hit_from_where_the_axes_were_jogged_to_does_not_begin(
    make: Make,
) -> None:
    cell = make()
    program = await cell.begin("G1010", "G1 Z70 F6000", "G1 X20", "M00", "G1 Z20", axes=[0, 1, 2])
    await cell.until(lambda: program.state == "paused")
    assert (await jog(cell, 0, 100.0, distance=130.0)).state == "finished"
    cell.service.resume(None)
    await cell.ended(program)
    assert (program.state, fault_of(program)) == ("faulted", ("MC320", 5))
    assert LAST_Z - 0.02 <= place(cell, 2) <= LAST_Z + 0.3


def test_motion_counts_until_drives_have_got_their_shaped_setpoints() -> None:
    machine = shaped_mill(VISE)
    executor = VirtualExecutor(machine)
    executor.step()
    shown = [executor.feedback]
    space = SharedSpace(machine, lambda: shown[-1])
    every = np.ones(3, np.bool_)
    first, other = Tenant("first", 0, every), Tenant("other", 1, ~every)
    space.enter(first)
    far = np.array([0.5, 0.0, 0.0])
    first.claim(Claim(every, Extent(far, far), 10.0, alone=False, number=1, zones=0, movers=every))
    assert machine.shaping is not None
    for cycles, there in ((0, 0.5), (machine.shaping.length - 1, 0.5), (machine.shaping.length, 0.0)):
        slots = (SlotFeedback(12.0, 1.0, SlotState.RUNNING, 1), *shown[0].slots[1:])
        time = shown[0].time + cycles * machine.cycle_s + 1e-9
        shown.append(dataclasses.replace(shown[0], slots=slots, time=time))
        extent, _ = space.extent(other)
        assert extent.high[0] == there, cycles
    executor.close()
