"""Programs that compute, run and streamed on a virtual clock (D-80 to D-84)."""

from __future__ import annotations

import pytest

from mcserver.executor.entries import EventKind
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.planning.pipeline import FaultRule, Pipeline
from mcserver.planning.planner_messages import Report, ReportKind
from mcserver.planning.start_state import StartState
from mcserver.service.progress import LineProgress
from mcserver.simulation.assertions import read_assertion
from mcserver.simulation.simulation import simulate
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.machine_text import axes_text


def machine(extra: str = "", tolerance: float = 0.0) -> Machine:
    text = '[machine]\nname = "mill"\n[dialect]\nprofile = "cnc"\n'
    text += f"[motion]\npath_tolerance_mm = {tolerance}\n{extra}"
    return parse_machine(text + axes_text(range(3)))


PROBE = "[probe]\nsimulated_at = { Z = -3.25 }\n"
INPUT = '[[input]]\nnumber = 0\nname = "part"\n'


class Stream:
    """A program that is streamed, with what its progress says."""

    def __init__(self, made: Machine, on_fault: FaultRule = FaultRule.RETRY) -> None:
        self.executor = VirtualExecutor(made)
        self.executor.open_slot(0)
        self.pipeline = Pipeline(made, self.executor.sink(0), start=StartState.of(made), on_fault=on_fault)
        self.progress = LineProgress(1)
        self.reports: list[Report] = []
        self.sent = 0
        self.finished = False
        self.done: list[int] = []

    def send(self, *lines: str, last: bool = False) -> None:
        self.pipeline.lines.put(self.sent + 1, lines)
        self.sent += len(lines)
        self.pipeline.lines.closed = last

    def run(self, cycles: int = 3000) -> None:
        for _ in range(cycles):
            while self.pipeline.pump(self.executor.u(0)):
                continue
            self.reports += self.pipeline.take_reports()
            self.executor.step()
            for event in self.executor.events():
                self.pipeline.on_event(event)
                if event.kind is EventKind.LINE_START:
                    self.progress.line_started(event.line, event.time)
                elif event.kind is EventKind.LINE_END:
                    self.progress.line_ended(event.line, event.time)
                elif event.kind in (EventKind.PASSED, EventKind.FINISHED):
                    self.progress.passed(event.line)
                    self.finished |= event.kind is EventKind.FINISHED
                if self.done[-1:] != [self.progress.done]:
                    self.done.append(self.progress.done)

    @property
    def place(self) -> list[float]:
        return [round(each * 1e3, 6) for each in self.executor.executor.row.setpoint.tolist()]

    @property
    def rejected(self) -> list[tuple[int, str]]:
        return [
            (each.line, each.diagnostics[0].code) for each in self.reports if each.kind is ReportKind.REJECTED
        ]


def test_a_block_of_a_stream_runs_when_its_last_line_has_come() -> None:
    stream = Stream(machine())
    stream.send("F6000 G1 X1", "o1 repeat [3]", "G91 G1 Y1")
    stream.run(500)
    assert (stream.place, stream.progress.done) == ([1.0, 0.0, 0.0], 1)
    stream.send("o1 endrepeat")
    stream.run(500)
    assert (stream.place, stream.progress.done) == ([1.0, 3.0, 0.0], 4)
    stream.send("G90 X0", last=True)
    stream.run(500)
    assert stream.finished
    assert (stream.place[0], stream.progress.done) == (0.0, 5)
    assert [each.line for each in stream.progress.take_ended()] == [1, 2, 5]


def test_done_is_no_line_of_a_block_before_all_of_it_has_ended() -> None:
    stream = Stream(machine())
    stream.send(
        "F6000", "o1 sub", "G1 X#1", "G1 X0", "o1 endsub", "o2 repeat [3]", "o1 call [5]", "o2 endrepeat"
    )
    stream.send("G1 X7", last=True)
    stream.run(2000)
    assert stream.finished
    assert set(stream.done) <= {0, 1, 4, 5, 8, 9}
    assert stream.done == sorted(stream.done)


def test_a_faulty_line_of_a_block_can_be_sent_again_before_it_runs() -> None:
    stream = Stream(machine())
    stream.send("F6000", "o1 repeat [2]", "G91 G1 X[1+")
    stream.run(100)
    assert stream.rejected == [(3, "MC160")]
    assert stream.progress.done == 1
    stream.sent = 2
    stream.send("G91 G1 X[1+1]", "o1 endrepeat", last=True)
    stream.run(1000)
    assert stream.finished
    assert stream.place[0] == 4.0


def test_a_faulty_line_that_computes_sets_nothing_and_can_be_sent_again() -> None:
    stream = Stream(machine())
    stream.send("F6000 #1=2", "#1=9 G1 X[1/0]")
    stream.run(100)
    assert stream.rejected == [(2, "MC163")]
    stream.sent = 1
    stream.send("G1 X#1", last=True)
    stream.run(1000)
    assert (stream.finished, stream.place[0]) == (True, 2.0)


def test_a_fault_of_a_block_under_way_ends_the_program_at_its_line() -> None:
    stream = Stream(machine())
    stream.send("F6000", "o1 repeat [3]", "#1=[#1+1]", "G1 X[1/[2-#1]]", "o1 endrepeat", "G1 X50")
    stream.run(1000)
    assert stream.rejected == [(4, "MC163")]
    assert (stream.place[0], stream.progress.done) == (1.0, 1)


def test_a_text_that_ends_within_a_block_is_refused() -> None:
    stream = Stream(machine())
    stream.send("F6000 G1 X1", "o1 repeat [3]", "G1 X2", last=True)
    stream.run(500)
    assert stream.rejected == [(2, "MC161")]
    assert stream.place[0] == 1.0


