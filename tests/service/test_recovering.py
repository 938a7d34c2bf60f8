"""Going on in the middle of a program after the server was killed, on a virtual executor."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Sequence
from pathlib import Path

import pytest

from mcserver.errors import Refused, ServiceError
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.machine.machine_digest import machine_digest
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from mcserver.service.approach import Approach, Confirmation, plan_approach
from mcserver.service.program import Program
from mcserver.service.program_options import ProgramOptions
from mcserver.service.reports import Event
from mcserver.service.servo import open_servo
from tests.machine_text import axes_text
from tests.service.virtual_cell import VirtualCell

MM = 1e-3
RECOVERY = "[recovery]\nsafe_axis = 2\nsafe_position = 50.0\napproach_velocity = 20.0\n"
SPINDLE = axes_text([3], rotary=True, velocity=36000.0, acceleration=360000.0)
CNC = (
    '[dialect]\nprofile = "cnc"\nspindle_axis = 3\n'
    "outputs = { M8 = { coolant = true }, M9 = { coolant = false } }\n"
    '[[output]]\nnumber = 0\nname = "coolant"\n'
)
# on top of the part, and into it
PART = [
    "G1010",
    "G94 F6000",
    "G00 Z10",
    "G00 X100 Y40",
    "G01 Z-5",
    "G01 X120",
    "G01 X140",
    "G01 X160",
    "G00 Z10",
]


def machine(more: str = "", start: Sequence[float] = (0.0, 0.0, 0.0)) -> Machine:
    keys = "min_position = -200.0\nmax_position = 500.0\nmax_following_error = 1.0"
    axes = "".join(
        axes_text([index], keys=keys, drive_keys=f"initial_position = {at}") for index, at in enumerate(start)
    )
    return parse_machine(f'[machine]\nname = "mill"\ncycle_hz = 500\n{axes}{more}')


class Rig:
    """Cells on one journal, one after the other; what the axes do is watched."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.cell: VirtualCell | None = None
        self.path: list[tuple[float, ...]] = []

    async def started(self, machine: Machine, *, file: Machine | None = None) -> VirtualCell:
        """Start a cell; ``file``: the machine as its file is read, where the axes stand elsewhere by now."""
        if self.cell is not None:
            self.cell.kill()
        self.path.clear()
        self._starts = getattr(self, "_starts", 0) + 1
        self.cell = VirtualCell(machine, self._folder, instance=f"start{self._starts}")
        if file is not None:
            self.cell.service._table.machine_file = machine_digest(file)
        return self.cell

    async def killed_in(
        self,
        machine: Machine,
        lines: Sequence[str],
        line: int,
        *,
        close: bool = True,
        switches: Switches | None = None,
    ) -> str:
        """Run a program until a line of it moves, and kill the server."""
        cell = await self.started(machine)
        program = await cell.service.open("cam", ProgramOptions(name="part.nc", switches=switches))
        cell.service.lines.submit("cam", program.program, 1, lines)
        if close:
            cell.service.lines.close("cam", program.program)
        await self.stopped_in(program, line)
        return program.program

    async def stopped_in(self, program: Program, line: int) -> None:
        """Wait for a line to begin, and stand still in it until the journal has what is before it."""
        cell = self.cell
        assert cell is not None
        while program.progress.started < line:
            assert not program.ended
            await asyncio.sleep(0)
        cell.service.set_override(0.0, program.program)
        await cell.until(lambda: program.ack().done >= line - 1)
        assert not program.ended

    async def until_ended(self, program: Program) -> Program:
        """Wait for a program's end, noting where the axes are."""
        cell = self.cell
        assert cell is not None

        def done() -> bool:
            self.path.append(tuple(cell.position(axis) / MM for axis in range(3)))
            return program.ended

        await cell.until(done)
        return program


@pytest.fixture
async def rig(tmp_path: Path) -> AsyncIterator[Rig]:
    made = Rig(tmp_path)
    yield made
    if made.cell is not None:
        await made.cell.stop()


