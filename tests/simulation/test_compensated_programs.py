"""Programs under cutter compensation, run and streamed on a virtual clock (D-85)."""

from __future__ import annotations

import pytest

from mcserver.planning.pipeline import FaultRule
from mcserver.simulation.simulation import simulate
from tests.simulation.test_computed_programs import Stream, machine

SQUARE = ["F6000 G41.1 D2", "G1 X10", "G1 Y-10", "S100", "G1 X0", "G40", "G1 X0 Y0"]


def test_a_streamed_move_waits_for_the_next_one_and_is_not_done_before() -> None:
    stream = Stream(machine())
    stream.send("F6000 G41.1 D2", "G1 X10", "M64 P3")
    stream.run(500)
    assert stream.rejected == [(3, "MC141")]
    stream.sent = 2
    stream.send("S100")
    stream.run(500)
    assert (stream.place, stream.progress.done) == ([0.0, 0.0, 0.0], 1)
    stream.send("G1 Y-10")
    stream.run(1000)
    # with the arc about the corner the line has begun
    assert (stream.place, stream.progress.done) == ([11.0, 0.0, 0.0], 3)
    stream.send("G40")
    stream.run(1000)
    assert (stream.place, stream.progress.done) == ([11.0, -10.0, 0.0], 5)
    stream.send("G1 X0 Y0", last=True)
    stream.run(1000)
    assert stream.finished
    assert (stream.place, stream.progress.done) == ([0.0, 0.0, 0.0], 6)
    assert stream.done == sorted(stream.done)


def test_a_gouge_in_a_stream_can_be_corrected() -> None:
    stream = Stream(machine())
    stream.send("F6000 G41.1 D10", "G1 X20", "G3 X24 Y4 J4")
    stream.run(500)
    assert stream.rejected == [(3, "MC169")]
    stream.sent = 2
    stream.send("G3 X28 Y8 J8", "G40", "G1 X0", last=True)
    stream.run(2000)
    assert (stream.finished, stream.place, stream.progress.done) == (True, [0.0, 8.0, 0.0], 5)


def test_a_gouge_ends_a_file_before_the_move_that_is_held() -> None:
    stream = Stream(machine(), FaultRule.END)
    stream.send("F6000 G41.1 D10", "G1 X20", "X30", "G3 X34 Y4 J4", "G40", "G1 X0", last=True)
    stream.run(2000)
    assert stream.rejected == [(4, "MC169")]
    assert (stream.place, stream.progress.done) == ([20.0, 5.0, 0.0], 2)


def test_the_last_move_of_a_text_without_an_end_is_made() -> None:
    stream = Stream(machine())
    stream.send("F6000 G41.1 D2", "G1 X10", "G1 X20", last=True)
    stream.run(1000)
    assert (stream.finished, stream.place, stream.progress.done) == (True, [20.0, 1.0, 0.0], 3)


@pytest.mark.parametrize("tolerance", [0.0, 0.1])
def test_a_compensated_file_runs_to_its_end(tolerance: float) -> None:
    result = simulate("\n".join(SQUARE), machine(tolerance=tolerance))
    assert result.exit_code == 0, result.report
    first, second = (result.report["axes"][axis] for axis in "01")
    assert [first["position"], second["position"]] == pytest.approx([0.0, 0.0])
    assert [first["max"], second["min"]] == pytest.approx([11.0, -11.0], abs=0.1)
    assert [each["line"] for each in result.report["lines"]] == [2, 3, 5, 7]
