"""Comma groups of one T flow into their neighbours; others start and end at rest (D-32)."""

from __future__ import annotations

import numpy as np

from mcserver.simulation.simulation import Simulation, simulate
from tests.motion.support import AxisSpec, machine_of

MACHINE = machine_of(
    [AxisSpec(500.0, 2000.0, 50_000.0)] * 2 + [AxisSpec(360.0, 5000.0, 100_000.0, rotary=True)]
)


def run(lines: list[str]) -> Simulation:
    return simulate("\n".join(["G1010", *lines]), MACHINE, record=True)


def speeds_at_ends(found: Simulation) -> list[float]:
    """Speed of the first axis where each line but the last one ends [mm/s]."""
    assert found.recording is not None
    x = found.recording.setpoint[:, 0]
    ends = [round(line["end_s"] * 1000.0) for line in found.report["lines"][:-1]]
    return [float(x[end + 1] - x[end]) * 1000.0 for end in ends if end > 0]


def test_comma_groups_of_one_time_go_on_without_a_stop_and_keep_it() -> None:
    found = run(["G93 F60", *(f"G01 X{50 * n}, G01 [2]{90 * n}" for n in range(1, 5))])
    assert [line["stretched_by"] for line in found.report["lines"]] == [1.0] * 4
    assert min(speeds_at_ends(found)) > 30.0


def test_comma_groups_whose_speeds_give_one_time_flow_under_g94() -> None:
    found = run(["G94", *(f"G01 F3000 X{50 * n}, G01 F5400 [2]{90 * n}" for n in range(1, 5))])
    assert np.allclose(speeds_at_ends(found), 50.0, rtol=1e-3)


def test_comma_groups_of_different_times_start_and_end_at_rest() -> None:
    found = run(["G93", *(f"G01 F60 X{50 * n}, G01 F120 [2]{90 * n}" for n in range(1, 4))])
    assert max(speeds_at_ends(found)) < 1.0
    assert [round(line["end_s"] - line["start_s"], 6) for line in found.report["lines"]] == [1.0] * 3