async def look(cell: VirtualCell, program: str, line: int | None = None) -> Approach:
    found = await cell.service.recovery.recorded(program)
    status = found.status
    start = await cell.service.recovery.start_of(status.axes, line or status.done + 1, program=status.program)
    return cell.service.recovery.plan(start, status.axes)


async def test_a_program_goes_on_by_one_call_with_what_it_had_energized(rig: Rig) -> None:
    name = await rig.killed_in(machine(RECOVERY), PART, 7)
    cell = await rig.started(machine(RECOVERY))
    program = await rig.until_ended(await cell.service.continue_program("page", name))
    assert (program.state, program.fault, program.start_line) == ("finished", None, 7)
    assert rig.path[-1] == pytest.approx((160.0, 40.0, 10.0), abs=1e-3)


async def test_a_gantry_pair_is_energized_and_moved_by_its_leader(rig: Rig) -> None:
    pair = axes_text([3], keys="gantry = { leader = 1, max_skew = 1.0 }", drive_keys="initial_position = 0.0")
    gantry = machine(pair + RECOVERY)
    name = await rig.killed_in(gantry, PART, 7)
    cell = await rig.started(gantry)
    approach = await look(cell, name)
    assert (approach.energize, [each.axis for each in approach.axes]) == ((0, 1, 2), [0, 1, 2])
    program = await rig.until_ended(await cell.service.continue_program("page", name))
    assert (program.state, program.fault, program.start_line) == ("finished", None, 7)


async def test_the_way_is_up_over_and_down_where_the_machine_file_names_a_safe_height(rig: Rig) -> None:
    name = await rig.killed_in(machine(RECOVERY), PART, 7)
    cell = await rig.started(machine(RECOVERY))
    approach = await look(cell, name)
    assert [step.text for step in approach.way] == [
        "lift: Z to 50.000 mm, slowly",
        "over: X to 120.000 mm, Y to 40.000 mm",
        "down: Z to -5.000 mm, slowly",
    ]
    assert approach.energize == (0, 1, 2)
    await rig.until_ended(await cell.service.continue_program("page", name))
    for x, y, z in rig.path:
        if z < 50.0 - 1e-3:
            # below the safe height: where it began, or where the part is
            assert (x, y) == pytest.approx((0.0, 0.0), abs=1e-3) or (
                x >= 120.0 - 1e-3 and y == pytest.approx(40.0)
            )


async def test_without_a_safe_height_the_way_has_to_be_confirmed_and_is_no_diagonal(rig: Rig) -> None:
    name = await rig.killed_in(machine(), PART, 7)
    cell = await rig.started(machine())
    with pytest.raises(ServiceError) as refused:
        await cell.service.continue_program("page", name)
    assert refused.value.code == "MC592"
    assert "[recovery]" in refused.value.hint
    assert cell.position(0) == 0.0
    program = await cell.service.continue_program("page", name, confirmed=Confirmation(way=True))
    await rig.until_ended(program)
    assert program.state == "finished"
    for x, y, z in rig.path:
        # one axis at a time until all are there
        moved = [abs(at) > 1e-3 for at in (x, y, z)]
        assert moved in ([False] * 3, [True, False, False], [True, True, False], [True] * 3)


async def test_axes_that_stand_there_need_no_way_and_nothing_to_confirm(rig: Rig) -> None:
    name = await rig.killed_in(machine(), PART, 7)
    cell = await rig.started(machine(start=(120.0, 40.005, -5.0)), file=machine())
    approach = await look(cell, name)
    assert (approach.way, approach.needs) == ((), ())
    program = await rig.until_ended(await cell.service.continue_program("page", name))
    assert program.state == "finished"


