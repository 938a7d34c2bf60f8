"""Statuswords and controlwords by the tables of IEC 61800-7-201."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.drives.bus import DriveMode
from mcserver.drives.cia402.emergency_codes import emergency_text, unpack_emergency
from mcserver.drives.cia402.state import (
    STATE_BITS,
    STATE_OF_BITS,
    Controlword,
    PowerState,
    next_controlword,
    power_state,
)

ENERGIZING = (DriveMode.POSITION, DriveMode.VELOCITY, DriveMode.TORQUE)


@pytest.mark.parametrize(
    ("statusword", "state"),
    [
        (0x0000, PowerState.NOT_READY),
        (0x0250, PowerState.SWITCH_ON_DISABLED),
        (0x0270, PowerState.SWITCH_ON_DISABLED),
        (0x0231, PowerState.READY_TO_SWITCH_ON),
        (0x0233, PowerState.SWITCHED_ON),
        (0x0237, PowerState.OPERATION_ENABLED),
        (0x1637, PowerState.OPERATION_ENABLED),
        (0x0217, PowerState.QUICK_STOP_ACTIVE),
        (0x021F, PowerState.FAULT_REACTION),
        (0x023F, PowerState.FAULT_REACTION),
        (0x0218, PowerState.FAULT),
        (0x0238, PowerState.FAULT),
    ],
)
def test_a_statusword_tells_its_state(statusword: int, state: PowerState) -> None:
    assert power_state(statusword) is state


@given(st.integers(0, 0xFFFF))
def test_only_the_state_bits_count(statusword: int) -> None:
    assert power_state(statusword) is STATE_OF_BITS[statusword & STATE_BITS]


@pytest.mark.parametrize(
    ("state", "controlword"),
    [
        (PowerState.NOT_READY, Controlword.DISABLE_VOLTAGE),
        (PowerState.SWITCH_ON_DISABLED, Controlword.SHUTDOWN),
        (PowerState.READY_TO_SWITCH_ON, Controlword.SWITCH_ON),
        (PowerState.SWITCHED_ON, Controlword.ENABLE_OPERATION),
        (PowerState.OPERATION_ENABLED, Controlword.ENABLE_OPERATION),
        (PowerState.QUICK_STOP_ACTIVE, Controlword.DISABLE_VOLTAGE),
        (PowerState.FAULT_REACTION, Controlword.DISABLE_VOLTAGE),
        (PowerState.FAULT, Controlword.DISABLE_VOLTAGE),
    ],
)
def test_an_axis_is_energized_one_transition_after_the_other(
    state: PowerState, controlword: Controlword
) -> None:
    assert {next_controlword(state, mode, 0) for mode in ENERGIZING} == {controlword}


@given(st.sampled_from(PowerState), st.sampled_from(ENERGIZING), st.integers(0, 0xFFFF))
def test_operation_is_never_enabled_in_another_mode(
    state: PowerState, wanted: DriveMode, previous: int
) -> None:
    assert next_controlword(state, wanted, previous, in_mode=False) & 0x0F != 0x0F


@given(st.sampled_from(PowerState), st.sampled_from(DriveMode), st.booleans())
def test_bit_7_is_set_for_a_reset_of_a_fault_alone(
    state: PowerState, wanted: DriveMode, standing: bool
) -> None:
    sent = next_controlword(state, wanted, 0, standing=standing)
    assert bool(sent & 0x80) == (wanted is DriveMode.RESET and state is PowerState.FAULT)


@given(st.sampled_from(PowerState), st.booleans())
def test_off_disables_the_voltage_in_every_state(state: PowerState, standing: bool) -> None:
    assert next_controlword(state, DriveMode.OFF, 0xF, standing=standing) == Controlword.DISABLE_VOLTAGE


def test_stop_is_a_quick_stop_until_the_motor_stands() -> None:
    states = (PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE)
    assert [next_controlword(state, DriveMode.STOP, 0xF) for state in states] == [Controlword.QUICK_STOP] * 2
    after = next_controlword(PowerState.QUICK_STOP_ACTIVE, DriveMode.STOP, 0x2, standing=True)
    assert after == Controlword.DISABLE_VOLTAGE


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (0x8611, "following error"),
        (0x2312, "current at the device's output"),
        (0x2800, "current"),
        (0xFF12, "device specific"),
        (0x0000, "no error any more"),
        (0x0100, "of the manufacturer"),
    ],
)
def test_an_emergency_code_has_a_meaning_as_far_as_the_standard_goes(code: int, text: str) -> None:
    assert emergency_text(code) == text


def test_an_emergency_message_that_is_too_short_is_none() -> None:
    assert unpack_emergency(b"\x11\x86\x20" + bytes(5)) == (0x8611, 0x20)
    assert unpack_emergency(b"\x11\x86") is None
