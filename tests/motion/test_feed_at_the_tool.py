"""F at an arm's tip in rounded corners: the tip moves as the joints of the corner let it (D-30, D-36)."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.simulation import simulate
from tests.golden.urdf_tips import tips
from tests.motion.measure import VELOCITY_SLACK

# Chords of 0.5 mm with turns of up to 13 degrees: what the joints add at the tip nearly cancels.
CHORDS = [
    "G01 X460.7043 Y-5.7182 Z682.2861 A20.933 B-21.787 C17.121 F12000",
    "G01 X460.4374 Y-6.0658 Z682.5262 A18.728 B-25 C11.115 F120",
    "G01 X460.151 Y-6.4317 Z682.71 A5.319 B-21.727 C9.836 F60000",
    "G01 X459.8497 Y-6.8104 Z682.8345 A2.378 B-25 C5.053 F120",
    "G01 X459.5381 Y-7.1958 Z682.8978 A5.111 B-25 C12.508 F1800",
]
# The Jacobian is the same at both ends of a whole circle, but not on the way.
CIRCLES = ["G17 G02 I20 J0 F12000", "G02 I3 J0 F1800"]


@pytest.mark.parametrize("program", [CHORDS, CIRCLES])
def test_f_holds_at_the_tip_where_tool_lines_are_rounded(program: list[str]) -> None:
    arm = load_machine("arm6")
    text = "\n".join(["G1010", "T1 G64 P1.0", *program])
    found = simulate(text, arm, kinematics=build_kinematics(arm), record=True)
    assert found.report["ok"]
    assert found.recording is not None
    points = 1e3 * tips("arm6.urdf", "tip", np.radians(found.recording.setpoint))[0]
    speed = np.linalg.norm(np.diff(points, axis=0), axis=1) / arm.cycle_s
    for words, line in zip(program, found.report["lines"], strict=True):
        begin, end = (round(line[each] / arm.cycle_s) for each in ("start_s", "end_s"))
        assert 60.0 * speed[begin : end - 1].max() <= VELOCITY_SLACK * float(words.rpartition("F")[2])
