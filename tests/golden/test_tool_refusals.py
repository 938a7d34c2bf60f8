"""Each fault of inverse kinematics by a program that earns it: nothing moves, and it says why (D-53)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.simulation import simulate
from tests.kinematics.tool_machines import Joint, X, Y, Z, chain_machine


def refused(machine: Machine, command: str) -> dict[str, Any]:
    """The one diagnostic of a program whose last line cannot be solved; nothing of the program has moved."""
    text = f"G1010\nG93 F20\n{command}\n"
    simulation = simulate(text, machine, kinematics=build_kinematics(machine), record=True)
    report = simulation.report
    assert simulation.exit_code == 4
    assert report["ok"] is False
    assert (report["duration_s"], report["lines"]) == (0.0, [])
    assert simulation.recording is None
    for axis in machine.axes:
        shown = report["axes"][str(axis.index)]
        start = pytest.approx(axis.initial_position / axis.type.si_per_unit)
        assert (shown["min"], shown["max"], shown["position"]) == (start, start, start)
    (diagnostic,) = report["diagnostics"]
    assert diagnostic["severity"] == "error"
    assert diagnostic["line"] == text.count("\n")
    assert diagnostic["hint"]
    return dict(diagnostic)


def test_a_point_out_of_reach_tells_tool_place_and_distance() -> None:
    diagnostic = refused(load_machine("robot-dog"), "G01 T3 Y-400 Z-1000")
    assert diagnostic["code"] == "MC302"
    assert diagnostic["tool"] == 3
    # the stretched leg of 700 mm, 60 mm beside the hip's axis; the point is 1400 mm behind, 400 mm below
    down = np.linspace(0.0, 700.0, 7001)
    beside = np.hypot(60.0, 400.0) - np.hypot(60.0, down)
    nearest = np.hypot(beside, 1400.0 - np.sqrt(700.0**2 - down**2)).min()
    assert diagnostic["residual_mm"] == pytest.approx(nearest, abs=0.01)
    assert "axis" not in diagnostic
    assert "X -159" in diagnostic["message"]


def test_an_arc_that_leaves_the_reach_between_its_ends_is_refused() -> None:
    diagnostic = refused(load_machine("robot-dog"), "G03 T3 Y-400 Z800 R401")
    assert diagnostic["code"] in ("MC302", "MC303")
    assert diagnostic["tool"] == 3


def test_a_joint_past_its_limit_is_reported_with_its_axis() -> None:
    diagnostic = refused(load_machine("robot-dog"), "G01 T3 Y-697 Z400")
    assert diagnostic["code"] == "MC303"
    assert (diagnostic["tool"], diagnostic["axis"]) == (3, 2)
    # at -15 deg the knee leaves 694.01 mm of leg
    assert diagnostic["residual_mm"] == pytest.approx(697.0 - 694.01, abs=0.05)
    assert "-15 deg" in diagnostic["message"]


def test_a_rapid_to_a_pose_out_of_reach_is_refused_too() -> None:
    diagnostic = refused(load_machine("arm6"), "G00 T1 X2000")
    assert (diagnostic["code"], diagnostic["tool"]) == ("MC302", 1)
    assert diagnostic["residual_mm"] > 1000.0


def test_an_aligned_wrist_that_would_have_to_turn_aside_is_singular() -> None:
    diagnostic = refused(load_machine("arm6"), "G00 [4]0\nG01 T1 V100")
    assert (diagnostic["code"], diagnostic["tool"]) == ("MC304", 1)


def test_a_path_that_no_continuous_joint_motion_follows_is_refused(tmp_path: Path) -> None:
    # the configuration that the arm starts in ends inside its reach; others go on
    arm = (
        Joint("continuous", "0 0 0", Z),
        Joint("continuous", "0.1 0 0", Y),
        Joint("continuous", "0.2 0.1 0", Z),
    )
    machine = chain_machine(tmp_path, arm, tip="0.15 0 0", start={0: 60.0, 1: 23.0, 2: 44.0})
    diagnostic = refused(machine, "G01 T1 X-16 Y56 Z114")
    assert diagnostic["code"] == "MC305"
    assert diagnostic["tool"] == 1
    assert "configuration" in diagnostic["hint"]


def test_a_slide_that_cannot_pass_the_middle_of_its_turntable_is_at_its_limit(tmp_path: Path) -> None:
    polar = (Joint("continuous", "0 0 0", Z), Joint("prismatic", "0 0 0", X, 0.0, 0.5))
    machine = chain_machine(tmp_path, polar, tip="0 0 0", start={1: 200.0})
    diagnostic = refused(machine, "G01 T1 X-200")
    assert (diagnostic["code"], diagnostic["axis"]) == ("MC303", 1)


def test_one_leg_out_of_reach_keeps_all_legs_of_the_line_still() -> None:
    line = "G01 T6 X159 Y-400 Z400 G01 T3 X-159 Y-400 Z-1000"
    assert refused(load_machine("robot-dog"), line)["tool"] == 3