async def test_increments_go_on_from_where_the_program_began(rig: Rig) -> None:
    lines = ["G1010", "G94 F6000 G91", *["G01 X40"] * 6]
    began = machine(RECOVERY, start=(7.0, 0.0, 0.0))
    name = await rig.killed_in(began, lines, 5)
    cell = await rig.started(machine(RECOVERY, start=(30.0, 0.0, 0.0)), file=began)
    (x, _, _) = (await look(cell, name)).axes
    assert (x.now, x.there) == pytest.approx((30.0, 87.0))
    await rig.until_ended(await cell.service.continue_program("page", name))
    assert rig.path[-1][0] == pytest.approx(247.0, abs=1e-3)


async def test_no_line_runs_again_and_the_call_goes_on_with_the_last_that_went_on(rig: Rig) -> None:
    name = await rig.killed_in(machine(RECOVERY), PART, 6)
    cell = await rig.started(machine(RECOVERY))
    second = await cell.service.continue_program("page", name)
    assert second.start_line == 6
    await rig.stopped_in(second, 8)
    cell = await rig.started(machine(RECOVERY))
    third = await cell.service.continue_program("page", name)
    assert (third.resume_of, third.start_line) == (second.program, 8)
    await rig.until_ended(third)
    ended = lines_ended(cell.events, third.program)
    assert ended == [8, 9]
    for line in (None, len(PART) + 1):
        with pytest.raises(Refused, match="MC517: "):
            await cell.service.continue_program("page", name, line)


SKIPPING = Switches(block_delete=True, optional_stop=False)
SWITCHED = ["G1010", "G91 F6000", "G1 X10", "/G1 Y50", "G1 X10", "M01", "/G1 Y50", "G1 X10"]


async def test_a_program_goes_on_with_the_operators_switches_that_it_had(rig: Rig) -> None:
    name = await rig.killed_in(machine(RECOVERY), SWITCHED, 5, switches=SKIPPING)
    cell = await rig.started(machine(RECOVERY))
    for other in (AS_WRITTEN, Switches(block_delete=True)):
        with pytest.raises(Refused) as refused:
            await cell.service.open("page", ProgramOptions(start_line=5, resume_of=name, switches=other))
        assert (refused.value.code, "block delete on" in refused.value.message) == ("MC483", True)
    program = await rig.until_ended(await cell.service.continue_program("page", name))
    assert (program.state, program.done, program.switches) == ("finished", len(SWITCHED), SKIPPING)
    assert rig.path[-1] == pytest.approx((30.0, 0.0, 0.0), abs=1e-3)


async def test_a_program_that_begins_with_a_pause_is_not_on_the_way_any_more(rig: Rig) -> None:
    cell = await rig.started(machine(RECOVERY))
    program = await cell.service.open("page", ProgramOptions(start_line=6, before=SWITCHED[:5]))
    cell.service.lines.submit("page", program.program, 6, SWITCHED[5:])
    assert program.notice == "on the way to line 6"
    await cell.until(lambda: program.state == "paused")
    assert (program.status().line, program.notice) == (6, "")


async def test_a_program_that_never_began_keeps_its_switches(rig: Rig) -> None:
    cell = await rig.started(machine(RECOVERY))
    before = await cell.service.open("cam")
    waiting = await cell.service.open("cam", ProgramOptions(switches=SKIPPING))
    cell.service.lines.submit("cam", waiting.program, 1, SWITCHED)
    cell.service.lines.close("cam", waiting.program)
    await cell.until(lambda: waiting.journaled == len(SWITCHED))
    assert (before.state, waiting.state) == ("running", "queued")
    cell = await rig.started(machine(RECOVERY))
    program = await rig.until_ended(await cell.service.continue_program("page", waiting.program))
    assert program.state == "finished"
    assert rig.path[-1] == pytest.approx((30.0, 0.0, 0.0), abs=1e-3)


async def test_a_start_from_a_line_is_behind_the_lines_that_the_switches_leave(rig: Rig) -> None:
    cell = await rig.started(machine(RECOVERY))
    for switches, y in ((AS_WRITTEN, 50.0), (SKIPPING, 0.0)):
        start = await cell.service.recovery.start_of([0, 1, 2], 5, before=SWITCHED[:4], switches=switches)
        assert start.state is not None
        assert start.state.positions[1] == pytest.approx(y * MM)


