"""All axes of the machine: commands to their drives, feedback from them, and which axes hold.

Masks are bit masks over the machine's columns. The setpoint of an axis that is not under position or velocity
control follows its encoder, so that capturing it is no jump (D-40).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.drives.bus import (
    BusEvent,
    DriveBus,
    DriveMode,
    DriveState,
    Feedback,
    ForeseeingBus,
    Foreseen,
    Setpoints,
    UnclockedBus,
)
from mcserver.executor.column_masks import ColumnMasks, mask_of
from mcserver.executor.compensation import Compensator
from mcserver.executor.entries import Array
from mcserver.executor.shaping import Shaper
from mcserver.executor.shm.feedback import AxisCondition, FeedbackRow
from mcserver.machine.machine_file import Machine


def machine_shifts(machine: Machine) -> bool:
    """Return True if positions and encoder readings of an axis may differ, by its reference."""
    return any(axis.homing is not None for axis in machine.axes)


@dataclass
class _Port:
    """A bus, with its arrays of setpoints and feedback."""

    bus: DriveBus
    index: NDArray[np.intp] | None  # None: the bus drives all columns
    columns: NDArray[np.intp] | slice
    setpoints: Setpoints
    feedback: Feedback
    foresees: ForeseeingBus | None  # the bus, where it can


@dataclass(frozen=True)
class Ahead:
    """Exchanges of all buses, computed ahead.

    Attributes:
        actual: readings of the encoders after each, shape (m, K) [m or rad]. buses: the buses with a lag, and
            what each has computed, which may be more exchanges.
    """

    actual: Array
    buses: tuple[tuple[ForeseeingBus, Foreseen], ...]

    @property
    def agreed(self) -> bool:
        """Whether all buses have computed equally many exchanges."""
        return all(len(foreseen.actual) == len(self.actual) for _, foreseen in self.buses)

    def arrive(self) -> None:
        """Put the buses into the state after these exchanges."""
        for bus, foreseen in self.buses:
            bus.arrive(foreseen)


class AxisBank:
    """All axes and their buses.

    Attributes:
        row: setpoints and feedback of this cycle.
        torque: shape (K,), at the motor's shaft [N·m]: setpoints in torque mode; feed-forward in position
            mode, 0 unless set in each cycle.
        goal, goal_speed: shape (K,), of axes in profile position: see `mcserver.drives.bus.Setpoints`.
        all: mask of all columns. exact: columns whose drives follow exactly.
        energized: the drive holds in the commanded mode. starting: commanded to, not there yet.
        used: masks of the columns that were ever powered in each mode.
        positioned: energized, or about to be, in position mode. speed, torque_mode: in these modes.
        fault: latched. released, stopping, resetting: so commanded.
        fresh: shape (K,), whether drives answered. states: shape (K,), `DriveState`. drive_fault,
            drive_detail: shape (K,), of the columns in ``failed``.
        delayed: columns whose feedback is delayed; delay_cycles: by how many cycles at most.
        homing: the drive homes itself. offset: shape (K,), position minus encoder reading [m or rad]; no
            other place makes a difference between the two.
        inputs, switch_at, indices, index_at: shape (K,), as in `Feedback`, as positions.
        standing_speed: shape (K,), the greatest speed that counts as standing where an axis is captured.
        failed: columns whose drive has newly gone into FAULT. dropped: columns whose drive has newly
            de-energized by itself.
        shaper: makes setpoints from orders; None: they are the same.
        compensator: of backlash and pitch; None: drives get the setpoints unchanged.
        pairs: masks of the two drives of each gantry pair; they are energized and switched off together.
    """

    def __init__(self, machine: Machine, buses: Sequence[DriveBus], row: FeedbackRow) -> None:
        count = len(machine.axes)
        self.row = row
        self._cycle = machine.cycle_s
        self.masks = ColumnMasks(count)
        self.shaper: Shaper | None = None
        self.pairs = [
            1 << column | 1 << machine.column_of(axis.gantry.leader)
            for column, axis in enumerate(machine.axes)
            if axis.gantry is not None
        ]
        if machine.shaping is not None:
            row.separate_orders()
        self.torque: Array = np.zeros(count)
        self.goal: Array = np.full(count, np.nan)
        self.goal_speed: Array = np.zeros(count)
        # a drive of an axis with a reference is commanded in encoder readings
        self._shifts = machine_shifts(machine) or machine.compensated
        self._goal_target: Array = np.full(count, np.nan) if self._shifts else self.goal
        self._mode = np.full(count, DriveMode.OFF, np.int8)
        self.fresh = np.ones(count, np.bool_)
        self.states = np.zeros(count, np.int8)
        self.drive_fault = np.zeros(count, np.int32)
        self.drive_detail = np.zeros(count, np.int32)
        self.delayed = np.zeros(count, np.bool_)
        self.delay_cycles = 0
        self.offset: Array = np.zeros(count)
        self.compensator = Compensator(machine, row) if machine.compensated else None
        self._target: Array = np.zeros(count) if self._shifts else row.setpoint
        self._rate: Array = np.zeros(count) if machine.compensated else row.velocity
        self.inputs = np.zeros(count, np.int32)
        self.switch_at = np.full(count, np.nan)
        self.indices = np.zeros(count, np.int64)
        self.index_at = np.full(count, np.nan)
        self._state_bytes = self.states.tobytes()
        self._all_fresh = self.fresh.tobytes()
        # below this speed an axis can be stopped in one cycle
        self.standing_speed: Array = np.array([axis.max_acceleration for axis in machine.axes]) * self._cycle
        self.all = (1 << count) - 1
        self.exact = 0
        self.used = dict.fromkeys(DriveMode, 0)
        self.energized = self.starting = self.positioned = self.speed = self.torque_mode = 0
        self.fault = self.released = self.stopping = self.resetting = self.homing = 0
        self.failed = self.dropped = self._after_homing = 0
        self._condition_key: tuple[int, ...] = ()
        self._profiled = any(axis.profiled for axis in machine.axes)
        self._free = self.masks.bools(self.all)
        self._any_free = True
        self._ports: list[_Port] = []
        try:
            for bus in buses:
                self._attach(bus, count)
        except BaseException:
            self.close()
            raise
        if machine.shaping is not None:
            self.shaper = Shaper(machine.shaping, row, machine.cycle_s)

    def _attach(self, bus: DriveBus, count: int) -> None:
        feedback = bus.boot()
        row = self.row
        index = None if bus.columns == tuple(range(count)) else np.array(bus.columns, np.intp)
        columns = slice(None) if index is None else index
        setpoints = Setpoints.of(len(bus.columns))
        if index is None:
            setpoints = Setpoints(
                self._mode, self._target, self._rate, self.torque, self._goal_target, self.goal_speed
            )
        # checked once: isinstance of a protocol takes longer than all else in a cycle of three axes
        foresees = bus if isinstance(bus, ForeseeingBus) else None
        self._ports.append(_Port(bus, index, columns, setpoints, feedback, foresees))
        row.actual[columns] = row.setpoint[columns] = row.ordered[columns] = feedback.position
        if bus.delay_cycles:
            self.delayed[columns] = True
            self.delay_cycles = max(self.delay_cycles, bus.delay_cycles)
        if bus.follows_exactly:
            self.exact |= sum(1 << column for column in bus.columns)

    def close(self) -> None:
        """De-energize every drive and close the buses."""
        for port in self._ports:
            port.bus.close()

    def events(self) -> list[BusEvent]:
        """Take the events of the buses since the last call."""
        return [event for port in self._ports for event in port.bus.events()]

    @property
    def buses(self) -> list[DriveBus]:
        return [port.bus for port in self._ports]

    # ------------------------------------------------------------------ the cycle

    def stall(self, cycles: int) -> None:
        """Tell simulated drives the number of cycles that have passed without an exchange."""
        for port in self._ports:
            if isinstance(port.bus, UnclockedBus):
                port.bus.stall(cycles)

    def exchange(self) -> None:
        """Exchange with every bus, and update `failed`, `dropped` and the masks."""
        row = self.row
        if self.starting:
            self._lead_starting()
        if self._shifts:
            np.subtract(row.setpoint, self.offset, out=self._target)
            if self.compensator is not None:
                self.compensator.compensate(~self._free)
                self._target += self.compensator.correction
                np.add(row.velocity, self.compensator.rate, out=self._rate)
            if self._profiled:
                np.subtract(self.goal, self.offset, out=self._goal_target)
        for port in self._ports:
            index, columns, setpoints = port.index, port.columns, port.setpoints
            if index is not None:
                np.take(self._mode, index, out=setpoints.mode, mode="clip")
                np.take(self._target, index, out=setpoints.position, mode="clip")
                np.take(self._rate, index, out=setpoints.velocity, mode="clip")
                np.take(self.torque, index, out=setpoints.torque, mode="clip")
                if self._profiled:
                    np.take(self._goal_target, index, out=setpoints.goal, mode="clip")
                    np.take(self.goal_speed, index, out=setpoints.goal_speed, mode="clip")
            feedback = port.bus.exchange(setpoints)
            row.actual[columns] = feedback.position
            row.actual_velocity[columns] = feedback.velocity
            row.torque[columns] = feedback.torque
            self.states[columns] = feedback.state
            self.fresh[columns] = feedback.fresh
        if self._shifts:
            row.actual += self.offset
            self._read_marks()
            if self.compensator is not None:
                self._read_back(self.compensator)
        if self._any_free:
            np.copyto(row.setpoint, row.actual, where=self._free)
            if self.shaper is not None:
                self.shaper.show(self._free, row.actual)
        self.failed = self.dropped = 0
        states = self.states.tobytes()
        if states != self._state_bytes or self.starting or self.resetting or self.stopping:
            self._state_bytes = states
            self._note_states()

    def _read_marks(self) -> None:
        """Read switches and indices of the drives, as positions."""
        for port in self._ports:
            feedback = port.feedback
            self.inputs[port.columns] = feedback.inputs
            self.switch_at[port.columns] = feedback.switch_at
            self.indices[port.columns] = feedback.indices
            self.index_at[port.columns] = feedback.index_at
        self.switch_at += self.offset
        self.index_at += self.offset

    def _read_back(self, compensator: Compensator) -> None:
        """Subtract corrections from the drives' feedback: programs see positions without them."""
        self.row.actual -= compensator.correction
        self.row.actual_velocity -= compensator.rate
        self.switch_at -= compensator.correction
        self.index_at -= compensator.correction

    def shift(self, column: int, distance: float) -> None:
        """Add ``distance`` to a column's positions from now on; its drive does not move."""
        self.offset[column] += distance
        self.row.setpoint[column] += distance
        if self.shaper is not None:
            self.row.ordered[column] += distance
            self.shaper.shift(column, distance)
        if self.compensator is not None:
            self.compensator.shift(column, distance)
        self.row.actual[column] += distance
        self.switch_at[column] += distance
        self.index_at[column] += distance

    def take_over(self, column: int, position: float, velocity: float) -> None:
        """Restart shaped setpoints of an axis at a position and a velocity [m or rad, per second]."""
        if self.shaper is not None:
            count = len(self.row.setpoint)
            where = self.masks.bools(1 << column)
            self.shaper.take_over(where, np.full(count, position), np.full(count, velocity))

    @property
    def follows(self) -> bool:
        """Whether feedback of all axes can be computed ahead, and none changes its condition."""
        if self.compensator is not None:
            return False
        changing = self.starting | self.resetting | self.stopping | self.failed | self.dropped
        by_itself = self.torque_mode | self.homing
        if changing | by_itself or not self.all_fresh:
            return False
        if self.exact == self.all:
            return True
        return not self._shifts and all(
            port.bus.follows_exactly or (port.foresees is not None and port.foresees.foreseeable)
            for port in self._ports
        )

    def foresee(self, setpoint: Array, velocity: Array, actual: Array) -> Ahead:
        """Compute exchanges with setpoints, shape (m, K) each, up to the first that meets a drive's limit.

        Args:
            actual: feedback of drives that follow exactly, shape (m, K).
        """
        count, found = len(setpoint), []
        lagging = [port for port in self._ports if not port.bus.follows_exactly]
        for port in lagging:
            bus = port.foresees
            assert bus is not None
            ahead = bus.foresee(setpoint[:count, port.columns], velocity[:count, port.columns])
            found.append((bus, ahead))
            count = min(count, len(ahead.actual))
        actual = actual[:count].copy()
        for port, (_, ahead) in zip(lagging, found, strict=True):
            actual[:, port.columns] = ahead.actual[:count]
        return Ahead(actual, tuple(found))

    def _lead_starting(self) -> None:
        """Set the setpoint of a drive that closes its loop now to where its coasting axis will be."""
        row = self.row
        # a drive that has homed itself stands still, though its reading has jumped to the home position
        after_homing = self.starting & self._after_homing
        if after_homing:
            standing = self.masks.bools(after_homing)
            np.copyto(row.velocity, 0.0, where=standing)
            np.copyto(row.setpoint, row.actual, where=standing)
        where = self.masks.bools(self.starting & self.positioned & ~after_homing)
        coasting = where & (np.abs(row.actual_velocity) > self.standing_speed)
        np.copyto(row.velocity, np.where(coasting, row.actual_velocity, 0.0), where=where)
        np.copyto(row.setpoint, row.actual + row.velocity * self._cycle, where=where)

    @property
    def all_fresh(self) -> bool:
        """Whether every drive answered in this cycle."""
        return self.fresh.tobytes() == self._all_fresh

    def _note_states(self) -> None:
        # a drive that homes by itself holds its axis too
        energized = mask_of((self.states == DriveState.ENERGIZED) | (self.states >= DriveState.HOMING))
        faulty = mask_of(self.states == DriveState.FAULT)
        off = mask_of(self.states == DriveState.OFF)
        arrived = self.starting & energized
        if arrived:
            self.energized |= arrived
            self.starting &= ~arrived
            standing = self.masks.bools(arrived & self.positioned)
            self.row.velocity[standing] = self.row.ordered_velocity[standing] = 0.0
            self._refresh()
        self.failed = faulty & ~self.fault & ~self.resetting
        self.dropped = self.energized & ~energized & ~faulty
        if self.failed:
            for port in self._ports:
                self.drive_fault[port.columns] = port.feedback.fault
                self.drive_detail[port.columns] = port.feedback.detail
        done = (self.resetting | self.stopping) & off
        if done:
            self.resetting &= ~done
            self.stopping &= ~done
            self._tell(done & ~self.starting, DriveMode.OFF)
            for mode, mask in (
                (DriveMode.POSITION, self.positioned),
                (DriveMode.VELOCITY, self.speed),
                (DriveMode.TORQUE, self.torque_mode),
                (DriveMode.HOMING, self.homing),
            ):
                self._tell(done & self.starting & mask, mode)

    def reported_fault(self, column: int) -> tuple[int, int]:
        """Return the fault that a drive reports now (`DriveFault`, 0: none), and its number."""
        for port in self._ports:
            if column in port.bus.columns:
                place = port.bus.columns.index(column)
                return int(port.feedback.fault[place]), int(port.feedback.detail[place])
        return 0, 0

    # ------------------------------------------------------------------ commands

    def _tell(self, mask: int, mode: DriveMode) -> None:
        self._mode[self.masks.bools(mask)] = mode

    def _refresh(self) -> None:
        """Let the setpoints of axes without control follow their encoders."""
        free = self.all & ~(self.energized & (self.positioned | self.speed))
        self._free = self.masks.bools(free)
        self._any_free = free != 0

    def _release_all(self, mask: int) -> None:
        for name in (
            "energized",
            "starting",
            "positioned",
            "speed",
            "torque_mode",
            "homing",
            "released",
            "stopping",
            "resetting",
        ):
            setattr(self, name, getattr(self, name) & ~mask)
        bools = self.masks.bools(mask)
        self.row.velocity[bools] = self.row.ordered_velocity[bools] = 0.0
        self.torque[bools] = 0.0

    def both(self, mask: int) -> int:
        """Return columns together with the other sides of their gantry pairs."""
        for pair in self.pairs:
            if mask & pair:
                mask |= pair
        return mask

    def power(self, mask: int, mode: DriveMode) -> None:
        """Energize axes in a mode, or change the mode of energized ones; ideal drives do so at once."""
        mask = self.both(mask)
        # a drive takes a moment to leave its own homing
        leaving = mask & self.homing & ~self.exact
        self.energized &= ~leaving
        self._after_homing = (self._after_homing & ~mask) | leaving
        new = mask & ~self.energized
        self.used[mode] |= mask
        self.released &= ~mask
        self.stopping &= ~mask
        self.positioned &= ~mask
        self.speed &= ~mask
        self.torque_mode &= ~mask
        self.homing &= ~mask
        if mode is DriveMode.POSITION:
            self.positioned |= mask
        elif mode is DriveMode.HOMING:
            self.homing |= mask
        elif mode is DriveMode.VELOCITY:
            self.speed |= mask
        else:
            self.torque_mode |= mask
        self.starting |= new & ~self.exact
        self.energized |= new & self.exact
        # a drive that is still clearing a fault would report it again: command it once that is done
        self._tell(mask & ~self.resetting, mode)
        if mode is not DriveMode.TORQUE:
            self.torque[self.masks.bools(mask)] = 0.0
        self._refresh()

    def off(self, mask: int) -> None:
        """De-energize axes at once."""
        mask = self.both(mask)
        self._release_all(mask)
        self._tell(mask, DriveMode.OFF)
        self._refresh()

    def reset(self, mask: int) -> None:
        """Clear fault latches; the axes are off afterwards."""
        mask = self.both(mask)
        self._release_all(mask)
        self.fault &= ~mask
        self.resetting |= mask & ~self.exact
        self._tell(mask, DriveMode.RESET)
        self._refresh()

    def stop(self, mask: int) -> None:
        """Let drives stop their axes by themselves and then de-energize; end the capture."""
        mask = self.both(mask)
        self._release_all(mask)
        self.stopping |= mask & ~self.exact
        self._tell(mask, DriveMode.STOP)
        self._refresh()

    def release(self, mask: int) -> None:
        """Stop transmitting: the drives' heartbeat time-outs act."""
        mask = self.both(mask)
        self._release_all(mask)
        self.released |= mask
        self._tell(mask, DriveMode.SILENT)
        self._refresh()

    def latch(self, mask: int) -> None:
        """De-energize faulted axes until `reset`."""
        self.off(mask)
        self.fault |= mask

    # ------------------------------------------------------------------ telemetry

    def show_conditions(self, moving: int) -> None:
        """Update the feedback's conditions where anything has changed."""
        key = (
            self.energized,
            self.starting,
            self.speed,
            self.torque_mode,
            self.fault,
            self.released,
            self.stopping,
            self.homing,
            moving,
        )
        if key == self._condition_key:
            return
        self._condition_key = key
        condition = self.row.condition
        condition[:] = AxisCondition.OFF
        for mask, value in (
            (self.released, AxisCondition.RELEASED),
            (self.starting, AxisCondition.STARTING),
            (self.stopping, AxisCondition.STOPPING),
            (self.energized, AxisCondition.HOLDING),
            (self.energized & (moving | self.homing), AxisCondition.MOVING),
            (self.energized & self.speed, AxisCondition.SPEED),
            (self.energized & self.torque_mode, AxisCondition.TORQUE),
            (self.fault, AxisCondition.FAULT),
        ):
            if mask:
                condition[self.masks.bools(mask)] = value
