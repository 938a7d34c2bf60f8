"""What a person reads of a simulation."""

from __future__ import annotations

import pytest

from mcserver.cli.simulation_report import print_report


def test_a_line_stretched_by_its_ramps_alone_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    line = {"start_s": 0.0, "end_s": 1.045, "requested_s": 1.0, "bound_by": None}
    report = {
        "ok": True,
        "duration_s": 2.5,
        "feed_length_mm": 100.0,
        "lines": [
            {**line, "line": 1, "stretched_by": 1.045},
            {**line, "line": 2, "stretched_by": 1.0},
            {**line, "line": 3, "stretched_by": 1.2, "bound_by": "axis 0 velocity"},
        ],
        "axes": {},
        "diagnostics": [],
    }
    print_report(report, ["G01 X100 F6000", "X200", "X300"], "part.gcode")
    first, second, third = capsys.readouterr().out.splitlines()[1:4]
    assert "ramps" in first
    assert "ramps" not in second
    assert "axis 0 velocity" in third
