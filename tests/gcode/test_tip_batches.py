"""Lines that lead a tool, read in columns, are those that it makes line by line."""

from __future__ import annotations

import functools
import random
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mckinematics.pose import Kinematics

from mcserver.gcode.fast_path.interpreted_batch import MIN_LINES
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.motion.canonical import Canonical, FeedGroup, MotionLine
from mcserver.motion.geometry.curves import TipLine
from tests.gcode.test_batches import by_batches, line_by_line
from tests.simulation.five_axes import TABLE_TABLE, ZERO

MACHINES = ("arm6", "robot-dog", "mill")
# last bits of sums of matrices
CLOSE = {"rtol": 1e-9, "atol": 1e-12}
# a word that keeps a tool where it is, or where it cannot go; or that no batch holds
ODD = (
    *("", "; said", "G1 X9999 Y0 Z0", "G1 X5 I3", "G1050", "T9", "G0 Z-10", "G9 X1", "G53 X1", "G61", "G90"),
    *("G64 P0.05", "G64 P0", "G93 F60", "G94 F1200", "G20", "G21", "G91", "M3 S5", "G1 A5", "X-", "S3 X1"),
    *("G43.5 H1", "G49", "G43.4 H1", "A300", "T1", "G1 [0]5", "G2 X1 Y1 R5", "F0", "G1030 [0]5", "G1000 P0"),
)


@functools.cache
def machine(name: str) -> tuple[Machine, Kinematics | None]:
    """A machine with its kinematics."""
    if name == "mill":
        found = TABLE_TABLE.machine(Path(tempfile.mkdtemp()))
        return found, build_kinematics(found)
    found = load_machine(name)
    return found, build_kinematics(found)


def begun(name: str, kinematics: Kinematics) -> tuple[list[str], list[float]]:
    """The first lines of a program, and the tool's place behind them [mm]."""
    if name == "mill":
        zero = " ".join(f"{letter}{value:g}" for letter, value in zip("XYZ", ZERO, strict=True))
        return [f"G10 L2 P1 {zero}", "G54 G64", "G43.4 H1", "G1 X20 Y10 Z30 A10 C20 F3000"], [20, 10, 30]
    tool = kinematics.tools[0]
    found = load_machine(name)
    pose = kinematics.pose(tool, {axis.index: axis.initial_position for axis in found.axes})
    here = [1e3 * each for each in pose.position]
    x, y, z = here
    return [f"T{tool} G64 P0.1", f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f} F3000"], here


@st.composite
def programs(draw: st.DrawFn) -> tuple[str, list[str]]:
    """A machine, and lines of chords with what may break a batch."""
    name = draw(st.sampled_from(MACHINES))
    rng = random.Random(draw(st.integers(0, 1 << 32)))
    _, kinematics = machine(name)
    assert kinematics is not None
    lines, here = begun(name, kinematics)
    turns = [10.0, 20.0] if name == "mill" else [0.0, 0.0]
    letters = "AC" if name == "mill" else "AB"
    for _ in range(rng.randint(1, 4)):
        step, odd = rng.choice([0.05, 0.5, 3.0, 20.0]), rng.choice([0.0, 0.0, 0.1])
        words = rng.choice(["XYZ", "XY", "XYZ", "X"])
        turned = rng.random() < 0.5 and name != "robot-dog"
        form = rng.choice(
            ["{}", "G1 {}", "G1 T{t} {}" if name != "mill" else "G01 {}", "N5 {} (said)", "{} F{f}"]
        )
        for _ in range(rng.randint(2, 30)):
            if rng.random() < odd:
                lines.append(rng.choice(ODD))
                continue
            here = [each + rng.uniform(-step, step) for each in here]
            text = " ".join(f"{letter}{here['XYZ'.index(letter)]:.4f}" for letter in words)
            if turned:
                turns = [each + rng.uniform(-0.2, 0.2) for each in turns]
                text += " " + " ".join(f"{a}{value:.4f}" for a, value in zip(letters, turns, strict=True))
            lines.append(form.format(text, t=kinematics.tools[0], f=rng.choice([600, 1200, 30000])))
    return name, lines


def assert_same(found: list[Canonical], expected: list[Canonical]) -> None:
    assert [type(each) for each in found] == [type(each) for each in expected]
    for one, other in zip(found, expected, strict=True):
        if not isinstance(one, MotionLine) or not isinstance(other, MotionLine):
            assert one == other
            continue
        assert (one.line, one.exact_stop, len(one.groups)) == (
            other.line,
            other.exact_stop,
            len(other.groups),
        )
        np.testing.assert_allclose(one.tolerance, other.tolerance, **CLOSE)
        np.testing.assert_allclose(one.feed_length, other.feed_length, **CLOSE)
        for group, like in zip(one.groups, other.groups, strict=True):
            assert type(group) is type(like)
            if isinstance(group, FeedGroup) and isinstance(like, FeedGroup):
                assert_same_group(group, like)


def assert_same_group(one: FeedGroup, other: FeedGroup) -> None:
    assert (one.carried, one.reference) == (other.carried, other.reference)
    for name in ("requested", "duration", "speed"):
        first, second = getattr(one, name), getattr(other, name)
        assert (first is None) == (second is None)
        if first is not None:
            np.testing.assert_allclose(first, second, **CLOSE)
    for curve, like in zip(one.curves, other.curves, strict=True):
        assert (type(curve), curve.axes) == (type(like), like.axes)
        assert (curve.tool_rates is None) == (like.tool_rates is None)
        np.testing.assert_allclose(curve.ends(), like.ends(), atol=2e-9)
        for name in ("length", "max_path_rate", "lever"):
            np.testing.assert_allclose(getattr(curve, name), getattr(like, name), rtol=1e-6, atol=1e-9)


@settings(max_examples=30)
@given(programs())
def test_lines_of_a_tool_in_columns_are_those_of_one_by_one(drawn: tuple[str, list[str]]) -> None:
    name, texts = drawn
    made, kinematics = machine(name)
    quick, general = (Interpreter(made, kinematics=kinematics) for _ in range(2))
    values, faults = by_batches(quick, texts)
    expected, expected_faults = line_by_line(general, texts)
    assert [(each.line, each.code) for each in faults] == [(each.line, each.code) for each in expected_faults]
    assert_same(values, expected)
    assert quick.modal == general.modal
    positions = general.positions
    for axis, place in quick.positions.items():
        assert place == pytest.approx(positions[axis], abs=2e-9)


@pytest.mark.parametrize("name", MACHINES)
def test_chords_of_a_tool_are_read_in_columns(name: str) -> None:
    made, kinematics = machine(name)
    assert kinematics is not None
    lines, (x, y, z) = begun(name, kinematics)
    interpreter = Interpreter(made, kinematics=kinematics)
    for number, text in enumerate(lines, start=1):
        interpreter.interpret_text(text, number)
    chords = [f"G1 X{x + 0.05 * step:.4f} Y{y:.4f} Z{z - 0.02 * step:.4f}" for step in range(1, 300)]
    found = interpreter.interpret_batch(chords, len(lines) + 1)
    assert found is not None
    assert found.taken >= 32
    assert found.taken >= MIN_LINES
    (batch,) = found.values
    (group,) = batch.values()[0].groups
    assert isinstance(group.curves[0], TipLine)
