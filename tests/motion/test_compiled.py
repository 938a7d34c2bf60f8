"""Kernels: all of them are warm after warming up, in bounds, and the same as plain Python."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

PLAN = """
import numpy as np
from mcserver.motion.pieces import Rows
from mcserver.motion.planner import MotionPlanner
from tests.motion.support import alike, polyline
machine = alike(2, jerk=20_000.0)
planner = MotionPlanner(machine, np.zeros(2))
corners = [(0.0, 0.0), (0.02, 0.0), (0.03, 0.001), (0.03, 0.02)]
for number, group in enumerate(polyline(machine, corners, 0.1), start=1):
    planner.append(planner.segment(group, number), tolerance=1e-4)
rows = np.concatenate([each.position for each in planner.close() if isinstance(each, Rows)])
print(len(rows), *(f"{value:.12f}" for value in rows.sum(axis=0)))
"""

# What each kernel has been called with from Python before and after programs that ask for all there is.
EVERYTHING = """
import importlib, json, math, pkgutil
from mcserver.motion import kernels
from mcserver.motion.warm_up import warm_up
from mcserver.simulation.simulation import simulate
from tests.motion.support import alike

def called():
    found = {}
    for module in pkgutil.iter_modules(kernels.__path__):
        for name, value in vars(importlib.import_module(f"{kernels.__name__}.{module.name}")).items():
            if hasattr(value, "signatures"):
                found[name] = [str(each) for each in value.signatures]
    return found

corners = "G01 X10 F6000\\nY10\\nG02 X20 Y20 R10\\nG01 X30 Y20.5\\nG03 Y40 I0 J9.75\\nG01 X0 Y0 Z3\\n"
short = "".join(f"G01 X{0.01 * i:.2f} Y{math.sin(0.01 * i):.4f} F6000\\n" for i in range(300))
modes = ("G61", "G64", "G64 P0.1", "G64 P0.01")
text = "G1010\\nG90 G94\\n" + "".join(f"{mode}\\n{corners}{short}" for mode in modes)
text += "G93 G64\\nG01 X10 F2\\nY10\\nG02 X20 Y20 R10 F1\\nG94\\n"
text += "G00 X1\\nG04 P0.1\\nG01 X3 F600, Y7\\nG1020 X0\\n"
warm_up()
before = called()
faults = []
for jerk in (None, 50_000.0):
    faults += simulate(text, alike(3, jerk=jerk)).report["diagnostics"]
after = called()
late = {name: after[name] for name in after if after[name] != before.get(name)}
print(json.dumps({"faults": faults, "kernels": len(after), "late": late}))
"""


def test_kernels_that_run_as_python_plan_the_same() -> None:
    answers = []
    for disabled in ("0", "1"):
        environment = dict(os.environ, NUMBA_DISABLE_JIT=disabled, PYTHONPATH=os.pathsep.join(sys.path))
        done = subprocess.run(
            [sys.executable, "-c", PLAN],
            env=environment,
            cwd=Path(__file__).parents[2],
            capture_output=True,
            text=True,
            timeout=300,
            check=True,
        )
        answers.append([float(number) for number in done.stdout.split()])
    assert answers[0] == pytest.approx(answers[1], abs=1e-9)


def everything(**environment: str) -> dict[str, Any]:
    """What the programs report, run in a process of its own, where nothing else has called a kernel yet."""
    done = subprocess.run(
        [sys.executable, "-c", EVERYTHING],
        env={**os.environ, "NUMBA_DISABLE_JIT": "0", "PYTHONPATH": os.pathsep.join(sys.path), **environment},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=850,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    report: dict[str, Any] = json.loads(done.stdout)
    assert report["kernels"] > 20
    return report


@pytest.mark.timeout(900)
def test_warming_up_leaves_nothing_to_compile() -> None:
    report = everything()
    assert report["faults"] == []
    assert report["late"] == {}


@pytest.mark.timeout(900)
def test_no_kernel_goes_beyond_an_array() -> None:
    """Compiled with a check at every access, which the cache keeps apart from what is compiled without."""
    assert everything(NUMBA_BOUNDSCHECK="1")["faults"] == []
