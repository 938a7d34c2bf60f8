"""``mcserver resonance``: from a recording of moves, or an accelerometer's file, to a shaper."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from mcserver.cli.app import run_command_line

Capture = pytest.CaptureFixture[str]
MACHINE = """
[machine]
name = "ringing"
[motion]
path_tolerance_mm = 1.0
[[axis]]
index = 0
type = "linear"
max_velocity = 300.0
max_acceleration = 3000.0
{shaper}
[axis.drive]
flexible_hz = 43.0
flexible_damping = 0.03
bandwidth_hz = 200.0
"""
STEPS = "G90 G94 G61\nG1010\nG01 X20 F18000\nG04 P0.4\nG01 X0\nG04 P0.4\nM02\n"


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    path = tmp_path / "ringing.toml"
    path.write_text(MACHINE.format(shaper=""))
    return path


def test_the_shaper_that_a_recording_of_moves_proposes_takes_the_ringing_away(
    machine: Path, tmp_path: Path, capfd: Capture
) -> None:
    program, recording = tmp_path / "steps.gcode", tmp_path / "steps.npz"
    program.write_text(STEPS)
    simulate = ["simulate", str(program), "--machine", str(machine), "--output", str(recording)]
    measure = ["resonance", str(recording), "--axis", "0", "--machine", str(machine)]
    assert run_command_line(simulate) == 0
    capfd.readouterr()
    picture = tmp_path / "ring.png"
    assert run_command_line([*measure, "--json", "--plot", str(picture)]) == 0
    answer = json.loads(capfd.readouterr().out)
    assert answer["frequency_hz"] == pytest.approx(43.0, rel=0.005)
    assert answer["damping"] == pytest.approx(0.03, abs=0.003)
    assert answer["proposed"] == "ei"
    assert picture.read_bytes().startswith(b"\x89PNG")
    before = swing(recording)
    assert run_command_line([*measure, "--tool", "3"]) == 0
    with_tool = capfd.readouterr().out
    assert run_command_line(measure) == 0
    (line,) = [each for each in capfd.readouterr().out.splitlines() if each.startswith("shaper =")]
    assert f"tool_{line.replace('shaper', 'shapers.3')}\n" in with_tool
    machine.write_text(MACHINE.format(shaper=line))
    assert run_command_line(simulate) == 0
    assert swing(recording) < 0.06 * before


def swing(recording: Path) -> float:
    """How far the axis swings about its last rest [mm]."""
    with np.load(recording) as read:
        rests = int(np.flatnonzero(np.diff(read["setpoint"][:, 0]))[-1])
        return float(np.abs(read["actual"][rests + 5 :, 0]).max())


def test_an_accelerometer_is_read_from_its_greatest_value_on(
    machine: Path, tmp_path: Path, capfd: Capture
) -> None:
    rng = np.random.default_rng(3)
    at = np.cumsum(rng.uniform(0.8, 1.2, 3000)) / 3200.0
    ring = np.where(at < 0.2, 0.0, np.exp(-0.05 * math.tau * 31.0 * (at - 0.2)))
    ring = ring * np.sin(math.tau * 31.0 * (at - 0.2)) + 0.01 * rng.normal(size=3000)
    rows = [
        f"{t:.6f},{0.02 * n:.4f},{1e3 * a:.3f}"
        for t, n, a in zip(at, rng.normal(size=3000), ring, strict=True)
    ]
    file = tmp_path / "accelerations.csv"
    file.write_text("\n".join(["#time,accel_x,accel_y", *rows]))
    assert run_command_line(["resonance", str(file), "--axis", "0", "--machine", str(machine), "--json"]) == 0
    answer = json.loads(capfd.readouterr().out)
    assert answer["frequency_hz"] == pytest.approx(31.0, rel=0.01)
    assert answer["damping"] == pytest.approx(0.05, abs=0.01)


def shaken(base: np.ndarray, step_s: float, frequency: float, damping: float) -> np.ndarray:
    """Accelerations of a load that hangs on a base by a spring, with noise, shape (n,)."""
    omega = math.tau * frequency
    matrix = expm(
        step_s * np.array([[0.0, 1.0, 0.0], [-(omega**2), -2.0 * damping * omega, -1.0], [0.0] * 3])
    )
    state, found = np.zeros(2), np.empty(len(base))
    for n, acceleration in enumerate(base.tolist()):
        found[n] = -(omega**2) * state[0] - 2.0 * damping * omega * state[1]
        state = matrix[:2, :2] @ state + matrix[:2, 2] * acceleration
    return found + 50.0 * np.random.default_rng(3).normal(size=len(base))


def braking(at: np.ndarray) -> np.ndarray:
    """From rest to 100 mm/s at 3000 mm/s², and to rest 0.3 s later."""
    return 3000.0 * (np.abs(at - 0.22) < 0.0167) - 3000.0 * (np.abs(at - 0.52) < 0.0167)


def sweep(at: np.ndarray) -> np.ndarray:
    """Pulses of either sign, at 5 Hz and 4 Hz faster in each second, as strong as they are quick."""
    frequency = 5.0 + 4.0 * at
    return 60.0 * frequency * np.sign(np.sin(math.tau * (5.0 * at + 2.0 * at**2)))


@pytest.mark.parametrize("damping", [0.02, 0.1])
@pytest.mark.parametrize(("base", "seconds"), [(braking, 1.5), (sweep, 25.0)])
def test_a_stop_is_measured_behind_its_braking_and_a_sweep_by_its_spectrum(
    base: Callable[[np.ndarray], np.ndarray], seconds: float, damping: float, tmp_path: Path, capfd: Capture
) -> None:
    at = np.arange(0.0, seconds, 1.0 / 1600.0)
    file = tmp_path / "accelerations.csv"
    np.savetxt(file, np.stack([at, shaken(base(at), 1.0 / 1600.0, 48.0, damping)], axis=1), "%.6f", ",")
    assert run_command_line(["resonance", str(file), "--axis", "0", "--json"]) == 0
    answer = json.loads(capfd.readouterr().out)
    assert answer["frequency_hz"] == pytest.approx(48.0, rel=0.01)
    assert answer["damping"] == pytest.approx(damping, rel=0.1)
    assert answer["explained"] > 0.95


def test_a_stop_that_does_not_ring_is_no_measurement(tmp_path: Path, capfd: Capture) -> None:
    at = np.arange(0.0, 1.5, 1.0 / 1600.0)
    noise = 50.0 * np.random.default_rng(5).normal(size=len(at))
    file = tmp_path / "accelerations.csv"
    np.savetxt(file, np.stack([at, braking(at) + noise], axis=1), "%.6f", ",")
    assert run_command_line(["resonance", str(file), "--axis", "0"]) == 2
    assert "no ring" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no table"),
        ("0,1\n1,nan\n" * 20, "no table"),
        ("\n".join(f"{n % 7},1" for n in range(50)), "do not rise"),
        ("\n".join(f"{n * 1e-3},{n * 7919 % 101}" for n in range(900)), "no ring"),
        ("\n".join(f"{n * 1e-3},5" for n in range(900)), "no ring"),
    ],
)
def test_what_is_no_measurement_is_refused(
    text: str, says: str, machine: Path, tmp_path: Path, capfd: Capture
) -> None:
    file = tmp_path / "file.csv"
    file.write_text(text)
    assert run_command_line(["resonance", str(file), "--axis", "0", "--machine", str(machine)]) == 2
    assert says in capfd.readouterr().err
    assert run_command_line(["resonance", str(file), "--axis", "9", "--machine", str(machine)]) == 2
    assert run_command_line(["resonance", f"{file}.no", "--axis", "0", "--machine", str(machine)]) == 2
