"""Kernels: all of them are warm after warming up; as plain Python they stay in bounds and plan the same."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

# What programs that ask for all there is plan, and what each kernel was called with before and after them.
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
faults, rows = [], []
for jerk in (None, 50_000.0):
    found = simulate(text, alike(3, jerk=jerk), record=True)
    faults += found.report["diagnostics"]
    rows += found.recording.setpoint[::10].ravel().tolist()
after = called()
late = {name: after[name] for name in after if after[name] != before.get(name)}
print(json.dumps({"faults": faults, "kernels": len(after), "late": late, "rows": rows}))
"""


def everything(disable_jit: str) -> dict[str, Any]:
    """What the programs report, run in a process of its own, where nothing else has called a kernel yet."""
    done = subprocess.run(
        [sys.executable, "-c", EVERYTHING],
        env={**os.environ, "NUMBA_DISABLE_JIT": disable_jit, "PYTHONPATH": os.pathsep.join(sys.path)},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=850,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    report: dict[str, Any] = json.loads(done.stdout)
    assert report["faults"] == []
    return report


@pytest.mark.timeout(900)
def test_warming_up_leaves_nothing_to_compile_and_no_kernel_goes_beyond_an_array() -> None:
    compiled = everything("0")
    assert compiled["kernels"] > 20
    assert compiled["late"] == {}
    # plain Python checks every access: a check compiled in would take minutes of compiling where none is kept
    plain = everything("1")
    assert plain["kernels"] == 0
    assert compiled["rows"] == pytest.approx(plain["rows"], abs=1e-9)
