"""Counts, turns and torques of drives in SI and back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.drives.cia402.scaling import PositionTracker, Scaling, scaling_objects, wrapped
from mcserver.machine.axis import Axis
from mcserver.machine.machine_file import parse_machine

INT32 = st.integers(-(2**31), 2**31 - 1)


def axis(drive: str, type_: str = "linear", keys: str = "") -> Axis:
    text = f'[machine]\nname = "m"\n[[axis]]\nindex = 0\ntype = "{type_}"\nmax_velocity = 100.0\n'
    text += f"max_acceleration = 1000.0\n{keys}\n[axis.drive]\n"
    return parse_machine(f'{text}kind = "cia402"\nbus = "can0"\nnode = 1\n{drive}\n').axes[0]


def test_counts_come_from_counts_per_motor_rev_and_units_per_motor_rev() -> None:
    scaling = Scaling.of(axis("counts_per_motor_rev = 10000", keys="units_per_motor_rev = 5.0"))
    assert scaling.counts_per_si == pytest.approx(2e6)
    assert scaling.velocity_per_si == pytest.approx(2e6)
    assert scaling.permille_per_nm == 0.0


def test_counts_come_from_encoder_gear_and_feed() -> None:
    scaling = Scaling.of(axis("encoder = [8192, 2]\ngear = [10, 1]\nfeed = [20.0, 1]"))
    # 4096 increments a turn of the motor, 10 turns for 20 mm
    assert scaling.counts_per_si == pytest.approx(4096 * 10 / 0.02)


def test_a_rotary_axis_without_a_feed_has_360_degrees_a_turn_of_the_shaft() -> None:
    scaling = Scaling.of(axis("counts_per_motor_rev = 4096\ngear = [50, 1]", "rotary"))
    assert scaling.counts_per_si == pytest.approx(4096 * 50 / (2 * math.pi))


def test_an_inverted_motor_turns_every_factor_round() -> None:
    keys = "units_per_motor_rev = 5.0"
    plain = Scaling.of(axis("counts_per_motor_rev = 100\nrated_torque = 2.0", keys=keys))
    turned = Scaling.of(axis("counts_per_motor_rev = 100\nrated_torque = 2.0\ninvert = true", keys=keys))
    assert turned == Scaling(-plain.counts_per_si, -plain.velocity_per_si, -plain.permille_per_nm)
    assert plain.permille_per_nm == 500.0


def test_a_drive_may_count_speeds_in_units_of_its_own() -> None:
    drive = "counts_per_motor_rev = 10000\nvelocity_counts_per_motor_rev = 60.0"
    assert Scaling.of(axis(drive, keys="units_per_motor_rev = 10.0")).velocity_per_si == pytest.approx(6000.0)


def test_the_objects_make_the_drive_s_unit_one_increment() -> None:
    drive = axis("encoder = [8192, 2]\ngear = [10, 3]\nfeed = [20.0, 1]").drive
    written = {(index, subindex): value for index, subindex, value in scaling_objects(drive)}
    internal = (written[0x608F, 1] / written[0x608F, 2]) * (written[0x6091, 1] / written[0x6091, 2])
    assert written[0x6092, 1] / written[0x6092, 2] == pytest.approx(internal)


@given(INT32, st.floats(1e-3, 1e9), st.booleans())
def test_a_count_survives_the_way_to_si_and_back(count: int, per_si: float, inverted: bool) -> None:
    factor = -per_si if inverted else per_si
    shown = np.array([count], np.int64) * (1.0 / np.array([factor]))
    assert wrapped(np.rint(shown * factor))[0] == count


@given(st.integers(-(2**50), 2**50))
def test_a_count_beyond_32_bits_wraps(count: int) -> None:
    assert (int(wrapped(np.array([float(count)]))[0]) - count) % 2**32 == 0


@given(INT32, st.lists(st.integers(-(2**31) + 1, 2**31 - 1), max_size=30))
def test_a_tracker_follows_any_motion_below_half_the_range_a_cycle(start: int, steps: list[int]) -> None:
    tracker = PositionTracker(1)
    tracker.restart(0, start)
    true = start
    for step in steps:
        true += step
        tracker.follow(wrapped(np.array([float(true)])))
        assert tracker.counts[0] == true
