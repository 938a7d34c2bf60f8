"""Modes of operation (CiA 402-2): from targets in the dictionary to what the motor is asked for.

Positions on the bus wrap at 32 bits; inside they are turns of the motor that do not.
"""

from __future__ import annotations

import math

from mcserver.can.pdo_layout import Mode
from mcserver.drive_sim.dictionary import Entry, ObjectStore
from mcserver.drive_sim.motor import WINDUP_S, Motor
from mcserver.drive_sim.power import HALT, Stop

WRAP = 1 << 32
HALF_WRAP = 1 << 31
POLARITY_POSITION = 1 << 7
POLARITY_VELOCITY = 1 << 6
NEW_SETPOINT = 1 << 4
CHANGE_AT_ONCE = 1 << 5
RELATIVE = 1 << 6
NO_WINDOW = 0xFFFFFFFF
SUPPORTED = (
    Mode.NONE,
    Mode.PROFILE_POSITION,
    Mode.INTERPOLATED_POSITION,
    Mode.CYCLIC_POSITION,
    Mode.CYCLIC_VELOCITY,
    Mode.CYCLIC_TORQUE,
)
POSITIONED = (Mode.CYCLIC_POSITION, Mode.PROFILE_POSITION, Mode.INTERPOLATED_POSITION)
# Bit 4 in mode ip: the set-points of 60C1h are followed; else the drive stands.
INTERPOLATE = 1 << 4
INT32 = (-HALF_WRAP, HALF_WRAP - 1)
INT16 = (-(1 << 15), (1 << 15) - 1)