async def test_a_skipped_line_is_done_and_takes_a_step_of_single_line_mode(rig: Rig) -> None:
    cell = await rig.started(machine())
    program = await cell.service.open("cam", ProgramOptions(step=True, switches=SKIPPING))
    cell.service.lines.submit("cam", program.program, 1, SWITCHED)
    cell.service.lines.close("cam", program.program)
    for line in range(1, len(SWITCHED) + 1):
        assert program.done == line - 1
        cell.service.step("cam", program.program)
        await cell.until(lambda line=line: program.done == line)  # type: ignore[misc]
    await cell.until(lambda: program.ended)
    assert cell.position(0) == pytest.approx(30.0 * MM, abs=1e-6)
    assert cell.position(1) == 0.0


def lines_ended(events: Sequence[Event], program: str) -> list[int]:
    return [report.line for event in events if event.program == program for report in event.lines]


async def test_a_text_that_was_not_whole_waits_for_its_rest(rig: Rig) -> None:
    name = await rig.killed_in(machine(RECOVERY), PART[:8], 7, close=False)
    cell = await rig.started(machine(RECOVERY))
    program = await cell.service.continue_program("page", name)
    assert (program.queue.expected, program.closed) == (9, False)
    cell.service.lines.submit("page", program.program, 9, PART[8:])
    cell.service.lines.close("page", program.program)
    await rig.until_ended(program)
    assert rig.path[-1] == pytest.approx((160.0, 40.0, 10.0), abs=1e-3)


async def test_what_was_switched_on_is_named_and_set_only_where_somebody_says_so(rig: Rig) -> None:
    lines = ["G0 Z10", "M3 S600", "M8", "G1 X50 F6000", "G1 X100", "G1 X150", "G1 X200"]
    mill = machine(SPINDLE + CNC + RECOVERY)
    name = await rig.killed_in(mill, lines, 5)
    cell = await rig.started(mill)
    approach = await look(cell, name)
    assert [(each.name, each.there, each.now) for each in approach.switched] == [
        ("coolant", 1.0, 0.0),
        ("axis 3", pytest.approx(600.0), 0.0),
    ]
    with pytest.raises(ServiceError, match="MC593: "):
        await cell.service.continue_program("page", name)
    left = await rig.until_ended(
        await cell.service.continue_program("page", name, 5, confirmed=Confirmation(outputs="leave"))
    )
    assert left.state == "finished"
    assert cell.service.port.snapshot().outputs == [0.0]

    name = await rig.killed_in(mill, lines, 5)
    cell = await rig.started(mill)
    program = await cell.service.continue_program("page", name, confirmed=Confirmation(outputs="set"))
    await rig.until_ended(program)
    assert program.state == "finished"
    snapshot = cell.service.port.snapshot()
    assert (snapshot.outputs, snapshot.states[3]) == ([1.0], "speed")


HEATER = (
    '[dialect]\nprofile = "cnc"\n[dialect.outputs]\nM104 = { hotend = "S" }\nM109 = { hotend = "S" }\n'
    "M10 = { clamp = true }\nM11 = { clamp = false }\n"
    '[dialect.waits]\nM109 = { input = "hot", for_s = 2 }\nM10 = { input = "clamped", for_s = 5 }\n'
    'M11 = { input = "open", for_s = 5 }\n'
    '[[output]]\nnumber = 0\nname = "hotend"\nkind = "analog"\nmax = 300.0\n'
    '[[output]]\nnumber = 0\nname = "clamp"\n'
    '[[input]]\nnumber = 3\nname = "hot"\n[[input]]\nnumber = 4\nname = "clamped"\n'
    '[[input]]\nnumber = 5\nname = "open"\ninitial = true\n'
)


