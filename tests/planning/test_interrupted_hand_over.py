"""A planner that is kept waiting while it hands a motion over: u does not run on without its rows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.executor.entries import Control, ControlKind, EventKind
from mcserver.executor.shm.rings import ProgramRing
from mcserver.motion.canonical import AxisOperation
from mcserver.motion.pieces import LineEdges, Rows
from mcserver.planning.motion_output import Output
from tests.executor.rig import CYCLE_S, Rig, machine, s_curve

ACCELERATION = 10.0
LENGTH, SPEED = 0.02, 0.2
CAPTURE = list(AxisOperation).index(AxisOperation.CAPTURE)


class InterruptedSink:
    """The ring's face to the planner, at each call of which the executor may run for a while."""

    def __init__(self, ring: ProgramRing, pause: Callable[[], None]) -> None:
        self.row_room, self.control_room = ring.row_room, ring.control_room
        self._ring = ring
        self._pause = pause

    def put_control(self, control: Control, rows: int = 0) -> None:
        self._pause()
        self._ring.put_control(control, rows)

    def put_zones_ahead(self, zones: int) -> None:
        """Nothing is told apart."""

    def put_edges(self, edges: LineEdges, rows: int = 0) -> None:
        self._pause()
        self._ring.put_edges(edges, rows)

    def put_rows(self, rows: Rows) -> None:
        self._pause()
        self._ring.put_rows(rows)


@settings(max_examples=25)
@given(pauses=st.lists(st.integers(0, 150), min_size=1, max_size=30), moves=st.integers(1, 3))
def test_a_motion_is_played_whole_wherever_its_hand_over_is_interrupted(
    pauses: list[int], moves: int
) -> None:
    rig = Rig(machine())
    waiting = iter(pauses)

    def pause() -> None:
        cycles = next(waiting, 0)
        if cycles:
            rig.step(cycles)

    output = Output(InterruptedSink(rig.program.ring, pause))
    output.put(Control(ControlKind.AXIS, 0.0, 1, axes=3, operation=CAPTURE))
    travelled, speeds = s_curve(LENGTH, SPEED, ACCELERATION)
    count = len(travelled)
    for move in range(moves):
        begun = float(move * count)
        line = move + 1
        position = np.outer(move * LENGTH + travelled, [1.0, 0.5])
        output.put(Control(ControlKind.LINE_START, begun, line))
        output.put(Control(ControlKind.BEGIN, begun, line, axes=3))
        output.put(Control(ControlKind.LINE_END, begun + count, line))
        final = (float(position[-1, 0]), float(position[-1, 1]))
        output.put(Control(ControlKind.END, begun + count, line, axes=3, values=final))
        output.put(
            Rows(
                int(begun) + 1,
                position,
                np.outer(speeds, [1.0, 0.5]),
                np.full(count, 3, np.uint64),
                np.full(count, line, np.int64),
            )
        )
    output.put(Control(ControlKind.FINISH, float(moves * count), moves))
    output.flush()
    rig.run()
    assert not rig.of(EventKind.FAULT), rig.events
    assert [event.line for event in rig.of(EventKind.LINE_END)] == list(range(1, moves + 1))
    assert np.abs(rig.acceleration()).max() <= 1.01 * ACCELERATION
    ended = rig.of(EventKind.LINE_END)
    for move, event in enumerate(ended, start=1):
        # a line has ended where its axes are at its end, never before
        assert rig.setpoint[round(event.time / CYCLE_S), 0] >= move * LENGTH - 1e-12
    assert rig.setpoint[-1, 0] == moves * LENGTH
