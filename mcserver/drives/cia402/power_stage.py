"""One drive between off and energized: its command in each cycle, and the state that is reported of it.

A drive is energized in steps that it has to show one by one. Until it shows operation enabled in the wanted
mode, it is *capturing*: its target is where it is. Anything else in between is a latched fault, or the loss
of the axis; neither is ever left without a command from above.

A statusword says nothing about a command that is younger than it: for `ANSWER_CYCLES` after a command only
the state that the command leads to counts, and a TPDO that stays out takes no command back. A slow drive is
waited for.
"""

from __future__ import annotations

import enum
from types import MappingProxyType

from mcserver.can.pdo_layout import Mode
from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from mcserver.drives.cia402.state import (
    FAULTY,
    POWERED,
    Controlword,
    PowerState,
    next_controlword,
)

# A statusword that comes so many cycles after a command is an answer to it (RPDO, SYNC, TPDO); an older one
# does not count.
ANSWER_CYCLES = 3
# Exchanges after which another rising edge of bit 7 is made, if the fault is still there.
RESET_RETRY_CYCLES = 20
# A drive changes its mode of operation within this time [s].
MODE_CHANGE_S = 0.25


# The state that each command of the sequence leads to.
_LEADS_TO = MappingProxyType(
    {
        int(Controlword.DISABLE_VOLTAGE): PowerState.SWITCH_ON_DISABLED,
        int(Controlword.SHUTDOWN): PowerState.READY_TO_SWITCH_ON,
        int(Controlword.SWITCH_ON): PowerState.SWITCHED_ON,
        int(Controlword.ENABLE_OPERATION): PowerState.OPERATION_ENABLED,
    }
)


# Statusword in homing mode: homing error; homing attained and target reached (CiA 402).
HOMING_ERROR = 0x2000
HOMING_ATTAINED = 0x1400
HOMING_ANSWER_CYCLES = 2 * ANSWER_CYCLES


class Phase(enum.IntEnum):
    """How far energizing has come."""

    IDLE = 0
    SETTLING = 1  # old answers are let pass
    ENABLING = 2
    RUNNING = 3
    LOST = 4  # de-energized by itself; nothing more until another command