@pytest.mark.parametrize(
    ("lines", "waits", "said"),
    [
        (["M109 S210"], ["M66 P3 L3 Q2.000000000"], False),
        # the next layer is a little cooler, and cold is still not hot
        (["M109 S215", "M104 S210", "M66 P4 L0"], ["M66 P3 L3 Q2.000000000"], False),
        (["M109 S215", "M104 S0"], [], False),
        (["M10", "M109 S210", "M11"], ["M66 P3 L3 Q2.000000000", "M66 P5 L3 Q5.000000000"], True),
    ],
)
def test_a_start_waits_for_what_the_lines_before_had_waited_for(
    lines: list[str], waits: list[str], *, said: bool
) -> None:
    heated = machine(HEATER + RECOVERY)
    start = StartState.of(heated)
    lines = ["G0 Z10", *lines, "G1 X50 F6000"]
    approach = plan_approach(heated, state_before(lines, len(lines) + 1, heated, start), start, [0, 1, 2])
    assert [each for each in approach.lines_with_outputs if each.startswith("M66")] == waits
    # before the axes go down to the work
    assert not waits or approach.lines_with_outputs.index(waits[-1]) == len(approach.lines_with_outputs) - 2
    # left as they are: what is off does not get hot, and what nobody has changed is waited for all the same
    assert [each for each in approach.lines if each.startswith("M66")] == (waits[-1:] if said else [])
    assert ('wait for the input "open", 5 s at the most' in [each.text for each in approach.way]) is said
    hints = "".join(each.hint for each in approach.needs)
    assert ('to set them and wait for the input "hot", 2 s at the most' in hints) is bool(waits)


@pytest.mark.parametrize(
    ("stop", "line"),
    [("abort", "G33.1 Z-30 K1.5"), ("estop", "G84 Z-30 R20 F900"), ("kill", "G33 Z-30 K1.5")],
)
async def test_a_tool_that_may_stand_in_a_thread_is_not_moved_unasked(rig: Rig, stop: str, line: str) -> None:
    spindle = axes_text([3], rotary=True, velocity=24000.0, acceleration=24000.0)
    mill = machine(spindle + CNC + RECOVERY)
    lines = ["F900", "G0 Z20", "M3 S600", line, "G0 Z20", "G0 X100"]
    cell = await rig.started(mill)
    program = await cell.begin(*lines)
    await cell.until(lambda: cell.position(2) < 0.0)
    if stop == "kill":
        await cell.until(lambda: program.ack().done == 3)
        cell = await rig.started(mill)
    else:
        if stop == "estop":
            cell.service.latch.emergency_stop("ada", "a hand")
        else:
            cell.service.abort(program.program)
        await cell.ended(program)
        assert "stopped within the thread of line 4" in program.reason
        assert -30 * MM < cell.position(2) < 0.0
        cell.service.reset(None)
    for at in (4, 6):
        with pytest.raises(ServiceError) as refused:
            await cell.service.continue_program(
                "page", program.program, at, confirmed=Confirmation(outputs="leave")
            )
        assert (refused.value.code, "may stand in its thread" in refused.value.message) == ("MC592", True)
    confirmed = Confirmation(way=True, outputs="set")
    again = await cell.ended(
        await cell.service.continue_program("page", program.program, confirmed=confirmed)
    )
    assert (again.state, again.fault) == ("finished", None)


async def test_a_start_that_waits_in_vain_does_not_reach_the_work(rig: Rig) -> None:
    heated = machine(HEATER + RECOVERY)
    lines = ["G0 Z10", "M109 S210", "G1 X50 F6000", "G1 X150"]
    cell = await rig.started(heated)
    confirmed = Confirmation(outputs="set")
    program = await cell.service.open(
        "cam", ProgramOptions(start_line=4, before=lines[:3], confirmed=confirmed)
    )
    cell.service.lines.submit("cam", program.program, 4, lines[3:])
    await rig.until_ended(program)
    assert program.fault is not None
    assert (program.fault.code, program.done) == ("MC440", 3)
    assert rig.path[-1] == pytest.approx((50.0, 0.0, 50.0), abs=1e-3)


