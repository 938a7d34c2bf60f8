"""Knots that only save time give way where they leave no velocity profile."""

from __future__ import annotations

import pytest

from mcserver.motion.bound import PlanningError
from mcserver.motion.kernels.knots import NOT_JOINED
from mcserver.motion.profile import profile_solver
from tests.motion.measure import acceleration_ratio
from tests.motion.support import Move, alike, plan, polyline

SAMPLES = [(0.0, 0.0), (0.0044, 0.0), (0.00615, 0.00025), (0.0086, 0.0014)]


def test_a_line_is_planned_without_them_where_there_is_no_way_with_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine = alike(2, velocity=200.0, acceleration=10_000.0)
    moves = [Move(group, tolerance=1e-5) for group in polyline(machine, SAMPLES, 0.2)]
    with_keys = plan(machine, moves)
    search = profile_solver.find_knots

    def only_plain(*arguments: object) -> tuple[object, ...]:
        found: tuple[object, ...] = search(*arguments)
        return found if arguments[-1] else (NOT_JOINED, *found[1:])

    monkeypatch.setattr(profile_solver, "find_knots", only_plain)
    without = plan(machine, moves)
    assert without.position[-1] == pytest.approx(with_keys.position[-1], abs=1e-12)
    assert without.duration >= with_keys.duration
    assert acceleration_ratio(without) <= 1.01


def test_a_line_that_cannot_be_planned_either_way_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = alike(2)
    search = profile_solver.find_knots
    monkeypatch.setattr(
        profile_solver, "find_knots", lambda *arguments: (NOT_JOINED, *search(*arguments)[1:])
    )
    with pytest.raises(PlanningError):
        plan(machine, [Move(group) for group in polyline(machine, SAMPLES, 0.2)])
