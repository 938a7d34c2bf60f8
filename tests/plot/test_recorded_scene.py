"""Recordings as scenes."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.errors import UsageFault
from mcserver.plot.html import page_of
from mcserver.plot.recorded_scene import recorded_scene
from mcserver.recorder.channels import LineMark
from mcserver.recorder.reading import RecordedRun
from mcserver.simulation.recorder import Recorded
from tests.plot.synthetic import machine, run, smooth

MACHINE = machine("linear", "linear")
LINES = np.where(np.arange(400) < 200, 2.0, 5.0)


def recording(cycles: Recorded, lines: list[LineMark]) -> RecordedRun:
    return RecordedRun("cell.mcap", cycles, 0.0, None, [], lines, {2: "G01 X50 ; go", 5: "G01 X0"})


def test_lines_that_were_reported_are_the_timed_lines_with_their_text() -> None:
    marks = [LineMark("p", 2, 0.0, 0.2, 0.15, 1.3, "axis 0 jerk"), LineMark("p", 3, 0.2, 0.2)]
    drawn = recorded_scene(
        recording(run([smooth(400, 50.0), smooth(400, 20.0)], LINES), marks), MACHINE, None
    )
    (line,) = drawn.timed_lines
    assert (line.line, line.source, line.requested_s, line.bound_by) == (2, "G01 X50", 0.15, "axis 0 jerk")
    assert drawn.feed_length_mm == pytest.approx(np.hypot(50.0, 20.0), rel=1e-3)


def test_without_reports_lines_are_the_stretches_of_rows() -> None:
    drawn = recorded_scene(recording(run([smooth(400, 50.0)] * 2, LINES), []), MACHINE, None)
    assert [(line.line, round(line.start_s, 3)) for line in drawn.timed_lines] == [(2, 0.0), (5, 0.2)]
    assert "cell.mcap" in page_of(drawn)


def test_an_axis_that_the_machine_lacks_is_refused() -> None:
    with pytest.raises(UsageFault, match="axis 1"):
        recorded_scene(recording(run([smooth(400, 50.0)] * 2, LINES), []), machine("linear"), None)
