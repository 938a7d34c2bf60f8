"""Kernels: compiled with and without a place for the cache, and the same as plain Python."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import pytest

from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.warm_up import warm_up

PLAN = """
import numpy as np
from mcserver.motion.planner import MotionPlanner
from mcserver.motion.sampling import Rows
from tests.motion.support import alike, polyline
machine = alike(2, jerk=20_000.0)
planner = MotionPlanner(machine, np.zeros(2))
corners = [(0.0, 0.0), (0.02, 0.0), (0.03, 0.001), (0.03, 0.02)]
for number, group in enumerate(polyline(machine, corners, 0.1), start=1):
    planner.append(planner.segment(group, number), tolerance=1e-4)
rows = np.concatenate([each.position for each in planner.close() if isinstance(each, Rows)])
print(len(rows), *(f"{value:.12f}" for value in rows.sum(axis=0)))
"""


def test_a_place_for_the_cache_is_not_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = numba.njit

    def without_cache(*arguments: Any, cache: bool = False, **options: Any) -> Any:
        if not cache:
            return plain(*arguments, **options)

        def refuse(function: Any) -> Any:
            raise RuntimeError(f"cannot cache function {function.__name__!r}: no locator available")

        return refuse

    monkeypatch.setattr(numba, "njit", without_cache)
    halved = compiled(lambda x: x / 2.0)
    assert halved(3.0) == 1.5


def test_kernels_that_run_as_python_plan_the_same() -> None:
    answers = []
    for disabled in ("0", "1"):
        environment = dict(os.environ, NUMBA_DISABLE_JIT=disabled, PYTHONPATH=os.pathsep.join(sys.path))
        told = subprocess.run(
            [sys.executable, "-c", PLAN],
            env=environment,
            cwd=Path(__file__).parents[2],
            capture_output=True,
            text=True,
            timeout=100,
            check=True,
        )
        answers.append([float(number) for number in told.stdout.split()])
    assert answers[0] == pytest.approx(answers[1], abs=1e-9)


def test_warming_up_leaves_nothing_to_compile() -> None:
    warm_up()
    from mcserver.motion.kernels import keys

    before = len(keys.find_keys.signatures)  # type: ignore[attr-defined]
    warm_up()
    assert len(keys.find_keys.signatures) == before == 1  # type: ignore[attr-defined]
