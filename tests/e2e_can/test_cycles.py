"""The counting of cycles, on runs whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.can.cob import SYNC, Function
from mcserver.can.pdo_layout import RPDO1, RPDO2, TPDO1
from tests.e2e_can.bus_log import Logged
from tests.e2e_can.cycles import Rows, Slice, first_torques, jumps, slices
from tests.e2e_can.outcome import Outcome, Stop, greatest_jump, measure_stop, table
from tests.e2e_can.signs import (
    Behind,
    Evidence,
    InFrames,
    NoFrames,
    Witness,
    commanded,
    commanded_otherwise,
    has,
    lacks_answer,
    lacks_heartbeat,
    pulls,
    short_answer,
)

NODE, WITNESS = 2, 1
PER_MM = 1000.0
FIRST_CYCLE = 4000
CYCLES = 200
CYCLE_S = 0.01
# in cycle 100 the fault is visible, in 102 it is reported, in 103 the group brakes, from 110 on it stands
VISIBLE, REPORTED, BRAKED, RESTED = 100, 102, 103, 110
RUN = 8


def run(sign: list[Logged] | None, *, answers_until: int = CYCLES) -> tuple[list[Logged], Rows]:
    """A motion of 1 mm a cycle that ends early; the sign stands in the frames before cycle 100."""
    steps = np.ones(CYCLES)
    steps[BRAKED:RESTED] = np.linspace(0.9, 0.0, RESTED - BRAKED)
    steps[RESTED:] = 0.0
    setpoint = np.cumsum(steps)
    frames: list[Logged] = []
    for cycle in range(RUN, CYCLES):
        if cycle == VISIBLE:
            frames += sign or []
        if cycle < answers_until:
            frames.append(Logged(0, Function.TPDO1 + NODE, TPDO1.packing.pack(0x1237, 8, 0)))
        target = RPDO1.packing.pack(0x0F, 8, round(float(setpoint[cycle]) * PER_MM))
        frames += [Logged(0, Function.RPDO1 + WITNESS, target), Logged(1, SYNC, b""), Logged(0, SYNC, b"")]
    seq = FIRST_CYCLE + np.arange(CYCLES)
    columns = np.stack([setpoint, 2.0 * setpoint], axis=1)
    return frames, Rows(seq, 7.0 + CYCLE_S * np.arange(CYCLES), columns, columns)


@pytest.mark.parametrize("kind", ["missing", "short", "emergency"])
def test_cycles_count_from_the_first_frame_that_shows_the_fault(kind: str) -> None:
    shown = {
        "missing": (None, lacks_answer(NODE), VISIBLE),
        "short": ([Logged(0, Function.TPDO1 + NODE, b"\0" * 5)], short_answer(NODE), CYCLES),
        "emergency": (
            [Logged(0, Function.EMCY + NODE, b"\x11\x86" + bytes(6))],
            has(Function.EMCY + NODE),
            CYCLES,
        ),
    }
    sign, condition, until = shown[kind]
    frames, rows = run(sign, answers_until=until)
    evidence = Evidence(frames, 100, rows, Witness(0, WITNESS, 0, PER_MM))
    visible = InFrames(lambda: condition).row(evidence)
    found = measure_stop(rows, visible, 7.0 + REPORTED * CYCLE_S, others=(0, 1))
    assert visible == VISIBLE
    assert found == Stop(REPORTED - VISIBLE, BRAKED - VISIBLE, RESTED - 1 - VISIBLE)


def test_a_bus_is_away_in_the_cycle_behind_its_last_sync() -> None:
    frames, rows = run(None)
    gone = [frame for frame in frames if frame.bus == 0][: 3 * (VISIBLE - RUN)]
    evidence = Evidence(gone, 0, rows, Witness(0, WITNESS, 0, PER_MM))
    assert NoFrames().row(evidence) == VISIBLE


def test_an_encoder_is_behind_when_no_setpoint_of_the_last_cycles_is_near() -> None:
    frames, rows = run(None)
    actual = rows.setpoint - 1.5
    actual[VISIBLE:] -= 10.0
    jammed = Rows(rows.seq, rows.time_s, rows.setpoint, actual)
    assert Behind(0, 5.0).row(Evidence(frames, 0, jammed, Witness(0, WITNESS, 0, PER_MM))) == VISIBLE


def test_a_heartbeat_is_overdue_and_a_controlword_is_new_in_the_slice_that_shows_it() -> None:
    def word(value: int) -> Slice:
        return Slice((Logged(0, Function.RPDO1 + NODE, RPDO1.packing.pack(value, 8, 0)),))

    beat, none = Slice((Logged(0, Function.HEARTBEAT + NODE, b"\5"),)), Slice(())
    overdue = lacks_heartbeat(NODE, 2)
    assert [overdue(part) for part in (beat, none, none, none, beat, none)] == [False] * 3 + [
        True,
        False,
        False,
    ]
    changed = commanded_otherwise(NODE)
    assert [changed(part) for part in (word(6), none, word(6), word(7), word(7))] == [False] * 3 + [
        True,
        False,
    ]


def test_frames_of_other_buses_are_in_no_slice() -> None:
    frames, _ = run(None)
    parts = slices(frames, 0)
    assert len(parts) == CYCLES - RUN
    assert {len(part.frames) for part in parts} == {2}


def test_a_jump_is_target_less_encoder_when_the_drive_is_energized() -> None:
    frames = [
        Logged(0, Function.TPDO1 + NODE, TPDO1.packing.pack(0x0231, 8, 5000)),
        Logged(0, Function.RPDO1 + NODE, RPDO1.packing.pack(0x07, 8, 5000)),
        Logged(0, Function.TPDO1 + NODE, TPDO1.packing.pack(0x0233, 8, 5003)),
        Logged(0, Function.RPDO1 + NODE, RPDO1.packing.pack(0x0F, 8, 5001)),
        Logged(0, Function.RPDO1 + NODE, RPDO1.packing.pack(0x0F, 8, 9000)),
    ]
    assert jumps(frames, NODE) == [-2]


def test_set_points_and_torques_are_signs_and_the_first_torque_is_the_jump_of_a_torque_loop() -> None:
    def pull(word: int, torque: int) -> Logged:
        return Logged(0, Function.RPDO2 + NODE, RPDO2.packing.pack(word, 0, torque))

    offered = Slice((Logged(0, Function.RPDO1 + NODE, RPDO1.packing.pack(0x3F, 1, 0)),))
    assert (commanded(NODE, 0x10)(offered), commanded(NODE, 0x100)(offered)) == (True, False)
    assert (pulls(NODE, 800)(Slice((pull(0x0F, -801),))), pulls(NODE, 800)(offered)) == (True, False)
    frames = [pull(0x07, 0), pull(0x0F, 3), pull(0x0F, 500), pull(0x06, 0), pull(0x0F, -2)]
    assert first_torques(frames, NODE) == [3, -2]
    assert greatest_jump(frames, [NODE], by_torque=NODE) == 3


def test_the_table_says_what_is_not_there() -> None:
    text = table([Outcome("mute", "MC411", 1, 3, "", 2, 3, 9, "MC412", True, 0), Outcome("late")])
    assert text.splitlines()[2] == "| mute | MC411 | 1 | 3 | 2 | 3 | 9 | yes (MC412) | moves | 0 |"
    assert text.splitlines()[3] == "| late | nothing | – | – | – | – | – | – | NO | – |"