async def test_work_offsets_that_were_changed_since_are_named(rig: Rig) -> None:
    lines = ["G0 Z10", "G10 L20 P1 X20", "G1 X50 F6000", "G1 X150", "G1 X250"]
    mill = machine(SPINDLE + CNC + RECOVERY)
    name = await rig.killed_in(mill, lines, 4)
    cell = await rig.started(mill)
    (x, *_) = (await look(cell, name)).axes
    # zero of G54 is at -20: X50 is at 30
    assert x.there == pytest.approx(30.0)
    await cell.run("G10 L2 P1 X5", axes=[0])
    with pytest.raises(ServiceError) as refused:
        await cell.service.continue_program("page", name)
    assert refused.value.code == "MC594"
    assert "G54 of axis 0 is 5.000, it was -20.000" in refused.value.message


TOOL = "[[cutter]]\nnumber = 1\nlength_mm = {}\ndiameter_mm = 4.0\n"


async def test_a_tool_that_the_machine_file_has_otherwise_since_is_named(rig: Rig) -> None:
    lines = ["T1 M6", "G43 H1", "G1 X90 F6000"]
    name = await rig.killed_in(machine(CNC + SPINDLE + TOOL.format(40)), lines, 3)
    cell = await rig.started(machine(CNC + SPINDLE + TOOL.format(20)))
    with pytest.raises(ServiceError, match="T1 is another one in the tool table") as refused:
        await cell.service.continue_program("page", name, confirmed=Confirmation(way=True))
    assert refused.value.code == "MC594"


async def test_another_machine_file_has_to_be_confirmed(rig: Rig) -> None:
    name = await rig.killed_in(machine(RECOVERY), PART, 6)
    cell = await rig.started(machine(RECOVERY.replace("20.0", "30.0")))
    assert [(each.code, each.confirm) for each in (await look(cell, name)).needs] == [("MC594", "way")]
    with pytest.raises(ServiceError, match="the machine file was changed"):
        await cell.service.continue_program("page", name)
    program = await cell.service.continue_program("page", name, confirmed=Confirmation(way=True))
    await rig.until_ended(program)
    assert program.state == "finished"


async def test_a_spindle_that_others_have_turned_is_not_turned_back(rig: Rig) -> None:
    mill = machine(CNC + SPINDLE + RECOVERY)
    lines = ["G0 Z10", "G1 X300 F6000", "S600 M3", "G1 X50", "M5"]
    name = await rig.killed_in(mill, lines, 2)
    cell = await rig.started(mill)
    await cell.run("S3000 M3", "G4 P0.5", "M5", axes=[3])
    shown = await look(cell, name)
    (spindle,) = (each for each in shown.axes if each.axis == 3)
    assert (spindle.there, spindle.away) == (None, False)
    assert all("3" not in step.targets for step in shown.way)


def test_an_oriented_spindle_takes_the_shorter_way_to_its_angle() -> None:
    mill = machine(CNC + SPINDLE + RECOVERY)
    before = state_before(["M19 R90", "G0 X10"], 3, mill, StartState.of(mill))
    now = StartState.of(mill).at({3: math.radians(10 * 360.0 + 80.0), 0: 0.01})
    (step,) = plan_approach(mill, before, now, [0, 1, 2, 3]).way[1:2]
    assert step.targets["3"] == pytest.approx(10 * 360.0 + 90.0)


def test_a_spindle_that_turns_at_another_speed_is_shown_with_it() -> None:
    mill = machine(SPINDLE + CNC + RECOVERY)
    start = StartState.of(mill)
    before = state_before(["G0 Z10", "M3 S600", "G1 X50 F6000"], 4, mill, start)
    (spindle,) = plan_approach(mill, before, start, [0, 1, 2, 3], {3: 5.0 * math.tau}).switched
    assert (spindle.there, spindle.now, spindle.unit) == (pytest.approx(600.0), pytest.approx(300.0), "RPM")


