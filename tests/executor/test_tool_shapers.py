"""Shapers that go by the tool in the spindle: changed at rest, without a jump, and kept over restarts."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from mcserver.executor.entries import EventKind
from mcserver.executor.shaping import Shaper as ShapedAxes
from mcserver.executor.shm.feedback import FeedbackRow
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.modal import ModalState
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.planning.start_state import StartState
from mcserver.simulation.simulation import simulate
from tests.executor.planned import Planned
from tests.executor.rig import CYCLE_S
from tests.machine_text import axes_text
from tests.service.virtual_cell import VirtualCell

LIGHT_HZ, HEAVY_HZ, HEAVY = 40.0, 23.0, 2
SHAPERS = f"""shaper = {{ type = "zv", frequency_hz = {LIGHT_HZ}, damping = 0.02 }}
tool_shapers.{HEAVY} = {{ type = "ei", frequency_hz = {HEAVY_HZ}, damping = 0.02 }}
"""
DEFAULT = SHAPERS.splitlines()[0]
MACHINE = """[machine]
name = "tools"
[motion]
path_tolerance_mm = 5.0
[dialect]
profile = "{profile}"
{change}
{axes}"""


def machine(keys: str = SHAPERS, *, change: str = "ignore", profile: str = "cnc") -> Machine:
    change = f'tool_change = "{change}"' if profile == "cnc" else ""
    limits = {"velocity": 300.0, "acceleration": 3000.0}
    axes = axes_text([0], **limits, keys=keys) + axes_text([1], **limits)
    return parse_machine(MACHINE.format(profile=profile, change=change, axes=axes))


def swing_after(setpoint: NDArray[np.float64], hertz: float) -> float:
    """How far a load on a spring swings once its motor rests [m]: the rings of all steps, summed."""
    steps = np.diff(setpoint)
    ages = np.arange(len(steps))[::-1] * CYCLE_S
    ringing = 2.0 * np.pi * hertz * complex(0.02, np.sqrt(1.0 - 0.02**2))
    return float(abs(np.sum(steps * np.exp(-ringing * ages))))


def first_move(text: str, described: Machine, start: StartState | None = None) -> NDArray[np.float64]:
    """Setpoints of X from the beginning until it has come to 20 mm for good."""
    found = simulate(text, described, record=True, start=start)
    assert found.report["ok"], found.report["diagnostics"]
    assert found.recording is not None
    points: NDArray[np.float64] = found.recording.setpoint[:, 0] * 1e-3
    (under_way,) = np.nonzero(points != 0.02)
    return points[: under_way[-1] + 2]


def swing(tool: int, described: Machine, hertz: float) -> float:
    """The most that a load swings behind moves of several speeds with a tool [m]."""
    moves = [first_move(f"T{tool} M6\nG1 X20 F{feed}\nG4 P0.1\nM2", described) for feed in (9000, 12000)]
    return max(swing_after(each, hertz) for each in moves)


def test_what_a_tool_rings_at_is_taken_away_by_its_own_shaper_alone() -> None:
    by_tool = machine()
    for tool, hertz, other in ((1, LIGHT_HZ, HEAVY), (HEAVY, HEAVY_HZ, 1)):
        plain = swing(tool, machine(""), hertz)
        assert swing(tool, by_tool, hertz) < 0.06 * plain
        # with the shaper of the other one it would ring on
        assert swing(other, by_tool, hertz) > 0.2 * plain > 5e-6


def test_each_move_of_a_program_has_the_shaper_of_the_tool_that_is_in_then() -> None:
    described = machine()
    shaping = described.shaping
    assert shaping is not None
    text = f"T1 M6\nG1 X20 F12000\nT{HEAVY} M6\nG1 X40\nM61 Q1\nG1 X20\nT{HEAVY} M6\nG1 X0 Y5\nM2"
    program = Planned(described, text)
    orders: list[NDArray[np.float64]] = []
    for _ in range(1000):
        program.step()
        orders.append(program.executor.executor.row.ordered.copy())
    assert program.ended
    assert not program.faults
    points, ordered = np.array(program.rows), np.array(orders)
    moving = np.abs(np.diff(ordered[:, 0], prepend=ordered[0, 0])) > 0.0
    starts = np.flatnonzero(np.diff(moving.astype(int)) == 1)
    assert len(starts) == 4
    ends = [*starts[1:], len(points) - 1]
    for start, end, tool in zip(starts, ends, (1, HEAVY, 1, HEAVY), strict=True):
        weights = np.array(shaping.tools.get(tool, shaping.weights)[0])
        shaped = np.convolve(ordered[start:end, 0] - ordered[start, 0], weights)[: end - start]
        assert np.abs(ordered[start, 0] + shaped - points[start:end, 0]).max() < 1e-12
        # an exact stop, to the shaped end
        assert points[end, 0] == ordered[end, 0]
    # the path as a whole comes as late with every tool
    assert np.abs(ordered[: -shaping.delay, 1] - points[shaping.delay :, 1]).max() < 1e-15


def test_an_axis_of_another_program_changes_where_it_rests_next() -> None:
    shaping = machine(SHAPERS).shaping
    assert shaping is not None
    both = msgspec.structs.replace(
        shaping,
        weights=(shaping.weights[0],) * 2,
        tools={HEAVY: (shaping.tools[HEAVY][0],) * 2},
    )
    row = FeedbackRow(2, 0, 0)
    shaper, slower = ShapedAxes(both, row, CYCLE_S), len(shaping.tools[HEAVY][0])

    def cycle(*ordered: float) -> NDArray[np.float64]:
        row.ordered[:] = ordered
        shaper.shape()
        return row.setpoint.copy()

    cycle(0.0, 1e-4)
    shaper.choose(HEAVY)
    first = np.array([cycle(0.0, 1e-4 * number) for number in range(2, 50)])
    # it goes on with the weights of before, and its exact stop waits for both
    old = both.weights[1]
    assert first[-1, 1] == pytest.approx(np.dot(old, 1e-4 * (49 - np.arange(len(old)))))
    for unsettled in (*[[False, True]] * (slower - 2), [False, False]):
        cycle(0.0, 49e-4)
        assert shaper.unsettled.tolist() == unsettled
    step = np.array([cycle(1e-4, 50e-4) for _ in range(slower)])
    for column, start in ((0, 0.0), (1, 49e-4)):
        expected = start + 1e-4 * np.cumsum(both.tools[HEAVY][column])[: len(step)]
        assert np.abs(step[: len(expected), column] - expected).max() < 1e-15


def test_a_change_that_is_aborted_leaves_the_tool_of_before() -> None:
    program = Planned(machine(change="pause"), f"T1 M6\nG1 X20 F12000\nT{HEAVY} M6\nG1 X40\nM2")
    shaper = program.executor.executor.bank.shaper
    assert shaper is not None
    program.step(400)
    assert program.of(EventKind.PAUSED)
    program.executor.mailbox.abort(0)
    program.step(100)
    assert program.ended
    assert shaper.tool == 1


@pytest.mark.parametrize("way", ["kept", "from a line"])
def test_a_start_has_the_shaper_of_the_tool_that_is_in(way: str) -> None:
    described = machine()
    start = StartState.of(described)
    if way == "kept":
        start = msgspec.structs.replace(start, tool=HEAVY)
    else:
        frame = Frame(tool=HEAVY, changed=HEAVY)
        start = msgspec.structs.replace(start, frame=frame, modal=ModalState(frame=frame))
    found = simulate("G1 X20 F12000\nM2", described, start=start)
    assert found.end is not None
    assert found.end.tool == HEAVY
    moved = first_move("G1 X20 F12000\nM2", described, start)
    again = first_move(f"T{HEAVY} M6\nG1 X20 F12000\nM2", described)
    # a change before it takes some cycles
    assert np.array_equal(moved[moved > 0.0], again[again > 0.0])


async def test_a_server_knows_the_tool_after_a_restart(tmp_path: Path) -> None:
    cell = VirtualCell(machine(), tmp_path)
    await cell.run("G1010", f"T{HEAVY} M6", "G1 X5 F6000")
    assert cell.service._table.start_state().tool == HEAVY
    await cell.stop()
    again = VirtualCell(machine(), tmp_path, "again")
    shaper = again.executor.executor.bank.shaper
    assert shaper is not None
    assert (shaper.tool, again.service._table.start_state().tool) == (HEAVY, HEAVY)
    # a jog says of no tool: it has the shaper of the one that is in
    await again.run("G1010")
    await again.ended(await again.jog(0, 3.0))
    assert shaper.tool == HEAVY
    await again.stop()


@pytest.mark.parametrize(
    ("keys", "profile", "place"),
    [
        ('tool_shapers.T2 = { type = "ei", frequency_hz = 23.0 }', "cnc", "axis[0].tool_shapers: "),
        ('tool_shapers.0 = { type = "ei", frequency_hz = 23.0 }', "cnc", "axis[0].tool_shapers: "),
        (
            'tool_shapers.2 = { type = "2hei", frequency_hz = 1.0 }',
            "cnc",
            "axis[0].tool_shapers.2: it is",
        ),
        (SHAPERS, "robot", "axis[0].tool_shapers: programs of the profile robot"),
    ],
)
def test_shapers_that_no_tool_can_have_are_refused(keys: str, profile: str, place: str) -> None:
    with pytest.raises(MachineFileRejected) as refused:
        machine(keys, profile=profile)
    assert place in str(refused.value)


def test_the_path_tolerance_bears_the_longest_shaper_of_all_tools() -> None:
    plain, by_tool = machine(DEFAULT).shaping, machine().shaping
    assert plain is not None
    assert by_tool is not None
    assert by_tool.deviations[0] > 2.0 * plain.deviations[0]
    assert by_tool.path_deviation == by_tool.deviations[0]
    assert by_tool.delay > plain.delay
