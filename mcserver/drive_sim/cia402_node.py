"""One simulated CiA 402 drive: a CANopen node whose application is a power stage with a motor.

Between SYNCs the motor moves by the interpolation period 60C2h, as in a drive whose clock is locked to the
SYNC; without SYNC, and on profiles of its own (pp), it moves by the time that passes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction

from mcserver.can.pdo_layout import Mode
from mcserver.drive_sim.canopen_node import NEVER, CanopenNode, Transmit
from mcserver.drive_sim.described import Identity, add_objects, described, identity_of
from mcserver.drive_sim.fault_injection import Misbehaviour, values_of
from mcserver.drive_sim.motion import Motion
from mcserver.drive_sim.motor import Hardware, Motor
from mcserver.drive_sim.power import (
    INTERNAL_LIMIT,
    MODE_BIT_12,
    MODE_BIT_13,
    REMOTE,
    TARGET_REACHED,
    VOLTAGE_ENABLED,
    Options,
    PowerMachine,
    PowerState,
    Stop,
)
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.machine.axis import Axis
from mcserver.machine.machine_file import Machine

# Step of the motor while no SYNC comes [s].
TICK_S = 0.01
# Without a SYNC for so many of its periods, and at least this time [s], the drive goes by its own clock.
UNLOCKED_PERIODS = 4.0
UNLOCKED_S = 0.05
SHORTEST_PERIOD_S, LONGEST_PERIOD_S = 1e-4, 1.0
FOLLOWING_ERROR = 0x8611
# Motor revolutions that 608Fh counts increments over, at most.
MOST_REVOLUTIONS = 1 << 16
# Bit of 60FDh (CiA 402).
HOME_SWITCH = 1 << 2
CYCLIC = (Mode.CYCLIC_POSITION, Mode.CYCLIC_VELOCITY, Mode.CYCLIC_TORQUE)
# States in which a lost connection changes nothing any more.
RESTING = (
    PowerState.NOT_READY,
    PowerState.SWITCH_ON_DISABLED,
    PowerState.FAULT_REACTION_ACTIVE,
    PowerState.FAULT,
)


class Cia402Node(CanopenNode):
    """One drive; its attributes and services are those of `CanopenNode`."""

    def __init__(
        self,
        node: int,
        transmit: Transmit,
        hardware: Hardware | None = None,
        position: float = 0.0,
        identity: Identity | None = None,
        energize_s: float = 0.02,
    ) -> None:
        """``position`` of the motor [turn]; ``energize_s``: switching on, and enabling, take so long."""
        super().__init__(node, transmit)
        store = self.store
        self.motor = Motor(hardware or Hardware(), position)
        self._equip(identity or Identity())
        self.power = PowerMachine(energize_s)
        self.motion = Motion(store, self.motor)
        self._controlword, self._statusword = store.entry(0x6040), store.entry(0x6041)
        self._error_code = store.entry(0x603F)
        self._period = store.entry(0x60C2, 1), store.entry(0x60C2, 2)
        self._option_entries = [store.entry(index) for index in (0x605A, 0x605B, 0x605C, 0x605E)]
        self._abort_option = store.entry(0x6007)
        self._inputs = store.entry(0x60FD)
        self._outputs, self._output_mask = store.entry(0x60FE, 1), store.entry(0x60FE, 2)
        self._pins = 0
        self._stepped_at = 0.0
        self._synced_at = -math.inf

    def _equip(self, identity: Identity) -> None:
        """Write into the dictionary what the device itself is."""
        rated = max(1, round(self.motor.hardware.rated_torque * 1e3))
        increments = Fraction(self.motor.hardware.increments_per_turn).limit_denominator(MOST_REVOLUTIONS)
        values = {
            (0x1018, 1): identity.vendor_id,
            (0x1018, 2): identity.product_code,
            (0x1018, 3): identity.revision,
            (0x1018, 4): identity.serial_number,
            (0x6076, 0): rated,
            (0x608F, 1): increments.numerator,
            (0x608F, 2): increments.denominator,
        }
        for (index, subindex), value in values.items():
            if value:
                entry = self.store.entry(index, subindex)
                entry.default = entry.value = value

    def request(self, fault: str, request: Mapping[str, object], now: float) -> None:
        """A fault on demand.

        Raises:
            BadRequest: there is no such fault, or a value does not fit.
        """
        values = values_of(request, fault)
        self._now = now
        if self.wrong.begin(fault, values):
            pass
        elif fault == "emcy":
            self.raise_fault(int(values["code"]), fatal=bool(values["fatal"]))
        elif fault == "sdo_abort":
            subindex = None if values["subindex"] < 0 else int(values["subindex"])
            self.sdo.refusals[int(values["index"]), subindex] = int(values["code"])
        elif fault == "reboot":
            self.nmt.reset(now)
        elif fault == "heartbeat_stop":
            self.nmt.beats = False
        elif fault == "following_error":
            self.motor.jammed = not values["trip"]
            if values["trip"]:
                self.raise_fault(FOLLOWING_ERROR)
        elif fault == "ignore_setpoints":
            self.motion.deaf = True
        elif fault == "reverse_torque":
            self.motion.reversed = True
        elif fault == "inputs":
            self._pins = int(values["bits"])
            self._read_inputs()
        else:
            self._behave()
        self.wake = now

    def describe(self) -> dict[str, object]:
        """Return what a test may want to know of the node, beyond what the bus shows."""
        state = self.nmt.state
        more = {
            "sdo_abort": bool(self.sdo.refusals),
            "heartbeat_stop": not self.nmt.beats,
            "following_error": self.motor.jammed,
            "ignore_setpoints": self.motion.deaf,
            "reverse_torque": self.motion.reversed,
        }
        return {
            "node": self.node,
            "kind": "cia402",
            "nmt": "BOOTING" if state is None else state.name,
            "power": self.power.state.name,
            "mode": self.motion.mode,
            "statusword": self._statusword.value,
            "error_code": self._error_code.value,
            "position": self.store.entry(0x6064).value,
            "turns": self.motor.position,
            "turns_per_second": self.motor.velocity,
            "inputs": self._inputs.value,
            "outputs": self._outputs.value & self._output_mask.value,
            "faults": self.wrong.active + [name for name, on in more.items() if on],
        }

    def raise_fault(self, code: int, fatal: bool = True) -> None:
        """An error of the device: reported by EMCY, and where ``fatal`` the drive goes to FAULT."""
        self.emergencies.raise_error(code)
        if fatal:
            self._error_code.value = code
            self.power.fault(self._options())
            self._update_statusword()
        self._touch()

    def _behave(self) -> None:
        """End all faults on demand."""
        self.wrong = Misbehaviour()
        self.sdo.refusals.clear()
        self.nmt.beats = True
        self.motor.jammed = False
        self.motion.deaf = self.motion.reversed = False

    # ------------------------------------------------------------------ cycle

    def sample(self, now: float) -> None:
        self._synced_at = now
        period = self._period_s()
        if self.motion.mode == Mode.PROFILE_POSITION:
            # its own profile runs by its own clock: nobody has to say what a SYNC's period is
            period = min(max(now - self._stepped_at, SHORTEST_PERIOD_S), LONGEST_PERIOD_S)
        self._step(period, now)
        # the SYNC may have been the last one
        self.wake = min(self.wake, self._unlocked())

    def obey(self, now: float) -> None:
        """Controlword, mode and units as they stand in the dictionary."""
        self.motion.rescale()
        if self.wrong.stuck:
            return
        power, motion = self.power, self.motion
        controlword = self._controlword.value
        motion.choose_mode()
        before = power.state
        if power.command(controlword, now, self._options()):
            self.emergencies.clear()
            self._error_code.value = 0
            power.acknowledge()
        if power.state is PowerState.OPERATION_ENABLED:
            if before is not PowerState.OPERATION_ENABLED:
                motion.start()
            motion.command(controlword)
        self._update_statusword()

    def tick(self, now: float) -> float:
        """Step by the passing time where no SYNC does."""
        if not (self.power.energized or self.power.waiting or not self.motor.stands):
            return NEVER
        if self.nmt.talks and now < self._unlocked():
            return self._unlocked()
        passed = now - self._stepped_at
        if passed > 10.0 * TICK_S:
            # it stood until now
            passed = TICK_S
        if passed >= TICK_S * 0.5:
            self._step(passed, now)
            self.obey(now)
        return now + TICK_S

    def reset_application(self, whole: bool) -> None:
        if whole:
            self.power.reset()
            self.motion.mode = Mode.NONE
            self.motion.start()
        self.motion.rescale()
        self.motion.report(0.0)
        self._read_inputs()
        self._update_statusword()

    def connection_lost(self, code: int) -> None:
        """The abort connection option code 6007h acts."""
        power = self.power
        if power.state in RESTING:
            return
        option = self._abort_option.value
        if option == 1:
            self.raise_fault(code)
        elif option == 3 and power.state is PowerState.OPERATION_ENABLED:
            power.quick_stop(self._options())
        elif option == 2 or (option == 3 and power.state is not PowerState.QUICK_STOP_ACTIVE):
            power.disable_voltage()
        self._update_statusword()
        self._touch()

    def _step(self, dt: float, now: float) -> None:
        """Move the motor for a time and take its readings."""
        self._stepped_at = now
        power, motion = self.power, self.motion
        if power.energized:
            if motion.step(dt, self._controlword.value, power.stopping):
                power.stopped()
            if power.state is PowerState.OPERATION_ENABLED and not motion.follows(dt):
                self.raise_fault(FOLLOWING_ERROR)
        else:
            # a shaft that stands, too: nothing is left of torque and demand
            motion.rest(dt)
        motion.report(dt)
        self._read_inputs()
        self._update_statusword()

    def _read_inputs(self) -> None:
        """Show the pins that were asked for, and the home switch by where the shaft is, in 60FDh."""
        word, switch = self._pins, self.motor.hardware.home_switch
        if switch is not None and switch[0] <= self.motor.position <= switch[1]:
            word |= HOME_SWITCH
        self._inputs.value = word

    def _update_statusword(self) -> None:
        power, motion = self.power, self.motion
        word = power.state.value | VOLTAGE_ENABLED | REMOTE
        if power.energized:
            if self.motor.limited or motion.beyond:
                word |= INTERNAL_LIMIT
            if motion.reached:
                word |= TARGET_REACHED
            if motion.mode in CYCLIC:
                if power.state is PowerState.OPERATION_ENABLED and power.stopping is Stop.NONE:
                    word |= MODE_BIT_12
            elif (motion.mode == Mode.PROFILE_POSITION and motion.acknowledged) or motion.interpolating:
                word |= MODE_BIT_12
        if self._error_code.value == FOLLOWING_ERROR:
            word |= MODE_BIT_13
        self._statusword.value = word

    def _unlocked(self) -> float:
        """From when on the motor goes by the passing time, unless a SYNC comes."""
        return self._synced_at + max(UNLOCKED_PERIODS * self._period_s(), UNLOCKED_S)

    def _period_s(self) -> float:
        """Return the interpolation time period 60C2h, within what a motor can be stepped by [s]."""
        value, exponent = self._period
        period: float = value.value * 10.0**exponent.value
        return min(max(period, SHORTEST_PERIOD_S), LONGEST_PERIOD_S)

    def _options(self) -> Options:
        return Options(*[entry.value for entry in self._option_entries])


def simulated_node(
    machine: Machine,
    axis: Axis,
    transmit: Transmit,
    hardware: Hardware,
    position: float,
) -> Cia402Node:
    """Return the drive of an axis, see `mcserver.drive_sim.from_machine.build_node`."""
    dictionary = described(machine, axis)
    identity = identity_of(axis, dictionary)
    node = Cia402Node(cia402_drive(axis).node, transmit, hardware, position, identity)
    add_objects(node.store, dictionary)
    return node