async def test_axes_without_their_reference_are_refused_with_the_remedy(rig: Rig) -> None:
    keys = 'min_position = -50.0\nmax_position = 500.0\n[axis.homing]\nmethod = "manual"'
    text = '[machine]\nname = "homed"\n' + axes_text(keys=keys)
    cell = await rig.started(parse_machine(text))
    await cell.homing.reference("ada", {0: 0.0})
    program = await cell.service.open("cam")
    cell.service.lines.submit("cam", program.program, 1, ["G1010", "G01 X10 F6000", "G01 X200"])
    await rig.stopped_in(program, 3)
    cell = await rig.started(parse_machine(text))
    with pytest.raises(ServiceError) as refused:
        await cell.service.continue_program("page", program.program)
    assert (refused.value.code, refused.value.hint) == ("MC450", "home them first: mcctl home X")


async def test_a_start_from_a_line_takes_the_same_way(rig: Rig) -> None:
    cell = await rig.started(machine(RECOVERY))
    program = await cell.service.open("cam", ProgramOptions(start_line=7, before=PART[:6]))
    cell.service.lines.submit("cam", program.program, 7, PART[6:])
    cell.service.lines.close("cam", program.program)
    await rig.until_ended(program)
    assert program.state == "finished"
    assert max(z for _, _, z in rig.path) == pytest.approx(50.0, abs=1e-3)
    cell = await rig.started(machine())
    with pytest.raises(ServiceError, match="MC592: "):
        await cell.service.open("cam", ProgramOptions(start_line=7, before=PART[:6]))


async def test_a_hold_and_an_abort_count_on_the_way_too(rig: Rig) -> None:
    name = await rig.killed_in(machine(RECOVERY), PART, 7)
    cell = await rig.started(machine(RECOVERY))
    program = await cell.service.continue_program("page", name)
    assert program.notice == "on the way to line 7"
    await cell.until(lambda: cell.position(2) > 10 * MM)
    cell.service.abort(program.program)
    await cell.ended(program)
    assert (program.state, program.done) == ("aborted", 6)
    assert cell.position(2) < 50 * MM
    again = await cell.service.continue_program("page", name)
    await cell.until(lambda: again.progress.started == 7)
    assert again.notice == ""
    await rig.until_ended(again)
    assert (again.state, again.start_line) == ("finished", 7)


async def test_the_way_is_not_taken_while_another_program_has_an_axis(rig: Rig) -> None:
    name = await rig.killed_in(machine(RECOVERY), PART, 7)
    cell = await rig.started(machine(RECOVERY))
    await cell.service.open("other", ProgramOptions(axes=[1]))
    with pytest.raises(Refused, match=r"MC512: axis 1 is moved by .* of other"):
        await cell.service.continue_program("page", name)


@pytest.mark.parametrize("line", [None, 1, 2])
@pytest.mark.parametrize("restarted", [False, True])
@pytest.mark.parametrize("how", ["jog", "servo mode"])
async def test_what_was_moved_by_hand_is_not_gone_on_with(
    rig: Rig, how: str, line: int | None, *, restarted: bool
) -> None:
    cell = await rig.started(machine())
    if how == "jog":
        # so slowly that its way outlasts whatever the journal takes on a busy computer
        name = (await cell.jog(0, None, 0.001)).program
    else:
        name = (await open_servo(cell.service, "page", [0])).program
    service = cell.service
    await cell.until(lambda: service.time.now() > 0.2)
    if restarted:
        cell = await rig.started(machine())
    else:
        cell.service.abort(name, "it was let go")
        await cell.ended(cell.service.program(name))
    with pytest.raises(ServiceError) as refused:
        await cell.service.continue_program("page", name, line)
    assert refused.value.code == "MC517"
    assert "no lines to go on with" in refused.value.message
    assert all(each.over for each in cell.service.current())