def test_a_curve_of_a_stream_runs_at_its_end_and_a_faulty_point_can_be_sent_again() -> None:
    stream = Stream(machine())
    stream.send("F6000 G5.2 X1 Y4 P1", "X9 P1")
    stream.run(200)
    assert (stream.rejected, stream.progress.done, stream.place) == ([(2, "MC189")], 1, [0.0, 0.0, 0.0])
    stream.sent = 1
    stream.send("X9 Y4 P1", "X10 Y0 P1", "G5.3", "G68 X0 Y0 R90", "G1 X10 Y0", last=True)
    stream.run()
    assert (stream.finished, stream.progress.done, stream.place) == (True, 6, [0.0, 10.0, 0.0])


def test_a_text_that_ends_within_a_curve_is_refused() -> None:
    stream = Stream(machine())
    stream.send("F6000 G5.2 X1 Y4 P1", "X9 Y4 P1", last=True)
    stream.run(500)
    assert (stream.rejected, stream.place) == ([(1, "MC189")], [0.0, 0.0, 0.0])


def test_what_a_probe_has_met_is_a_parameter_of_the_next_line() -> None:
    text = "G10 L2 P1 Z-1\nF600 G38.2 Z-9\n#1=#5063 #2=#5070 #3=#5422\nG0 Z5\nG1 X[#1] Y#2\n"
    text += "o1 if [#5063 LT -2]\nG1 X20\no1 endif"
    found = simulate(text, machine(PROBE))
    assert found.exit_code == 0, found.report
    assert found.report["axes"]["0"]["min"] == pytest.approx(-2.25, abs=1e-3)
    assert found.report["axes"]["0"]["position"] == pytest.approx(20.0)
    assert found.report["axes"]["1"]["position"] == pytest.approx(1.0)
    assert [each["code"] for each in found.report["diagnostics"]] == ["MC166"]


def test_where_an_axis_stopped_behind_a_probe_is_read_when_it_stands() -> None:
    found = simulate("F600 G38.2 Z-9\nG1 X[-#5422]", machine(PROBE))
    ends = found.report["axes"]
    assert ends["0"]["position"] == pytest.approx(-ends["2"]["position"], abs=1e-6)
    assert ends["2"]["position"] < -3.25


@pytest.mark.parametrize(("at", "expected"), [("0.2", 3.0), ("9.0", 4.0)])
def test_an_input_decides_as_it_is_when_the_program_comes_to_it(at: str, expected: float) -> None:
    made = machine(INPUT + f"simulated = [{{ at_s = {at}, value = true }}]\n")
    text = "F600 G1 X5\nM66 P0 L0\no1 if [#5399 EQ 1]\nG1 X3\no1 else\nG1 X4\no1 endif"
    found = simulate(text, made)
    assert found.exit_code == 0, found.report
    assert found.report["axes"]["0"]["position"] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("first", "way", "last_end"), [("G1 X0", 0.0, 0.0), ("G1 X5", 5.0, 0.5), ("G1 X5\nG1 X2", 8.0, 0.8)]
)
def test_a_run_that_a_fault_ends_reports_what_was_run(first: str, way: float, last_end: float) -> None:
    text = f"F600 {first}\nM66 P0 L3 Q2\nG1 X30"
    bound = read_assertion("duration most=1")
    report = simulate(text, machine(INPUT), assertions=[bound]).report
    (judged,) = report["assertions"]
    assert report["diagnostics"][0]["severity"] == "error"
    assert report["duration_s"] == pytest.approx(last_end + 2.0, abs=0.1)
    assert report["feed_length_mm"] == pytest.approx(way)
    assert (judged["holds"], judged["value"]) == (False, report["duration_s"])


def test_lines_of_a_loop_flow_as_written_out() -> None:
    loop = "F6000\n#1=0\no1 while [#1 LT 90]\nG1 X[10*SIN[#1]] Y[10-10*COS[#1]]\n#1=[#1+1]\no1 endwhile"
    from tests.bench.rs274_programs import moves_here

    moves, _ = moves_here(loop)
    plain = "F6000\n" + "\n".join(f"G1 X{x:.9f} Y{y:.9f}" for x, y, _ in moves)
    one, other = (simulate(each, machine(tolerance=0.05)) for each in (loop, plain))
    assert one.report["duration_s"] == pytest.approx(other.report["duration_s"], rel=1e-3)
    assert one.report["feed_length_mm"] == pytest.approx(other.report["feed_length_mm"], abs=1e-5)


def test_a_long_computation_does_not_hold_up_other_work() -> None:
    stream = Stream(machine())
    stream.send("o1 while [#1 LT 20000]", "#1=[#1+1]", "o1 endwhile", "F6000 G1 X[#1/10000]", last=True)
    pieces = 0
    while stream.pipeline.pump(0.0):
        pieces += 1
    assert pieces > 50
    stream.run(500)
    assert (stream.finished, stream.place[0]) == (True, 2.0)


def test_a_block_that_begins_where_a_line_was_refused_is_not_done_before_it_runs() -> None:
    stream = Stream(machine())
    stream.send("F6000 G91 G1 X1", "G1 X[1/0]")
    stream.run(300)
    assert stream.rejected == [(2, "MC163")]
    stream.sent = 1
    stream.send("o1 repeat [2]", "G1 X1")
    stream.run(300)
    assert stream.progress.done == 1
    stream.send("o1 endrepeat", last=True)
    stream.run(1000)
    assert (stream.progress.done, stream.place[0]) == (4, 3.0)
