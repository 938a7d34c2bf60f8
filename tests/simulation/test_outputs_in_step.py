"""Outputs in step with motion (D-70): a law over programs, planning windows, holds and overrides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from mcserver.executor.entries import EventKind
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.planning.pipeline import Pipeline
from mcserver.planning.planner_messages import ReportKind
from mcserver.planning.start_state import StartState
from mcserver.simulation.simulation import simulate
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.machine_text import axes_text

ROUNDING_S = 1e-9


def machine(drive: str = "ideal", tolerance: float = 0.0, cycle_hz: float = 1000.0) -> Machine:
    text = f'[machine]\nname = "cell"\ncycle_hz = {cycle_hz}\n[motion]\npath_tolerance_mm = {tolerance}\n'
    text += axes_text(range(3), velocity=500.0, acceleration=5000.0, drive=drive)
    text += '[[output]]\nnumber = 0\nname = "count"\nkind = "analog"\nmax = 1000.0\n'
    return parse_machine(text + '[[output]]\nnumber = 0\nname = "lamp"\n')


@dataclass
class Run:
    """Rows of a run and the starts of its lines [s]."""

    machine: Machine
    times: list[float] = field(default_factory=list)
    counts: list[float] = field(default_factory=list)
    starts: dict[int, float] = field(default_factory=dict)

    def play(self, lines: Sequence[str], orders: dict[int, tuple[str, float]], portion: int) -> None:
        """Play lines that come in portions, with holds and overrides in given cycles."""
        executor = VirtualExecutor(self.machine)
        executor.open_slot(0)
        pipeline = Pipeline(self.machine, executor.sink(0), start=StartState.of(self.machine))
        sent, column = 0, [each.name for each in self.machine.outputs].index("count")
        for cycle in range(60_000):
            if cycle % 7 == 0 and sent < len(lines):
                part = lines[sent : sent + portion]
                pipeline.lines.put(sent + 1, part)
                sent += len(part)
                pipeline.lines.closed = sent == len(lines)
            order, value = orders.get(cycle, ("", 0.0))
            if order == "override":
                executor.mailbox.set_override(value, 0)
            elif order == "hold":
                executor.mailbox.set_hold(True, 0)
            elif order == "resume" or (cycle % 997 == 0 and cycle):
                executor.mailbox.resume(0)
                executor.mailbox.set_override(max(value, 0.3), 0)
            while pipeline.pump(executor.u(0)):
                continue
            for report in pipeline.take_reports():
                assert report.kind is not ReportKind.REJECTED, (lines, report.diagnostics)
            executor.step()
            row = executor.executor.row
            self.times.append(executor.executor.time)
            self.counts.append(float(row.outputs[column]))
            for event in executor.events():
                pipeline.on_event(event)
                assert event.kind is not EventKind.FAULT, event
                if event.kind is EventKind.LINE_START:
                    self.starts.setdefault(event.line, event.time)
                if event.kind is EventKind.FINISHED:
                    executor.step()
                    self.counts.append(float(row.outputs[column]))
                    return
        raise AssertionError("the program does not end")

    def assert_in_step(self, expected: dict[int, float]) -> None:
        """Each line's value comes in the cycle in which its motion begins: with no setpoint before its start,
        and with every one behind it."""
        times, counts = np.array(self.times), np.array(self.counts[: len(self.times)])
        for line, value in expected.items():
            start = self.starts[line]
            early = times < start - ROUNDING_S
            assert (counts[early] < value).all(), f"line {line}: before its motion"
            under_way = times > start + ROUNDING_S
            assert (counts[under_way] >= value).all(), f"line {line}: its motion came without it"


COORDINATE = st.integers(-20, 20).map(lambda steps: steps * 0.5)
MOVE = st.one_of(
    st.tuples(COORDINATE, COORDINATE).map(lambda p: f"G01 X{p[0]} Y{p[1]}"),
    st.tuples(COORDINATE, COORDINATE).map(lambda p: f"G01 X{p[0]} Z{p[1]} F2000"),
    st.tuples(COORDINATE, COORDINATE).map(lambda p: f"G01 X{p[0]} G01 Y{p[1]}"),
    st.tuples(COORDINATE, COORDINATE).map(lambda p: f"G01 X{p[0]}, G01 Y{p[1]} F9000"),
    st.tuples(COORDINATE, COORDINATE).map(lambda p: f"G00 X{p[0]} Z{p[1]}"),
    st.just("G02 I1 J0"),
    COORDINATE.map(lambda x: f"G09 G01 X{x}"),
    st.just("G04 P0.0123"),
)
PROGRAM = st.lists(st.tuples(MOVE, st.booleans()), min_size=2, max_size=14)


def written(steps: Sequence[tuple[str, bool]]) -> tuple[list[str], dict[int, float]]:
    """Return the lines, and the value that comes with each line of motion."""
    lines, expected, count, due = ["G1010", "G94 F6000"], {}, 0, False
    for text, counted in steps:
        if counted:
            count += 1
            lines.append(f"M67 E0 Q{count}")
            due = True
        lines.append(text)
        if due and not text.startswith("G04"):
            expected[len(lines)] = float(count)
            due = False
    return lines, expected


@pytest.mark.parametrize(("drive", "tolerance"), [("ideal", 0.0), ("simulated", 0.0), ("ideal", 0.2)])
@settings(max_examples=8, phases=(Phase.explicit, Phase.reuse, Phase.generate))
@given(
    steps=PROGRAM,
    portion=st.integers(1, 20),
    orders=st.dictionaries(
        st.integers(1, 600),
        st.one_of(
            st.tuples(st.just("override"), st.sampled_from((0.37, 0.5, 1.0, 1.6))),
            st.just(("hold", 0.0)),
            st.just(("resume", 1.0)),
        ),
        max_size=4,
    ),
)
def test_an_output_of_m67_changes_in_the_cycle_in_which_the_next_motion_begins(
    drive: str,
    tolerance: float,
    steps: list[tuple[str, bool]],
    portion: int,
    orders: dict[int, tuple[str, float]],
) -> None:
    lines, expected = written(steps)
    run = Run(machine(drive, tolerance))
    run.play(lines, orders, portion)
    run.assert_in_step(expected)
    last = max((float(line.split("Q")[1]) for line in lines if line.startswith("M67")), default=0.0)
    assert run.counts[-1] == last, "what no motion follows comes with the program's end"


def test_m62_costs_no_time_and_does_not_stop_the_path() -> None:
    plain = [f"G01 X{x}" for x in range(1, 40)]
    marked = [line for x, text in enumerate(plain) for line in (f"M{62 + x % 2} P0", text)]
    durations = [
        simulate("\n".join(["G1010", "F6000", *lines]), machine()).report["duration_s"]
        for lines in (plain, marked)
    ]
    assert durations[0] == pytest.approx(durations[1], abs=2e-3)


def test_m64_acts_where_the_motion_before_it_has_ended() -> None:
    text = "G1010\nF6000\nG01 X10\nM64 P0\nG01 X20"
    simulation = simulate(text, machine(), record=True)
    recording = simulation.recording
    assert recording is not None
    lamp = recording.outputs["lamp"]
    first = int(np.argmax(lamp))
    assert recording.setpoint[first, 0] == pytest.approx(10.0)
    assert recording.setpoint[first - 1, 0] < 10.0
    assert recording.setpoint[first + 1, 0] < 10.5
    end = simulation.report["lines"][0]["end_s"]
    assert recording.time_s[first] - 1e-3 < end <= recording.time_s[first] + 1e-9


def test_of_m62_and_m64_on_one_output_the_later_one_counts() -> None:
    text = "G1010\nF6000\nM62 P0\nM65 P0\nG01 X10\nM63 P0\nM62 P0\nG01 X20\nM63 P0\nM02"
    recording = simulate(text, machine(), record=True).recording
    assert recording is not None
    lamp = recording.outputs["lamp"]
    on = np.nonzero(lamp)[0]
    assert (recording.setpoint[on, 0] >= 10.0 - 1e-9).all()
    assert lamp[-1] == 0.0, "the last M63 comes with the program's end"


def test_a_waiting_program_goes_on_in_the_cycle_of_the_input() -> None:
    text = machine_text_with_button()
    program = "G1010\nF6000\nG01 X10\nM66 P0 L3 Q100\nG01 X20"
    simulation = simulate(program, parse_machine(text), record=True)
    recording = simulation.recording
    assert recording is not None
    assert simulation.report["ok"]
    waited = next(each for each in simulation.report["lines"] if each["line"] == 4)
    assert waited["end_s"] == pytest.approx(3.0)
    moving = recording.setpoint[:, 0] > 10.0 + 1e-6
    assert recording.time_s[int(np.argmax(moving))] == pytest.approx(3.001)
    assert recording.inputs["button"].sum() == pytest.approx(len(recording.time_s) - 3_000, abs=1)


def machine_text_with_button() -> str:
    return (
        f'[machine]\nname = "cell"\n{axes_text(velocity=500.0, acceleration=5000.0)}'
        '[[input]]\nnumber = 0\nname = "button"\nsimulated = [{ at_s = 3.0, value = true }]\n'
    )
