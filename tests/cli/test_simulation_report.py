"""What a person reads of a simulation."""

from __future__ import annotations

import pytest

from mcserver.cli.simulation_report import print_report
from mcserver.simulation.line_times import LineTimes


def test_a_line_stretched_by_its_ramps_alone_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    times = LineTimes()
    for line, lasts in ((1, 1.045), (2, 1.0), (3, 1.2)):
        times.asked(line, 1.0)
        times.started(line, 2.0 * line)
        times.ended(line, 2.0 * line + lasts)
    times.bound(3, "axis 0 velocity")
    report = {"ok": True, "duration_s": 2.5, "feed_length_mm": 100.0, "axes": {}, "diagnostics": []}
    print_report(report, times, ["G01 X100 F6000", "X200", "X300"], "part.gcode")
    first, second, third = capsys.readouterr().out.splitlines()[1:4]
    assert "ramps" in first
    assert "ramps" not in second
    assert "axis 0 velocity" in third
