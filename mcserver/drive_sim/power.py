"""The power state machine of a drive (CiA 402-2, clause 6): controlword 6040h in, state of 6041h out."""

from __future__ import annotations

import enum
from typing import NamedTuple

SWITCH_ON = 1 << 0
ENABLE_VOLTAGE = 1 << 1
# active low
QUICK_STOP = 1 << 2
ENABLE_OPERATION = 1 << 3
FAULT_RESET = 1 << 7
HALT = 1 << 8
COMMAND = SWITCH_ON | ENABLE_VOLTAGE | QUICK_STOP | ENABLE_OPERATION

VOLTAGE_ENABLED = 1 << 4
REMOTE = 1 << 9
TARGET_REACHED = 1 << 10
INTERNAL_LIMIT = 1 << 11
MODE_BIT_12 = 1 << 12
MODE_BIT_13 = 1 << 13
# Quick stop option codes that stay in quick stop active (605Ah).
STAYING = (5, 6, 7, 8)


class PowerState(enum.Enum):
    """States, with the bits 0 … 3, 5 and 6 that a statusword shows them by."""

    NOT_READY = 0x0000
    SWITCH_ON_DISABLED = 0x0040
    READY_TO_SWITCH_ON = 0x0021
    SWITCHED_ON = 0x0023
    OPERATION_ENABLED = 0x0027
    QUICK_STOP_ACTIVE = 0x0007
    FAULT_REACTION_ACTIVE = 0x000F
    FAULT = 0x0008


class Stop(enum.Enum):
    """How a drive comes to rest before its power stage goes off."""

    NONE = 0
    PROFILE_RAMP = 1
    QUICK_RAMP = 2


