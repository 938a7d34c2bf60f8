"""Blocks of cycles that a simulation plays in one go: the same to the bit as cycle by cycle."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mcserver.executor.block import Block
from mcserver.executor.executor import Executor
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.simulation.simulation import Simulation, simulate
from tests.machine_text import axes_text

PROGRAM = """G1010
G94 F9000
G01 X10 Y5
X20.05 Y5.03
X20.1 Y5.07
X20.13 Y5.12
G02 X30.13 Y-4.88 I0 J-10
G04 P0.013
G01 X0 Y0 Z3, G01 [3]40 F720
G09 G01 X3 F3000
G00 X-4 Y2
G1020 Z20
G01 X5 Y9 F12000
M00
G93 G01 X0 Y0 F240
G01 X7 Y1 [3]90 F111
G1030 [4]20
G94 G01 X2 Y2 F3000
G1030 [4]0
G01 X0
"""

SPINDLE = """G1010
G1030 [4]20
G94 G01 X10 Y5 F3000
X20 Y5
G02 X30 Y-5 I0 J-10
G1030 [4]-30
G01 X0 Y0 F6000
G04 P0.2
X9 Y-3
G00 X0
G1030 [4]0
G01 X3
"""


def machine(kind: str, travel: str = "", drive: str = "") -> Machine:
    text = '[machine]\nname = "test"\n[motion]\npath_tolerance_mm = 0.02\n'
    for index in range(5):
        text += axes_text(
            [index],
            rotary=index >= 3,
            velocity=300.0,
            acceleration=3000.0,
            keys=f"max_jerk = 90000.0\n{travel}",
            drive=kind,
            drive_keys=drive,
        )
    return parse_machine(text)


def timeless(report: dict[str, Any]) -> dict[str, Any]:
    lines = [
        {name: value for name, value in line.items() if name != "planning_s"} for line in report["lines"]
    ]
    return {**report, "lines": lines}


def both(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> tuple[Simulation, Simulation, int]:
    """A run in blocks, one cycle by cycle, and how many cycles the blocks had."""
    played = 0
    play = Executor.play_block

    def counting(executor: Executor, time: float, limit: int) -> Block | None:
        nonlocal played
        block = play(executor, time, limit)
        played += 0 if block is None else len(block.lines)
        return block

    monkeypatch.setattr(Executor, "play_block", counting)
    in_blocks = simulate(PROGRAM, machine, record=True)
    monkeypatch.setattr(Executor, "play_block", lambda *_: None)
    return in_blocks, simulate(PROGRAM, machine, record=True), played


def assert_same(first: Simulation, second: Simulation) -> None:
    assert timeless(first.report) == timeless(second.report)
    assert first.recording is not None
    assert second.recording is not None
    for name in ("time_s", "line", "setpoint", "actual"):
        assert np.array_equal(getattr(first.recording, name), getattr(second.recording, name))
    for name, values in second.recording.outputs.items():
        assert np.array_equal(first.recording.outputs[name], values)


def test_blocks_are_the_same_to_the_bit_as_cycle_by_cycle(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, played = both(machine("ideal"), monkeypatch)
    assert first.exit_code == 0
    assert_same(first, second)
    assert second.recording is not None
    assert played > 0.5 * len(second.recording.time_s)


@pytest.mark.parametrize("kind", ["ideal", "simulated"])
def test_a_turning_spindle_is_the_same_to_the_bit_too(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "PROGRAM", SPINDLE)
    first, second, played = both(machine(kind), monkeypatch)
    assert first.exit_code == 0
    assert_same(first, second)
    assert second.recording is not None
    assert played > 0.5 * len(second.recording.time_s)
    turned = np.abs(second.recording.setpoint[:, 4]).max()
    assert turned > 50.0


def test_an_axis_that_stands_and_would_stop_slowly_shortens_no_blocks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    chords = [f"G01 X{0.1 * k:.2f} Y{0.05 * (k % 3):.2f}" for k in range(1500)]
    monkeypatch.setitem(globals(), "PROGRAM", "\n".join(["G1010", "G94 F12000 G64 P0.02", *chords]))
    spindle = axes_text([3], rotary=True, velocity=300.0, acceleration=60.0, drive="ideal")
    moving = axes_text(
        range(2), velocity=300.0, acceleration=3000.0, keys="max_jerk = 90000.0", drive="ideal"
    )
    first, second, played = both(parse_machine('[machine]\nname = "test"\n' + moving + spindle), monkeypatch)
    assert first.exit_code == 0
    assert_same(first, second)
    assert second.recording is not None
    assert played > 0.9 * len(second.recording.time_s)


LASER = """G21 G90 G94 F6000
M3 S400
G1 X30 S300
X40 S0
X45.5 S900
G0 X60 Y30
G1 X62 S200
M4 S700
X70 Y22
M7
G3 X80 Y30 R10 S120
M67 E1 Q3.5
G1 X90 F3000
G4 P0.25
G0 Z2
M9
G1 X100 S650
M5
X0
"""


def cutter(kind: str, rapids: str) -> Machine:
    text = '[machine]\nname = "cutter"\n[motion]\npath_tolerance_mm = 0.02\n'
    text += f'[dialect]\nprofile = "cnc"\nrapids = "{rapids}"\n[dialect.outputs]\n'
    text += 'M3 = { beam = "S" }\nM4 = { beam = "S" }\nM5 = { beam = 0 }\n'
    text += "M7 = { air = true }\nM9 = { air = false }\n"
    text += axes_text(range(3), velocity=300.0, acceleration=3000.0, keys="max_jerk = 90000.0", drive=kind)
    text += '[[output]]\nnumber = 0\nname = "beam"\nkind = "analog"\nmax = 1000.0\nlaser = true\n'
    text += '[[output]]\nnumber = 1\nname = "level"\nkind = "analog"\nmax = 10.0\n'
    return parse_machine(text + '[[output]]\nnumber = 1\nname = "air"\n')


@pytest.mark.parametrize("rapids", ["independent", "straight"])
@pytest.mark.parametrize("kind", ["ideal", "simulated"])
def test_outputs_rapids_and_dwells_are_played_in_blocks_too(
    kind: str, rapids: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(globals(), "PROGRAM", LASER)
    first, second, played = both(cutter(kind, rapids), monkeypatch)
    assert first.exit_code == 0, first.report["diagnostics"]
    assert_same(first, second)
    assert first.outputs == second.outputs
    assert second.recording is not None
    assert played > 0.85 * len(second.recording.time_s)
    assert {*second.recording.outputs["level"]} == {0.0, 3.5}
    assert len({*second.recording.outputs["beam"]}) > 50


DRIVES = {
    "as they are": "",
    "with coarse encoders": "encoder_resolution = 0.003\n",
    "too weak now and then": "max_torque = 0.0018\ninertia = 1e-6\n",
}


@pytest.mark.parametrize("drive", DRIVES)
def test_drives_with_a_lag_are_the_same_to_the_bit_too(drive: str, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, played = both(machine("simulated", drive=DRIVES[drive]), monkeypatch)
    assert_same(first, second)
    assert second.recording is not None
    assert played > 0.3 * len(second.recording.time_s)


def test_a_following_error_stops_a_block_in_its_cycle(monkeypatch: pytest.MonkeyPatch) -> None:
    weak = machine("simulated", "max_following_error = 0.006\n")
    first, second, played = both(weak, monkeypatch)
    assert [fault["code"] for fault in first.report["diagnostics"]] == ["MC407"]
    assert first.exit_code == second.exit_code == 1
    assert played > 0
    assert_same(first, second)