class PowerStage:
    """State of one axis.

    Args:
        base: the mode of operation for positions. modes: commanded mode → mode of operation; what is missing
            cannot be driven.

    Attributes:
        controlword: for the next RPDOs. mode: for 6060h. capturing: the target is the actual position.
        changing: 6061h does not show the mode yet. fault: latched; detail: the vendor's number for it.
        settled: nothing will change unless the answers or the commands do.
        started: interpolation, or homing, is under way by bit 4 of the controlword.
    """

    def __init__(
        self, base: Mode, modes: dict[DriveMode, Mode], cycle_s: float, homing_s: float = 0.0
    ) -> None:
        self._homing_patience = max(1, round(homing_s / cycle_s))
        self._homing_cycles = 0
        self._was_homing = False
        self._word = 0
        self.started = False
        self._modes = modes
        self._mode_patience = max(ANSWER_CYCLES, round(MODE_CHANGE_S / cycle_s))
        self._commanded = DriveMode.OFF
        self._since = ANSWER_CYCLES
        self._since_command = ANSWER_CYCLES
        self._unheard = 0
        self._phase = Phase.IDLE
        self._unlike = 0
        self._switching = False
        self._without_mode = 0
        self.mode = base
        self.controlword: int = Controlword.DISABLE_VOLTAGE
        self.capturing = True
        self.changing = False
        self.settled = False
        self.fault = DriveFault.NONE
        self.detail = 0

    @property
    def commanded(self) -> DriveMode:
        return self._commanded

    @property
    def running(self) -> bool:
        """Whether the drive has been found energized in its mode."""
        return self._phase is Phase.RUNNING

    def fail(self, fault: DriveFault, detail: int = 0) -> bool:
        """Latch a fault; False: one is latched already, or nobody commands the drive (G1011)."""
        if self.fault is not DriveFault.NONE or self._commanded is DriveMode.SILENT:
            return False
        self.fault = fault
        self.detail = detail
        self.settled = False
        return True

    def step(
        self,
        commanded: DriveMode,
        power: PowerState,
        shown: int,
        *,
        fresh: bool,
        standing: bool,
        word: int = 0,
    ) -> DriveState:
        """One cycle.

        Args:
            power, shown: of the latest TPDO1: state and 6061h. fresh: it came in this cycle.
            standing: the motor does not turn. word: the whole statusword, for homing.

        Returns:
            What is reported upwards; `controlword`, `mode`, `capturing` and `changing` hold what is sent.
        """
        before = (self._phase, self._commanded, self.controlword, self.changing, self.fault)
        if commanded is not self._commanded:
            self._change(commanded)
        else:
            self._since += 1
        self.changing = False
        self._word = word
        if commanded is DriveMode.RESET:
            state = self._reset(power, fresh)
        else:
            if power in FAULTY and fresh:
                self.fail(DriveFault.OTHER)
            state = self._energize(power, shown, fresh) if commanded >= DriveMode.POSITION else DriveState.OFF
            if commanded < DriveMode.POSITION:
                state = self._rest(power, standing)
        self._since_command = 0 if self.controlword != before[2] else self._since_command + 1
        # in the cycle in which it is found energized its reading goes upwards, and is its target, too
        self.capturing = self._phase is not Phase.RUNNING or before[0] is not Phase.RUNNING
        if commanded is DriveMode.HOMING or self._was_homing:
            # the drive moves by itself, and what it shows afterwards is where it is
            self.capturing = True
        self.started = self._phase is Phase.RUNNING and before[0] is Phase.RUNNING and not self.changing
        after = (self._phase, self._commanded, self.controlword, self.changing, self.fault)
        steady = self._since > ANSWER_CYCLES and self._phase in (Phase.IDLE, Phase.RUNNING, Phase.LOST)
        self.settled = steady and before == after and not self.changing and fresh
        if commanded in (DriveMode.STOP, DriveMode.RESET) and state is not DriveState.OFF:
            self.settled = False
        if (
            state is DriveState.HOMING
            or self._was_homing
            or (self.capturing and state is DriveState.ENERGIZED)
        ):
            self.settled = False
        return state

    def _change(self, commanded: DriveMode) -> None:
        energized = self._commanded >= DriveMode.POSITION and commanded >= DriveMode.POSITION
        self._was_homing = energized and self._commanded is DriveMode.HOMING
        self._homing_cycles = 0
        self._commanded = commanded
        self._since = 0
        if commanded < DriveMode.POSITION:
            self._phase = Phase.IDLE
            return
        mode = self._modes.get(commanded)
        if mode is None:
            self.fail(DriveFault.NOT_CONFIGURED, int(commanded))
            return
        if mode is not self.mode:
            self.mode = mode
            self._switching = True
        if not energized:
            self._phase = Phase.SETTLING
            self._unlike = 0
            self._without_mode = 0

    # ------------------------------------------------------------------ not energized

    def _reset(self, power: PowerState, fresh: bool) -> DriveState:
        if fresh:
            self.fault = DriveFault.NONE
            self.detail = 0
        wanted = DriveMode.RESET
        if self._since % RESET_RETRY_CYCLES == 0:
            # bit 7 falls, so that it can rise
            wanted = DriveMode.OFF
        self.controlword = next_controlword(power, wanted, self.controlword)
        if not fresh or power in FAULTY or power is PowerState.NOT_READY:
            return DriveState.FAULT
        if self._since < ANSWER_CYCLES or power in POWERED:
            return DriveState.STOPPING
        return DriveState.OFF

    def _rest(self, power: PowerState, standing: bool) -> DriveState:
        """Commanded `OFF`, `STOP` or `SILENT`."""
        commanded = self._commanded
        self.controlword = (
            Controlword.DISABLE_VOLTAGE
            if commanded is DriveMode.SILENT
            else next_controlword(power, commanded, self.controlword, standing=standing)
        )
        if self.fault is not DriveFault.NONE:
            return DriveState.FAULT
        if self._since < ANSWER_CYCLES or power in POWERED:
            return DriveState.STOPPING
        return DriveState.OFF

    # ------------------------------------------------------------------ energized

    def _energize(self, power: PowerState, shown: int, fresh: bool) -> DriveState:
        if self.fault is not DriveFault.NONE:
            self._phase = Phase.LOST
            self.controlword = Controlword.DISABLE_VOLTAGE
            return DriveState.FAULT
        if self._phase is Phase.SETTLING:
            self.controlword = Controlword.SHUTDOWN
            # one that still shows power obeys an earlier command: what it shows would end soon
            if self._since >= ANSWER_CYCLES and fresh and power not in POWERED:
                self._phase = Phase.ENABLING
                self._unheard = 0
            return DriveState.STARTING
        if self._phase is Phase.ENABLING:
            return self._enable(power, shown, fresh)
        if self._phase is Phase.RUNNING:
            return self._run(power, shown, fresh)
        self.controlword = Controlword.DISABLE_VOLTAGE
        return DriveState.OFF

    def _enable(self, power: PowerState, shown: int, fresh: bool) -> DriveState:
        enabling = self.controlword == Controlword.ENABLE_OPERATION
        if not fresh:
            self._unheard += 1
            if enabling and self._unheard > ANSWER_CYCLES:
                # where the axis is has not been known for too long to close a loop there
                self.controlword = Controlword.SHUTDOWN
                self._phase = Phase.SETTLING
                self._since = 0
            return DriveState.STARTING
        self._unheard = 0
        in_mode = shown == self.mode
        if power is PowerState.OPERATION_ENABLED and in_mode and enabling:
            self._phase = Phase.RUNNING
            return DriveState.ENERGIZED
        in_mode = in_mode or self._hides_its_mode(power, shown)
        if self._without_mode > 2 * self._mode_patience and self.fail(DriveFault.MODE, shown):
            self._phase = Phase.LOST
            self.controlword = Controlword.DISABLE_VOLTAGE
            return DriveState.FAULT
        wanted = next_controlword(power, self._commanded, self.controlword, in_mode=in_mode)
        if not self._takes_back(wanted, power, in_mode):
            self.controlword = wanted
        return DriveState.STARTING

    def _hides_its_mode(self, power: PowerState, shown: int) -> bool:
        """Tell a drive that shows no mode (0) until it is enabled from one that is slow to change it.

        Its targets are where it is, at rest and without torque in every mode, so it may be enabled for as
        long as a change of mode may take; another mode than the wanted one is never enabled.
        """
        if shown != Mode.NONE:
            self._without_mode = 0
        elif power in (PowerState.SWITCHED_ON, PowerState.OPERATION_ENABLED):
            self._without_mode += 1
        return self._without_mode > self._mode_patience

    def _takes_back(self, wanted: int, power: PowerState, in_mode: bool) -> bool:
        """Tell a drive that is slow, or a statusword older than the command, from one that has to start
        over."""
        if _LEADS_TO.get(wanted, PowerState.NOT_READY) >= _LEADS_TO.get(
            self.controlword, PowerState.NOT_READY
        ):
            return False
        if power is PowerState.NOT_READY or self._since_command < ANSWER_CYCLES:
            return True
        under_way = power in (PowerState.READY_TO_SWITCH_ON, PowerState.SWITCHED_ON)
        return under_way and (in_mode or self.controlword == Controlword.SWITCH_ON)

    def _run(self, power: PowerState, shown: int, fresh: bool) -> DriveState:
        if not fresh:
            if self._commanded is DriveMode.HOMING:
                return DriveState.HOMING
            return DriveState.STARTING if self._was_homing else DriveState.ENERGIZED
        if power is not PowerState.OPERATION_ENABLED:
            self._phase = Phase.LOST
            self.controlword = Controlword.DISABLE_VOLTAGE
            return DriveState.OFF
        self.changing = shown != self.mode
        self._switching = self._switching and self.changing
        self._unlike = self._unlike + 1 if self.changing else 0
        if self._commanded is DriveMode.HOMING and not self.changing:
            return self._home()
        if self._was_homing:
            self._was_homing = self.changing
        patience = self._mode_patience if self._switching else ANSWER_CYCLES
        if self._unlike >= patience and self.fail(DriveFault.MODE, shown):
            self._phase = Phase.LOST
            self.controlword = Controlword.DISABLE_VOLTAGE
            return DriveState.FAULT
        if self._was_homing:
            return DriveState.STARTING
        return DriveState.ENERGIZED

    def _home(self) -> DriveState:
        """Mode 6 with bit 4 set: homing attained (bits 10 and 12), homing error (bit 13), or under way."""
        self._homing_cycles += 1
        if self._homing_cycles <= HOMING_ANSWER_CYCLES:
            # what is shown may be of the mode before, or of an earlier homing
            return DriveState.HOMING
        failed = bool(self._word & HOMING_ERROR) or self._homing_cycles > self._homing_patience
        if failed and self.fail(DriveFault.HOMING_FAILED, self._word):
            self._phase = Phase.LOST
            self.controlword = Controlword.DISABLE_VOLTAGE
            return DriveState.FAULT
        if self._word & HOMING_ATTAINED == HOMING_ATTAINED:
            return DriveState.HOMED
        return DriveState.HOMING
