"""How much of a bus a cycle takes, and machine files that ask too much."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mcserver.errors import ConfigurationError
from mcserver.machine.bus_load import CEILING, bus_loads, frame_bits
from mcserver.machine.machine_file import Machine, parse_machine
from tests.machine_text import axes_text


def machine(
    axes: int, cycle_hz: float, buses: int = 1, drive: str = "", bus: str = "", kind: str = "cia402"
) -> Machine:
    text = f'[machine]\nname = "m"\ncycle_hz = {cycle_hz}\n{bus}\n'
    for index in range(axes):
        keys = f'bus = "can{index % buses}"\nnode = {index + 1}\ncounts_per_motor_rev = 4096\n{drive}'
        follow = "max_following_error = 5.0"
        text += axes_text([index], rotary=True, velocity=100.0, keys=follow, drive=kind, drive_keys=keys)
    return parse_machine(text)


@pytest.mark.parametrize(("length", "bits"), [(0, 55), (1, 65), (6, 115), (7, 125), (8, 135)])
def test_a_frame_has_so_many_bits_at_most(length: int, bits: int) -> None:
    assert frame_bits(length) == bits


def test_the_load_is_the_sum_of_all_frames_of_a_cycle() -> None:
    (load,) = bus_loads(machine(3, 500.0))
    # SYNC, RPDO2, TPDO1 each cycle; RPDO1 and TPDO2 each tenth; 30 heartbeats and 20 of the master a second
    bits = 55 + 3 * (135 + 125 + 12.5 + 11.5)
    assert load.bits_per_cycle == pytest.approx(bits)
    assert load.share == pytest.approx((bits * 500 + 50 * 65) / 1e6)
    assert "3 × 135 (RPDO2)" in load.arithmetic()
    assert load.arithmetic().endswith("% of 1000 kbit/s")


def test_twelve_axes_fit_one_bus_at_200_hz_and_four_buses_at_500() -> None:
    assert all(load.fits for load in bus_loads(machine(12, 200.0)))
    loads = bus_loads(machine(12, 500.0, buses=4))
    assert [load.bus for load in loads] == ["can0", "can1", "can2", "can3"]
    assert all(load.fits for load in loads)


def test_a_machine_that_does_not_fit_is_refused_with_the_arithmetic_and_what_fits() -> None:
    with pytest.raises(ConfigurationError) as refused:
        machine(12, 500.0)
    assert refused.value.code == "MC007"
    assert "bus can0 cannot carry 12 axes at 500 Hz" in refused.value.message
    assert "12 × 135 (RPDO2)" in refused.value.message
    assert refused.value.hint == (
        "cycle_hz = 200 fits (anything up to 224 does); at 500 Hz 3 buses with at most 4 axes each fit"
    )


def test_what_is_said_to_fit_fits_and_no_more() -> None:
    (load,) = bus_loads(machine(12, 200.0))
    greatest = load.greatest_cycle_hz
    assert all(each.share <= CEILING for each in bus_loads(machine(12, greatest)))
    with pytest.raises(ConfigurationError):
        machine(12, greatest + 1)


TORQUES = 'mode = "cst"\nrated_torque = 1.0\ninertia = 1e-4\n'
POINTS = 'mode = "pp"\n'


def test_rpdo1_comes_besides_as_often_as_the_shortest_time_out_asks_for_it() -> None:
    # 40 ms of ten cycles: three times in it, so in every third cycle
    (load,) = bus_loads(machine(8, 250.0, drive=TORQUES))
    assert load.bits_per_cycle == pytest.approx(55 + 8 * (135 + 125 / 3 + 125 + 11.5))
    (load,) = bus_loads(machine(12, 200.0))
    assert load.bits_per_cycle == pytest.approx(55 + 12 * (135 + 125 / 6 + 125 + 11.5))


def test_the_table_of_greatest_rates_holds_to_the_hertz() -> None:
    page = (Path(__file__).parents[2] / "docs" / "canopen.md").read_text("utf-8")
    rows = re.findall(r"^\| (\d+) \| (\d+) Hz \| (\d+) Hz \| (\d+) Hz \|$", page, re.MULTILINE)
    assert [int(row[0]) for row in rows] == [2, 3, 4, 6, 8, 12]
    for axes, *rates in ([int(number) for number in row] for row in rows):
        for drive, rate in zip(("", TORQUES, POINTS), rates, strict=True):
            machine(axes, rate, drive=drive)
            with pytest.raises(ConfigurationError, match="MC007"):
                machine(axes, rate + 1, drive=drive)


def test_a_rate_that_would_still_fit_does_so_with_time_outs_that_follow_the_cycle() -> None:
    (load,) = bus_loads(machine(8, 100.0, drive=TORQUES))
    machine(8, load.greatest_cycle_hz, drive=TORQUES)


def test_a_slower_bus_carries_less() -> None:
    bus = '[[bus]]\nname = "can0"\nbitrate = 250000\n'
    with pytest.raises(ConfigurationError) as refused:
        machine(3, 500.0, bus=bus)
    assert refused.value.code == "MC007"
    assert "% of 250 kbit/s" in refused.value.message


def test_servosila_drives_take_a_command_and_three_frames_of_telemetry_and_no_sync() -> None:
    codes = "codes = { off = 2 }\n"
    (load,) = bus_loads(machine(2, 500.0, drive=codes, kind="servosila"))
    assert load.bits_per_cycle == 2 * 4 * 135
    drive = f"{codes}telemetry_hz = 100.0\n"
    (slower,) = bus_loads(machine(2, 500.0, drive=drive, kind="servosila"))
    assert slower.share == pytest.approx((2 * 135 * 500 + 2 * 3 * 100 * 135) / 1e6)


def test_a_machine_without_can_drives_loads_no_bus() -> None:
    assert bus_loads(machine(2, 1000.0, kind="simulated")) == ()
