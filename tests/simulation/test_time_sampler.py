"""Samples of a simulated path: even in time, bounded, from the first cycle to the last."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.machine.machine_file import load_machine
from mcserver.planning.start_state import StartState
from mcserver.simulation.preview import preview
from mcserver.simulation.time_sampler import MAX_VALUES, TimeSampler, moments_for


@given(st.integers(4, 40), st.lists(st.integers(1, 200), min_size=1, max_size=30))
def test_samples_are_bounded_even_and_end_with_the_newest_cycle(moments: int, bursts: list[int]) -> None:
    sampler, done = TimeSampler(moments, 2), 0
    for burst in bursts:
        times = np.arange(done, done + burst, dtype=float)
        sampler.take(times, np.zeros(burst, np.int64), np.stack([times, 2.0 * times], axis=1))
        done += burst
    rows = sampler.rows
    assert min(done, moments // 2) <= len(rows) <= moments + 1
    assert (rows[0, 0], rows[-1, 0]) == (0.0, done - 1.0)
    assert np.array_equal(rows[:, 2], 2.0 * rows[:, 0])
    steps = np.diff(rows[:, 0])
    assert (steps[:-1] == steps[:1]).all()


def test_a_path_of_many_axes_has_fewer_moments() -> None:
    assert moments_for(3) > moments_for(64)
    assert 130 * moments_for(130) < 2 * MAX_VALUES


def test_a_preview_has_the_axes_that_are_wanted_and_the_reports_extents() -> None:
    machine = load_machine("cartesian")
    found = preview(
        "G1010\nG94 F6000\nG01 X20 Y-5\nG01 Z3\nM30\n", machine, StartState.of(machine), (0, 1, 2), "operator"
    )
    report, path = found.report, found.path
    assert report["ok"]
    assert len(path["time_s"]) > 100
    assert path["time_s"][-1] == pytest.approx(report["duration_s"], abs=0.1)
    for axis, positions in enumerate(path["positions"]):
        extent = report["axes"][str(axis)]
        assert positions[-1] == pytest.approx(extent["position"], abs=1e-6)
        assert max(positions) <= extent["max"] + 1e-9
        assert min(positions) >= extent["min"] - 1e-9
    assert path["tools"] == []


def test_a_preview_of_a_leg_has_the_path_of_its_foot() -> None:
    machine = load_machine("robot-dog")
    found = preview(
        "G1010\nG94 F3000\nT3 G91 G01 Z10\n", machine, StartState.of(machine), (0, 1, 2), "operator"
    )
    report, path = found.report, found.path
    assert report["ok"], report["diagnostics"]
    (foot,) = path["tools"]
    assert foot["tool"] == 3
    assert foot["position"][2][-1] - foot["position"][2][0] == pytest.approx(10.0, abs=0.01)


def test_a_program_with_faults_has_no_path() -> None:
    machine = load_machine("cartesian")
    found = preview("G01 X99999 F5", machine, StartState.of(machine), (0,), "operator")
    report, path = found.report, found.path
    assert not report["ok"]
    assert path == {"time_s": [], "positions": [[]], "tools": []}
