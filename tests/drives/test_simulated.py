"""Simulated servos: what they do with setpoints, modes and faults."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.drives.bus import DriveFault, DriveMode, DriveState, Feedback, Setpoints
from mcserver.drives.ideal import IdealBus
from mcserver.drives.registry import create_buses
from mcserver.drives.servo_model import loop_coefficients
from mcserver.drives.simulated import SimulatedBus
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import Machine, parse_machine
from tests.machine_text import axes_text

CYCLE_S = 1e-3


def machine(drive: str = "", kind: str = "simulated", axes: int = 1) -> Machine:
    text = axes_text(range(axes), velocity=1000.0, acceleration=10000.0, drive=kind, drive_keys=drive)
    return parse_machine(f'[machine]\nname = "m"\n{text}')


class Bench:
    """One simulated axis and its setpoints."""

    def __init__(self, drive: str = "", cycle_s: float = CYCLE_S) -> None:
        described = machine(drive)
        self.bus = SimulatedBus(described.axes, (0,), cycle_s)
        self.feedback: Feedback = self.bus.boot()
        self.setpoints = Setpoints.of(1)

    def exchange(
        self, mode: DriveMode, position: float = 0.0, velocity: float = 0.0, torque: float = 0.0
    ) -> None:
        self.setpoints.mode[0] = mode
        self.setpoints.position[0] = position
        self.setpoints.velocity[0] = velocity
        self.setpoints.torque[0] = torque
        self.bus.exchange(self.setpoints)

    def energize(self) -> None:
        for _ in range(3):
            self.exchange(DriveMode.POSITION, float(self.feedback.position[0]))

    @property
    def position(self) -> float:
        return float(self.feedback.position[0])

    @property
    def velocity(self) -> float:
        return float(self.feedback.velocity[0])

    @property
    def state(self) -> DriveState:
        return DriveState(int(self.feedback.state[0]))


def test_energizing_takes_two_exchanges() -> None:
    bench = Bench()
    states = []
    for _ in range(3):
        bench.exchange(DriveMode.POSITION)
        states.append(bench.state)
    assert states == [DriveState.STARTING, DriveState.ENERGIZED, DriveState.ENERGIZED]


def test_the_lag_at_constant_speed_is_small_and_not_zero() -> None:
    bench = Bench()
    bench.energize()
    position = 0.0
    for cycle in range(1, 600):
        velocity = min(1.0, 0.01 * cycle)
        position += 0.5 * CYCLE_S * (velocity + min(1.0, 0.01 * (cycle - 1)))
        bench.exchange(DriveMode.POSITION, position, velocity)
    lag = position - bench.position
    assert 1e-5 < lag < 1e-4
    assert bench.velocity == pytest.approx(1.0)


def test_a_step_is_reached_without_overshoot() -> None:
    bench = Bench()
    bench.energize()
    positions = []
    for _ in range(200):
        bench.exchange(DriveMode.POSITION, 1e-4)
        positions.append(bench.position)
    assert max(positions) <= 1e-4 * (1 + 1e-9)
    assert positions[-1] == pytest.approx(1e-4, rel=1e-9)


@settings(max_examples=30)
@given(bandwidth=st.floats(0.5, 2000.0), cycle_s=st.floats(1e-4, 0.1))
def test_the_loop_is_stable_at_any_bandwidth_and_cycle_time(bandwidth: float, cycle_s: float) -> None:
    coefficients = loop_coefficients(np.array([2 * np.pi * bandwidth]), cycle_s)[:, :2, 0]
    assert np.abs(np.linalg.eigvals(coefficients)).max() < 1.0


def test_the_torque_limit_bounds_the_acceleration() -> None:
    bench = Bench("max_torque = 1.0\ninertia = 0.001")
    bench.energize()
    velocities = []
    for _ in range(50):
        bench.exchange(DriveMode.POSITION, 0.05)
        velocities.append(bench.velocity)
    # 1 N·m on 0.001 kg·m², 10 mm a turn
    limit = 1000.0 * 0.01 / (2 * np.pi)
    assert np.abs(np.diff(velocities)).max() / CYCLE_S == pytest.approx(limit)
    assert abs(bench.feedback.torque[0]) <= 1.0 + 1e-9


def test_speeds_above_the_limit_are_cut_off() -> None:
    bench = Bench()
    bench.energize()
    for _ in range(100):
        bench.exchange(DriveMode.POSITION, 5.0)
        assert abs(bench.velocity) <= 1.2 + 1e-12


def test_the_encoder_shows_steps_of_its_resolution() -> None:
    bench = Bench("encoder_resolution = 0.01\ninitial_position = 1.0049")
    assert bench.position == pytest.approx(1.0e-3, abs=1e-12)
    bench.energize()
    for step in range(200):
        bench.exchange(DriveMode.POSITION, 1e-3 + step * 1e-6, 1e-3)
        assert bench.position / 1e-5 == pytest.approx(round(bench.position / 1e-5), abs=1e-6)


def test_velocity_mode_follows_a_speed() -> None:
    bench = Bench()
    position = 0.0
    for _ in range(300):
        position += 0.3 * CYCLE_S
        bench.exchange(DriveMode.VELOCITY, position, 0.3)
    assert bench.velocity == pytest.approx(0.3, rel=1e-6)


def test_velocity_mode_does_not_make_up_for_a_way_that_was_blocked() -> None:
    bench = Bench()
    position = 0.0
    bench.bus.jam(0)
    for _ in range(1000):
        position += 0.3 * CYCLE_S
        bench.exchange(DriveMode.VELOCITY, position, 0.3)
    assert bench.position == 0.0
    bench.bus.jam(0, False)
    for _ in range(500):
        position += 0.3 * CYCLE_S
        bench.exchange(DriveMode.VELOCITY, position, 0.3)
    # at most what is made up within the drive's wind-up time
    assert bench.position < 0.5 * 0.3 + 0.06


def test_torque_mode_accelerates_by_the_inertia_less_the_friction() -> None:
    bench = Bench("inertia = 0.002\nfriction_decel = 100.0")
    for _ in range(3):
        bench.exchange(DriveMode.TORQUE)
    before = bench.velocity
    for _ in range(100):
        bench.exchange(DriveMode.TORQUE, torque=0.5)
    expected = 0.5 / 0.002 * 0.01 / (2 * np.pi) - 0.1
    assert (bench.velocity - before) / 0.1 == pytest.approx(expected)


def test_an_axis_that_is_switched_off_coasts_until_friction_has_stopped_it() -> None:
    bench = Bench("friction_decel = 500.0")
    bench.energize()
    bench.bus.push(0, 0.1)
    for _ in range(100):
        bench.exchange(DriveMode.OFF)
    assert bench.velocity == pytest.approx(0.05)
    for _ in range(200):
        bench.exchange(DriveMode.OFF)
    assert bench.velocity == 0.0
    assert bench.position == pytest.approx(0.1**2 / (2 * 0.5), rel=0.02)


def test_a_brake_closes_when_the_drive_is_off() -> None:
    bench = Bench("brake = true")
    bench.bus.push(0, 0.1)
    for _ in range(12):
        bench.exchange(DriveMode.OFF)
    assert bench.velocity == 0.0


def test_a_silent_master_makes_the_drive_hold_until_its_time_out() -> None:
    bench = Bench("heartbeat_timeout_s = 0.02")
    bench.energize()
    states = []
    for _ in range(30):
        bench.exchange(DriveMode.SILENT)
        states.append(bench.state)
    assert states[18] is DriveState.ENERGIZED
    assert states[19] is DriveState.OFF


def test_a_failed_drive_stays_failed_until_reset() -> None:
    bench = Bench()
    bench.energize()
    bench.bus.trip(0, DriveFault.OVER_TEMPERATURE)
    bench.exchange(DriveMode.POSITION)
    assert (bench.state, bench.feedback.fault[0]) == (DriveState.FAULT, DriveFault.OVER_TEMPERATURE)
    bench.exchange(DriveMode.OFF)
    assert bench.state is DriveState.FAULT
    bench.exchange(DriveMode.RESET)
    assert (bench.state, bench.feedback.fault[0]) == (DriveState.OFF, 0)


def test_a_silenced_drive_keeps_its_old_answer() -> None:
    bench = Bench()
    bench.energize()
    bench.bus.silence(0, 2)
    fresh = []
    for step in range(4):
        bench.exchange(DriveMode.POSITION, 1e-3 * step)
        fresh.append(bool(bench.feedback.fresh[0]))
    assert fresh == [False, False, True, True]


def test_a_machine_may_mix_ideal_and_simulated_drives() -> None:
    text = '[machine]\nname = "m"\n'
    for index, kind in enumerate(("ideal", "simulated", "ideal")):
        text += axes_text([index], rotary=True, drive=kind)
    buses = create_buses(parse_machine(text))
    assert {bus.columns: bus.follows_exactly for bus in buses} == {(0, 2): True, (1,): False}


def test_an_ideal_drive_shows_its_setpoint_in_the_same_exchange() -> None:
    described = machine(kind="ideal")
    bus = IdealBus(described.axes, (0,))
    bus.boot()
    setpoints = Setpoints.of(1)
    setpoints.mode[0] = DriveMode.POSITION
    setpoints.position[0] = 0.25
    assert bus.exchange(setpoints).position[0] == 0.25
    setpoints.mode[0] = DriveMode.OFF
    setpoints.position[0] = 0.5
    assert bus.exchange(setpoints).position[0] == 0.25


def test_a_kind_of_drive_that_cannot_be_driven_is_a_configuration_error() -> None:
    with pytest.raises(ConfigurationError) as refused:
        create_buses(machine(kind="ideal"), factories={})
    assert refused.value.code == "MC006"
    assert "axis 0" in refused.value.message
