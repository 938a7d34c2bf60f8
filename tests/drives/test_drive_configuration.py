"""What machine files say of drives on CAN, and what is refused with a remedy."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mcserver.drives.can_bus import CanBus
from mcserver.drives.registry import VIRTUAL_FACTORIES, create_buses
from mcserver.drives.simulated import SimulatedBus
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import Machine, parse_machine

GOOD = 'kind = "cia402"\nbus = "can0"\nnode = 1\ncounts_per_motor_rev = 4096'

TORQUE = '\nmode = "cst"\nrated_torque = 1.0\ninertia = 2e-4'

ROTARY = (
    '\n[[axis]]\nindex = {index}\ntype = "rotary"\nmax_velocity = 1.0\nmax_acceleration = 1.0\n[axis.drive]\n'
)


def machine(drive: str = GOOD, axis: str = "", top: str = "", folder: Path | None = None) -> Machine:
    text = f'[machine]\nname = "m"\ncycle_hz = 500.0\n{top}\n[[axis]]\nindex = 0\ntype = "linear"\n'
    text += f"max_velocity = 100.0\nmax_acceleration = 1000.0\n{axis or 'units_per_motor_rev = 10.0'}\n"
    return parse_machine(f"{text}[axis.drive]\n{drive}\n", folder=folder)


def refusal(drive: str, axis: str = "", top: str = "") -> tuple[str, str, str]:
    with pytest.raises(ConfigurationError) as refused:
        machine(drive, axis, top)
    return refused.value.code, refused.value.message, refused.value.hint


@pytest.mark.parametrize(
    ("drive", "key", "remedy"),
    [
        ('kind = "cia402"\nnode = 1\ncounts_per_motor_rev = 4', "bus", "can0"),
        ('kind = "cia402"\nbus = "can0"\ncounts_per_motor_rev = 4', "node", "node number"),
        ('kind = "cia402"\nbus = "can0"\nnode = 128\ncounts_per_motor_rev = 4', "node", "node number"),
        ('kind = "cia402"\nbus = "can0"\nnode = 1', "counts_per_motor_rev", "608Fh"),
        (GOOD + "\nencoder = [4096, 1]", "encoder", "one of them"),
        (GOOD + "\ngear = [0, 1]", "gear", "invert"),
        (GOOD + "\nfeed = [3.0, 1]", "feed", "leave one of them out"),
        (GOOD + '\nmode = "cst"\ninertia = 1e-4', "rated_torque", "6076h"),
        (GOOD + '\nmode = "cst"\nrated_torque = 1.0', "inertia", "motor's shaft"),
        (GOOD + TORQUE, "mode", "max_following_error"),
        (GOOD + "\nvelocity_gain = 0.01", "velocity_gain", "leave it out"),
        (GOOD + '\nmode = "csv"\nposition_gain = 500.0', "position_gain", "100 or less"),
        (GOOD + "\nrated_torque = -1.0", "rated_torque", "leave the key out"),
        (GOOD + "\nheartbeat_ms = 70000", "heartbeat_ms", "100"),
        (GOOD + "\ncommand_timeout_ms = 2", "command_timeout_ms", "10 cycles"),
        (GOOD + "\nsdo_writes = [[1, 2]]", "sdo_writes", "[index, subindex, value]"),
        (GOOD + "\ncodes = { off = 1 }", "codes", "servosila"),
        ('kind = "servosila"\nbus = "can0"\nnode = 1\ncounts_per_motor_rev = 4', "codes", "off"),
        (
            'kind = "servosila"\nbus = "can0"\nnode = 1\ncounts_per_motor_rev = 4\ncodes = { of = 1 }',
            "codes",
            "did you mean 'off'?",
        ),
    ],
)
def test_a_section_that_lacks_or_contradicts_something_is_refused(drive: str, key: str, remedy: str) -> None:
    code, message, hint = refusal(drive)
    assert code == "MC004"
    assert f"axis[0].drive.{key}" in message
    assert remedy in hint


@pytest.mark.parametrize(
    ("keys", "key", "remedy"),
    [
        ("velocity_gain = 0.03", "velocity_gain", "0.02 or less"),
        ("position_gain = 36.0", "position_gain", "17.5 or less"),
        ("integral_time_s = 0.1", "integral_time_s", "0.2 s or more"),
        ("max_torque = 40.0", "max_torque", "data sheet"),
    ],
)
def test_gains_of_a_torque_loop_that_are_not_stable_are_refused(keys: str, key: str, remedy: str) -> None:
    axis = "units_per_motor_rev = 10.0\nmax_following_error = 1.0"
    code, message, hint = refusal(f"{GOOD}{TORQUE}\n{keys}", axis)
    assert code == "MC004"
    assert f"axis[0].drive.{key}" in message
    assert remedy in hint


def test_gains_of_a_torque_loop_follow_from_inertia_and_cycle() -> None:
    axis = "units_per_motor_rev = 10.0\nmax_following_error = 1.0"
    drive = machine(f"{GOOD}{TORQUE}", axis).axes[0].drive
    # 500 Hz: the velocity part crosses over at 0.1 / 2 ms = 50 /s
    assert drive.velocity_gain == pytest.approx(2e-4 * 50.0)
    assert drive.position_gain == pytest.approx(10.0)
    assert drive.integral_time_s == pytest.approx(0.4)
    assert drive.command_timeout_ms == 20
    assert machine(f"{GOOD}{TORQUE}\nintegral_time_s = 0.0", axis).axes[0].drive.integral_time_s == 0.0


def test_a_linear_axis_has_to_say_how_far_a_turn_goes() -> None:
    code, message, hint = refusal(GOOD, axis="max_jerk = 1e4")
    assert (code, "drive.feed" in message) == ("MC004", True)
    assert "units_per_motor_rev" in hint


def test_travel_beyond_32_bits_of_counts_is_refused() -> None:
    axis = "units_per_motor_rev = 1e-4\nmin_position = -100.0\nmax_position = 100.0"
    code, message, _ = refusal(GOOD, axis=axis)
    assert (code, "beyond 32 bits" in message) == ("MC004", True)


def test_an_address_that_is_none_is_refused_with_its_place() -> None:
    code, message, _ = refusal(GOOD.replace("can0", "pigeon:3"))
    assert (code, "node 1" in message) == ("MC009", True)
    code, message, _ = refusal(GOOD, top='[[bus]]\nname = "left"\naddress = "pigeon:3"')
    assert (code, "bus[0].address" in message) == ("MC009", True)


def test_two_drives_of_a_bus_with_one_node_number_are_refused() -> None:
    second = f"{ROTARY.format(index=1)}{GOOD}"
    code, message, _ = refusal(GOOD + second)
    assert (code, "axes 0 and 1 both have node 1 on bus can0" in message) == ("MC004", True)


def test_one_bus_by_two_names_is_refused() -> None:
    code, _, hint = refusal(GOOD, top='[[bus]]\nname = "left"\naddress = "socketcan:can0"')
    assert (code, hint) == ("MC004", "use its name")


def test_a_bus_has_a_name_an_address_and_a_bit_rate() -> None:
    top = '[[bus]]\nname = "left"\naddress = "socketcand:127.0.0.1:29536/can0"\nbitrate = 500000'
    described = machine(GOOD.replace("can0", "left"), top=top)
    (bus,) = described.buses
    assert (bus.name, bus.address, bus.bitrate) == ("left", "socketcand:127.0.0.1:29536/can0", 500_000)
    assert described.bus_of(described.axes[0]) is bus


def test_what_follows_from_other_keys_is_filled_in() -> None:
    drive = machine(GOOD + "\ngear = [5, 1]").axes[0].drive
    assert (drive.encoder, drive.gear, drive.feed) == ((4096, 1), (5, 1), (50.0, 1.0))
    assert drive.command_timeout_ms == 100
    axis = machine(GOOD + "\nfeed = [20.0, 1]\ngear = [4, 1]", axis="max_jerk = 1e4").axes[0]
    assert axis.travel_per_motor_turn == pytest.approx(0.005)


def test_an_eds_file_is_looked_for_beside_the_machine_file(tmp_path: Path) -> None:
    drive = machine(GOOD + '\neds = "drive.eds"', folder=tmp_path).axes[0].drive
    assert drive.eds == str(tmp_path / "drive.eds")


def test_drives_of_both_kinds_share_a_bus_and_every_bus_has_its_own_port() -> None:
    servosila = 'kind = "servosila"\ncounts_per_motor_rev = 4096\ncodes = { off = 2 }\n'
    text = '[machine]\nname = "m"\ncycle_hz = 200.0\n'
    for index, (kind, bus) in enumerate([(0, "can0"), (1, "can0"), (0, "can1")]):
        text += ROTARY.format(index=index)
        section = servosila if kind else 'kind = "cia402"\ncounts_per_motor_rev = 4096\n'
        text += f'{section}bus = "{bus}"\nnode = {index + 1}\n'
    buses = create_buses(parse_machine(text))
    assert [bus.columns for bus in buses] == [(0, 1), (2,)]
    assert all(isinstance(bus, CanBus) and bus.port is None for bus in buses)


def test_on_a_virtual_clock_drives_on_can_are_simulated() -> None:
    (bus,) = create_buses(machine(), VIRTUAL_FACTORIES)
    assert isinstance(bus, SimulatedBus)


def test_the_example_of_the_documentation_is_a_machine() -> None:
    document = (Path(__file__).parents[2] / "docs" / "canopen.md").read_text("utf-8")
    text, *others = re.findall(r"```toml\n(.*?)```", document, re.DOTALL)
    for index, drive in enumerate(others, 1):
        travel = "min_position = -90.0\nmax_position = 90.0\n"
        text += ROTARY.format(index=index).replace("[axis.drive]\n", travel) + drive
    axes = parse_machine(text).axes
    assert [axis.drive.kind for axis in axes] == ["cia402", "servosila", "damiao", "robstride"]