class PowerMachine:
    """One drive's states. Ramps are the motion's: `stopping` says which is asked for, `stopped` ends it.

    Attributes:
        energize_s: from the command until switched on, and again until operation is enabled.
    """

    def __init__(self, energize_s: float) -> None:
        self.state = PowerState.NOT_READY
        self.energize_s = energize_s
        self.stopping = Stop.NONE
        self._after_stop = PowerState.SWITCH_ON_DISABLED
        self._controlword = 0
        self._since: float | None = None

    @property
    def energized(self) -> bool:
        """Whether the motor has current."""
        return self.state in (
            PowerState.OPERATION_ENABLED,
            PowerState.QUICK_STOP_ACTIVE,
            PowerState.FAULT_REACTION_ACTIVE,
        )

    @property
    def waiting(self) -> bool:
        """Whether time alone will change the state."""
        return self._since is not None

    def reset(self) -> None:
        """As after switching on."""
        self.state = PowerState.SWITCH_ON_DISABLED
        self.stopping = Stop.NONE
        self._controlword = 0
        self._since = None

    def command(self, controlword: int, now: float, options: Options) -> bool:
        """Obey a controlword, held or new; whether a fault is to be reset (rising edge of bit 7, in FAULT).

        Switching on and enabling take `energize_s` each, in which the command has to be held.
        """
        rising = controlword & ~self._controlword
        self._controlword = controlword
        if self.state is PowerState.FAULT:
            self._since = None
            return bool(rising & FAULT_RESET)
        if self.state is PowerState.FAULT_REACTION_ACTIVE or self.state is PowerState.NOT_READY:
            return False
        before = self.state
        self._obey(controlword & COMMAND, now, options)
        if self.state is not before and self.state is PowerState.SWITCHED_ON:
            # a command to enable operation goes on from here
            self._obey(controlword & COMMAND, now, options)
        return False

    def _obey(self, command: int, now: float, options: Options) -> None:
        state = self.state
        voltage = bool(command & ENABLE_VOLTAGE)
        quick_stop = voltage and not command & QUICK_STOP
        on = voltage and not quick_stop and bool(command & SWITCH_ON)
        enable = on and bool(command & ENABLE_OPERATION)
        if state is PowerState.SWITCH_ON_DISABLED:
            if voltage and not quick_stop and not on:
                self._go(PowerState.READY_TO_SWITCH_ON)
        elif state is PowerState.READY_TO_SWITCH_ON:
            if not voltage or quick_stop:
                self._go(PowerState.SWITCH_ON_DISABLED)
            elif not on:
                self._since = None
            elif self._elapsed(now):
                self._go(PowerState.SWITCHED_ON)
        elif state is PowerState.SWITCHED_ON:
            if not voltage or quick_stop:
                self._go(PowerState.SWITCH_ON_DISABLED)
            elif not on:
                self._go(PowerState.READY_TO_SWITCH_ON)
            elif not enable:
                self._since = None
            elif self._elapsed(now):
                self._go(PowerState.OPERATION_ENABLED)
        elif state is PowerState.OPERATION_ENABLED:
            self._obey_enabled(voltage, quick_stop, on, enable, options)
        elif state is PowerState.QUICK_STOP_ACTIVE:
            if not voltage:
                self._go(PowerState.SWITCH_ON_DISABLED)
            elif enable and options.quick_stop in STAYING:
                self._go(PowerState.OPERATION_ENABLED)

    def _obey_enabled(
        self, voltage: bool, quick_stop: bool, on: bool, enable: bool, options: Options
    ) -> None:
        if not voltage:
            self._go(PowerState.SWITCH_ON_DISABLED)
        elif quick_stop:
            self.quick_stop(options)
        elif not on:
            self._ramp_down(options.shutdown, PowerState.READY_TO_SWITCH_ON)
        elif not enable:
            self._ramp_down(options.disable_operation, PowerState.SWITCHED_ON)
        else:
            self.stopping = Stop.NONE

    def quick_stop(self, options: Options) -> None:
        """Transition 11, by the option code 605Ah."""
        if options.quick_stop == 0:
            self._go(PowerState.SWITCH_ON_DISABLED)
            return
        self._go(PowerState.QUICK_STOP_ACTIVE)
        slow = options.quick_stop in (1, 5)
        self.stopping = Stop.PROFILE_RAMP if slow else Stop.QUICK_RAMP
        self._after_stop = PowerState.SWITCH_ON_DISABLED
        if options.quick_stop in STAYING:
            self._after_stop = PowerState.QUICK_STOP_ACTIVE

    def fault(self, options: Options) -> None:
        """Transition 13, by the option code 605Eh."""
        if self.state in (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE):
            return
        ramps = self.energized and options.fault_reaction != 0
        self._go(PowerState.FAULT_REACTION_ACTIVE if ramps else PowerState.FAULT)
        if ramps:
            self.stopping = Stop.PROFILE_RAMP if options.fault_reaction == 1 else Stop.QUICK_RAMP
            self._after_stop = PowerState.FAULT

    def disable_voltage(self) -> None:
        """The power stage goes off at once, without a fault."""
        if self.state not in (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE):
            self._go(PowerState.SWITCH_ON_DISABLED)

    def acknowledge(self) -> None:
        """Transition 15: the fault is reset."""
        self._go(PowerState.SWITCH_ON_DISABLED)

    def stopped(self) -> None:
        """The ramp that `stopping` asked for has come to rest."""
        if self.stopping is not Stop.NONE:
            self._go(self._after_stop)

    def _ramp_down(self, option: int, after: PowerState) -> None:
        if option == 0:
            self._go(after)
            return
        self.stopping = Stop.PROFILE_RAMP
        self._after_stop = after

    def _elapsed(self, now: float) -> bool:
        if self._since is None:
            self._since = now
        return now - self._since >= self.energize_s - 1e-9

    def _go(self, state: PowerState) -> None:
        self.state = state
        self.stopping = Stop.NONE
        self._since = None


class Options(NamedTuple):
    """Option codes as they stand in the dictionary (605Ah, 605Bh, 605Ch, 605Eh)."""

    quick_stop: int
    shutdown: int
    disable_operation: int
    fault_reaction: int