class Motion:
    """What the enabled drive does.

    Attributes:
        mode: 6061h. acknowledged: a set-point of mode pp was taken (statusword bit 12).
        reached: the target of mode pp, or standstill under halt. beyond: a software limit held the demand.
        interpolating: mode ip follows its set-points (statusword bit 12).
        deaf: set-points of mode pp are not taken. reversed: torques turn the motor the wrong way round.
    """

    def __init__(self, store: ObjectStore, motor: Motor) -> None:
        self.motor = motor
        self.mode: int = Mode.NONE
        self.acknowledged = False
        self.reached = False
        self.beyond = False
        self.interpolating = False
        self.deaf = False
        self.reversed = False
        entry = store.entry
        self._wanted, self._display = entry(0x6060), entry(0x6061)
        self._target_position, self._target_velocity = entry(0x607A), entry(0x60FF)
        self._interpolated = entry(0x60C1, 1)
        self._target_torque, self._max_torque = entry(0x6071), entry(0x6072)
        self._velocity_offset, self._torque_offset = entry(0x60B1), entry(0x60B2)
        self._encoder = entry(0x608F, 1), entry(0x608F, 2)
        self._gear = entry(0x6091, 1), entry(0x6091, 2)
        self._feed = entry(0x6092, 1), entry(0x6092, 2)
        self._polarity = entry(0x607E)
        self._limits = entry(0x607D, 1), entry(0x607D, 2)
        self._profile_velocity, self._max_velocity = entry(0x6081), entry(0x607F)
        self._acceleration, self._deceleration = entry(0x6083), entry(0x6084)
        self._quick_deceleration = entry(0x6085)
        self._window, self._window_time = entry(0x6067), entry(0x6068)
        self._error_window, self._error_time = entry(0x6065), entry(0x6066)
        self._reported = {
            name: entry(index)
            for name, index in (
                ("demand", 0x6062),
                ("internal", 0x6063),
                ("actual", 0x6064),
                ("velocity_demand", 0x606B),
                ("velocity", 0x606C),
                ("torque_demand", 0x6074),
                ("torque", 0x6077),
                ("error", 0x60F4),
            )
        }
        self._rated = entry(0x6076)
        self._scale_from: tuple[int, ...] = ()
        self.start()
        self.rescale()

    # ------------------------------------------------------------------ units

    def rescale(self) -> None:
        """Take 608Fh, 6091h, 6092h and 607Eh as they stand in the dictionary.

        6064h = increments · 6092h / (608Fh · 6091h); an unwritten feed constant means a unit of one
        increment.
        """
        entries = (*self._encoder, *self._gear, *self._feed, self._polarity)
        values = tuple(entry.value for entry in entries)
        if values == self._scale_from:
            return
        self._scale_from = values
        increments, revolutions, motor, shaft, feed, feed_shaft, polarity = values
        # what the drive takes for a turn is not what one is, where 608Fh does not fit the encoder
        believed = increments / revolutions
        turns = self.motor.hardware.increments_per_turn / believed
        units = feed / feed_shaft * shaft / motor if self._feed[0].written else believed
        sign = -1.0 if polarity & POLARITY_POSITION else 1.0
        self._units_per_turn = sign * turns * units
        velocity_units = self.motor.hardware.velocity_per_turn or turns * units
        self._velocity_per_turn = (-1.0 if polarity & POLARITY_VELOCITY else 1.0) * velocity_units
        self.report(0.0)

    def _turns_of(self, target: int) -> float:
        """Return the position nearest to the present demand that a wrapped number of units means [turn]."""
        present = round(self._demand * self._units_per_turn)
        change = (target - present + HALF_WRAP) % WRAP - HALF_WRAP
        return (present + change) / self._units_per_turn

    def _rate(self, entry: Entry, limit: float) -> float:
        """Return a profile's velocity or acceleration, as unsigned units per second (squared) [turn/s,
        turn/s²].
        """
        return min(entry.value / abs(self._units_per_turn), limit)

    # ------------------------------------------------------------------ steps

    def start(self) -> None:
        """Operation is enabled: the demand begins where the shaft is."""
        self._demand = self.motor.position
        self._velocity = 0.0
        self._torque = 0.0
        self._targets: list[float] = []
        self._goal: float | None = None
        self._strobe = False
        self._overdue_s = 0.0
        self._settled_s = 0.0
        self._stop = Stop.NONE
        self.acknowledged = self.reached = self.beyond = self.interpolating = False

    def choose_mode(self) -> None:
        """Take 6060h where the drive has that mode; a change starts from what the shaft does."""
        wanted = self._wanted.value
        if wanted != self.mode and wanted in SUPPORTED:
            velocity = self.motor.velocity
            self.mode = wanted
            self._display.value = wanted
            self.start()
            self._velocity = velocity

    def command(self, controlword: int) -> None:
        """Bits of the controlword that belong to the mode: the set-point handshake of pp."""
        strobe = bool(controlword & NEW_SETPOINT)
        if self.mode == Mode.PROFILE_POSITION:
            if strobe and not self._strobe:
                self._take_setpoint(controlword)
            elif not strobe and len(self._targets) == 0:
                self.acknowledged = False
        self.interpolating = self.mode == Mode.INTERPOLATED_POSITION and bool(controlword & INTERPOLATE)
        self._strobe = strobe

    def _take_setpoint(self, controlword: int) -> None:
        if self.acknowledged or self.deaf:
            return
        base = self._goal if self._goal is not None else self._demand
        if controlword & RELATIVE:
            target = base + self._target_position.value / self._units_per_turn
        else:
            target = self._turns_of(self._target_position.value)
        self.acknowledged = True
        self.reached = False
        if controlword & CHANGE_AT_ONCE or self._goal is None:
            self._goal = target
        else:
            self._targets.append(target)

    def step(self, dt: float, controlword: int, stop: Stop) -> bool:
        """One step of an enabled drive; whether a ramp that ``stop`` asked for has come to rest."""
        self.beyond = False
        halted = bool(controlword & HALT)
        if stop is not Stop.NONE or halted:
            kind = stop if stop is not Stop.NONE else Stop.PROFILE_RAMP
            return self._ramp(dt, kind) and stop is not Stop.NONE
        self._stop = Stop.NONE
        if self.mode == Mode.CYCLIC_TORQUE:
            self._apply_torque(dt)
        elif self.mode == Mode.CYCLIC_VELOCITY:
            self._follow_velocity(dt)
        elif self.mode == Mode.CYCLIC_POSITION:
            self._advance(self._within_limits(self._turns_of(self._target_position.value)), dt)
        elif self.mode == Mode.PROFILE_POSITION:
            self._advance(self._profile(dt), dt)
        elif self.interpolating:
            self._advance(self._within_limits(self._turns_of(self._interpolated.value)), dt)
        else:
            self._advance(self._demand, dt)
        return False

    def _advance(self, demand: float, dt: float) -> None:
        last, self._demand = self._demand, demand
        self._velocity = (demand - last) / dt
        self.motor.follow(last, demand, dt)
        self._torque = self.motor.torque

    def _within_limits(self, demand: float) -> float:
        least, greatest = self._limits[0].value, self._limits[1].value
        if (least, greatest) == INT32 or least >= greatest:
            return demand
        low, high = sorted((least / self._units_per_turn, greatest / self._units_per_turn))
        held = min(max(demand, low), high)
        self.beyond = held != demand
        return held

    def _apply_torque(self, dt: float) -> None:
        limit = self._max_torque.value
        permille = min(max(self._target_torque.value + self._torque_offset.value, -limit), limit)
        self._torque = permille * self._rated.value * (-1e-6 if self.reversed else 1e-6)
        self.motor.push(self._torque, dt)
        self._demand = self.motor.position
        self._velocity = self.motor.velocity

    def _follow_velocity(self, dt: float) -> None:
        velocity = (self._target_velocity.value + self._velocity_offset.value) / self._velocity_per_turn
        limit = self.motor.hardware.max_speed
        velocity = min(max(velocity, -limit), limit)
        end = self._demand + velocity * dt
        behind = end - self.motor.position
        windup = WINDUP_S * limit
        if abs(behind) > windup:
            end = self.motor.position + math.copysign(windup, behind)
        self.motor.follow(end - velocity * dt, end, dt)
        self._demand, self._velocity, self._torque = end, velocity, self.motor.torque

    def _ramp(self, dt: float, kind: Stop) -> bool:
        hardware = self.motor.hardware
        if self._stop is not kind:
            if self._stop is Stop.NONE:
                self._demand, self._velocity = self.motor.position, self.motor.velocity
                self._targets.clear()
                self._goal = None
            self._stop = kind
        entry = self._quick_deceleration if kind is Stop.QUICK_RAMP else self._deceleration
        change = self._rate(entry, hardware.max_acceleration) * dt
        old = self._velocity
        new = math.copysign(max(abs(old) - change, 0.0), old)
        end = self._demand + 0.5 * (old + new) * dt
        self.motor.follow(self._demand, end, dt)
        self._demand, self._velocity, self._torque = end, new, self.motor.torque
        at_rest = new == 0.0 and abs(self.motor.velocity) * dt < 1e-4
        self.reached = at_rest
        return at_rest

    def _profile(self, dt: float) -> float:
        """Return the next position on the way to the goal of mode pp: trapezoidal, by 6081h, 6083h, 6084h."""
        if self._goal is None:
            return self._demand
        hardware = self.motor.hardware
        goal = self._within_limits(self._goal)
        way = goal - self._demand
        fastest = min(
            self._rate(self._profile_velocity, hardware.max_speed),
            self._rate(self._max_velocity, hardware.max_speed),
        )
        up = self._rate(self._acceleration, 0.8 * hardware.max_acceleration)
        down = self._rate(self._deceleration, 0.8 * hardware.max_acceleration)
        old = self._velocity
        # the speed from which the rest of the way, this step included, is enough to brake
        braking = down * (math.sqrt(0.25 * dt * dt + 2.0 * abs(way) / down) - 0.5 * dt)
        wanted = math.copysign(min(fastest, braking), way)
        slower = wanted * old < 0.0 or abs(wanted) < abs(old)
        change = (down if slower else up) * dt
        new = min(max(wanted, old - change), old + change)
        step = 0.5 * (old + new) * dt
        if abs(way) <= abs(step) or (abs(way) < 1e-9 and abs(old) <= change):
            self._goal = self._targets.pop(0) if self._targets else self._goal
            return goal
        return self._demand + step

    # ------------------------------------------------------------------ what is reported

    def rest(self, dt: float) -> None:
        """One step of a drive that is off: the shaft runs out."""
        self.motor.coast(dt)
        self._demand = self.motor.position
        self._velocity = self._torque = 0.0

    def report(self, dt: float) -> None:
        """Write actual and demand values into the dictionary."""
        motor, objects = self.motor, self._reported
        actual = round(motor.position * self._units_per_turn)
        demand = round(self._demand * self._units_per_turn)
        objects["actual"].value = (actual + HALF_WRAP) % WRAP - HALF_WRAP
        objects["demand"].value = (demand + HALF_WRAP) % WRAP - HALF_WRAP
        internal = round(motor.position * motor.hardware.increments_per_turn)
        objects["internal"].value = (internal + HALF_WRAP) % WRAP - HALF_WRAP
        objects["error"].value = _clip(demand - actual, INT32)
        objects["velocity"].value = _clip(round(motor.velocity * self._velocity_per_turn), INT32)
        objects["velocity_demand"].value = _clip(round(self._velocity * self._velocity_per_turn), INT32)
        permille = 1e6 / self._rated.value
        objects["torque"].value = _clip(round(motor.torque * permille), INT16)
        objects["torque_demand"].value = _clip(round(self._torque * permille), INT16)
        if self.mode == Mode.PROFILE_POSITION and dt:
            self._look_for_target(demand, actual, dt)

    def _look_for_target(self, demand: int, actual: int, dt: float) -> None:
        goal = self._goal
        arrived = goal is None or (not self._targets and abs(self._demand - goal) < 1e-9)
        window = self._window.value
        inside = arrived and (window == NO_WINDOW or abs(demand - actual) <= window)
        self._settled_s = self._settled_s + dt if inside else 0.0
        self.reached = inside and self._settled_s * 1e3 >= self._window_time.value

    def follows(self, dt: float) -> bool:
        """Return whether the following error is within 6065h, or not yet outside for 6066h; of position
        modes.
        """
        window = self._error_window.value
        if window == NO_WINDOW or self.mode not in POSITIONED:
            self._overdue_s = 0.0
            return True
        if abs(self._reported["error"].value) <= window:
            self._overdue_s = 0.0
            return True
        self._overdue_s += dt
        return self._overdue_s * 1e3 < self._error_time.value


def _clip(value: int, bounds: tuple[int, int]) -> int:
    return min(max(value, bounds[0]), bounds[1])
