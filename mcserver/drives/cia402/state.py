"""The power drive state machine of CiA 402: what a statusword says, and which controlword comes next.

IEC 61800-7-201, 6.3: figure 8 (states), tables 26 (controlword) and 30 (statusword).
"""

from __future__ import annotations

import enum
from types import MappingProxyType

from mcserver.drives.bus import DriveMode


class PowerState(enum.IntEnum):
    """States of the power drive system."""

    NOT_READY = 0
    SWITCH_ON_DISABLED = 1
    READY_TO_SWITCH_ON = 2
    SWITCHED_ON = 3
    OPERATION_ENABLED = 4
    QUICK_STOP_ACTIVE = 5
    FAULT_REACTION = 6
    FAULT = 7


class Controlword(enum.IntEnum):
    """Commands as whole controlwords, all mode-specific bits 0."""

    DISABLE_VOLTAGE = 0x0000
    QUICK_STOP = 0x0002
    SHUTDOWN = 0x0006
    SWITCH_ON = 0x0007
    ENABLE_OPERATION = 0x000F
    FAULT_RESET = 0x0080


# Bits of the statusword that tell the state: 0 … 3, 5 (quick stop, active low) and 6.
STATE_BITS = 0x006F
_WARNING = 0x80
# States with power at the motor.
POWERED = frozenset({PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE, PowerState.FAULT_REACTION})
FAULTY = frozenset({PowerState.FAULT_REACTION, PowerState.FAULT})

# (mask, value, state), table 30 of the standard.
_MASKS = (
    (0x004F, 0x0000, PowerState.NOT_READY),
    (0x004F, 0x0040, PowerState.SWITCH_ON_DISABLED),
    (0x006F, 0x0021, PowerState.READY_TO_SWITCH_ON),
    (0x006F, 0x0023, PowerState.SWITCHED_ON),
    (0x006F, 0x0027, PowerState.OPERATION_ENABLED),
    (0x006F, 0x0007, PowerState.QUICK_STOP_ACTIVE),
    (0x004F, 0x000F, PowerState.FAULT_REACTION),
    (0x004F, 0x0008, PowerState.FAULT),
)


def power_state(statusword: int) -> PowerState:
    """Return the state that a statusword tells; a pattern that the standard does not have counts as not
    ready.
    """
    for mask, value, state in _MASKS:
        if statusword & mask == value:
            return state
    return PowerState.NOT_READY


def power_text(statusword: int) -> str:
    """Return the state that a statusword tells in words, and whether it warns."""
    state = power_state(statusword).name.lower().replace("_", " ")
    return state + (", warning" if statusword & _WARNING else "")


# By statusword & STATE_BITS.
STATE_OF_BITS = tuple(power_state(bits) for bits in range(STATE_BITS + 1))

# What energizes, one transition after the other (2, 3, 4); from a quick stop only through off (12).
_ENERGIZE = MappingProxyType(
    {
        PowerState.SWITCH_ON_DISABLED: Controlword.SHUTDOWN,
        PowerState.READY_TO_SWITCH_ON: Controlword.SWITCH_ON,
        PowerState.SWITCHED_ON: Controlword.ENABLE_OPERATION,
        PowerState.OPERATION_ENABLED: Controlword.ENABLE_OPERATION,
    }
)


def next_controlword(
    state: PowerState, wanted: DriveMode, previous: int, *, in_mode: bool = True, standing: bool = False
) -> int:
    """Return the controlword for what is wanted.

    Args:
        previous: the controlword before; a fault is reset by a rising edge of bit 7.
        in_mode: whether 6061h shows the mode of operation that is wanted, or shows none until it is enabled;
            operation is not enabled without.
        standing: whether the motor stands, for `DriveMode.STOP`.
    """
    if wanted is DriveMode.SILENT:
        return previous
    if wanted is DriveMode.RESET:
        return Controlword.FAULT_RESET if state is PowerState.FAULT else Controlword.DISABLE_VOLTAGE
    if wanted is DriveMode.STOP:
        stopping = state in (PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE)
        if stopping and not (standing and state is PowerState.QUICK_STOP_ACTIVE):
            return Controlword.QUICK_STOP
        return Controlword.DISABLE_VOLTAGE
    if wanted < DriveMode.POSITION:
        return Controlword.DISABLE_VOLTAGE
    command = _ENERGIZE.get(state, Controlword.DISABLE_VOLTAGE)
    if command is Controlword.ENABLE_OPERATION and not in_mode:
        return Controlword.SWITCH_ON
    return command
