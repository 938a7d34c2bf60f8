"""What each kind of control entry does as u passes it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from mcserver.drives.bus import DriveMode
from mcserver.executor.barriers import (
    AtRest,
    Barrier,
    DrivesDone,
    Dwell,
    Energized,
    ExactStop,
    InputWait,
    InStep,
    NextCycle,
    Paused,
)
from mcserver.executor.entries import Control, ControlKind, EventKind
from mcserver.executor.fault_codes import BarrierFault, FaultCode
from mcserver.executor.following import Follows
from mcserver.executor.holding import hold_position
from mcserver.executor.homing import Homes, Refers
from mcserver.executor.probing import Probes
from mcserver.executor.shm.feedback import SlotState
from mcserver.executor.shm.mailbox import signed
from mcserver.executor.target_follower import UNBOUNDED, Bounds
from mcserver.executor.thread_pass import ThreadPass
from mcserver.machine.axis import Axis
from mcserver.machine.follow_section import Superimposed
from mcserver.motion.canonical import AxisOperation, MeshUse, SurfaceSpeed, WaitMode

if TYPE_CHECKING:
    from mcserver.executor.slot import ProgramSlot

_OPERATIONS = tuple(AxisOperation)
# These move axes.
_MOVING = (
    ControlKind.BEGIN,
    ControlKind.RAPID,
    ControlKind.SPEED,
    ControlKind.TORQUE,
    ControlKind.HOME,
    ControlKind.REFERENCE,
    ControlKind.PROBE,
    ControlKind.THREAD,
    ControlKind.FOLLOW,
)
# These move an axis along with what it follows besides.
_MOVING_ALONG = (ControlKind.BEGIN, ControlKind.RAPID)
# These have something to do behind their barriers; the others are done.
_GOING_ON = (
    ControlKind.RAPID,
    ControlKind.SPEED,
    ControlKind.TORQUE,
    ControlKind.AXIS,
    ControlKind.SETTLE,
    ControlKind.FINISH,
    ControlKind.MESH,
)


def pass_control(slot: ProgramSlot, control: Control, left: float, waited: bool = False) -> Barrier | None:
    """Carry out an entry, ``left`` cycles before the exchange.

    Args:
        waited: the barrier that an earlier call for this entry put up has been passed.

    Returns:
        A barrier at which u stands first; None: the entry is done.

    Raises:
        BarrierFault: the entry cannot be done; the program is at fault.
    """
    if waited and control.kind not in _GOING_ON:
        return None
    if slot.guard is not None and not waited:
        slot.guard.admit_control(control)
    if control.kind in _MOVING:
        couplings = slot.cycle.couplings
        following = couplings.mask if control.kind in _MOVING_ALONG else couplings.all_following
        _refuse(slot, control.axes & following, FaultCode.COUPLED)
    return _RULES[control.kind](slot, control, left, waited)


def _line_start(slot: ProgramSlot, control: Control, left: float, _waited: bool) -> Barrier | None:
    slot.line = control.line
    slot.shown_line = control.line
    slot.cycle.emit(EventKind.LINE_START, slot.index, control.line, left)
    return None


def _line_end(slot: ProgramSlot, control: Control, left: float, _waited: bool) -> Barrier | None:
    if slot.line == control.line:
        slot.line = 0
    slot.cycle.emit(EventKind.LINE_END, slot.index, control.line, left)
    return None


def _refuse(slot: ProgramSlot, axes: int, code: FaultCode) -> None:
    """Raise a fault of the first of these axes, where there is one."""
    if axes:
        raise BarrierFault(code, slot.cycle.bank.masks.columns(axes)[0])


def _check_lease(slot: ProgramSlot, axes: int) -> None:
    _refuse(slot, axes & ~slot.axes, FaultCode.AXIS_NOT_LEASED)


def _check_power(slot: ProgramSlot, axes: int) -> None:
    """Raise where axes may not be energized now."""
    cycle = slot.cycle
    axes = cycle.bank.both(axes)
    _check_lease(slot, axes)
    if cycle.estop:
        raise BarrierFault(FaultCode.EMERGENCY_STOP, -1)
    _refuse(slot, axes & cycle.bank.fault, FaultCode.AXIS_LATCHED)


def _check_configured(slot: ProgramSlot, axes: int, mode: DriveMode) -> None:
    """Raise where the machine file does not say what a drive needs for this mode."""
    for column in slot.cycle.bank.masks.columns(axes):
        if slot.cycle.gantries.mask >> column & 1:
            raise BarrierFault(FaultCode.PAIR_MODE, column)
        if not slot.cycle.machine.axes[column].drive.has_mode(mode):
            raise BarrierFault(FaultCode.MODE_NOT_CONFIGURED, column, (float(mode), 0.0))


def _check_follows_paths(slot: ProgramSlot, axes: int) -> None:
    """Raise where axes are to follow a path whose drives make their profiles themselves."""
    _refuse(slot, axes & slot.cycle.profiled.mask, FaultCode.FOLLOWS_NO_PATH)


def _check_homed(slot: ProgramSlot, axes: int) -> None:
    """Raise where axes do not know where they are and the program is not to move them then."""
    if slot.orders is None or not slot.orders.unhomed:
        _refuse(slot, slot.cycle.homed.barred(slot.cycle.bank.both(axes)), FaultCode.NOT_HOMED)


def _check_free(slot: ProgramSlot, axes: int) -> None:
    """Raise where axes are not energized, or move by themselves."""
    bank = slot.cycle.bank
    _refuse(slot, axes & ~bank.energized, FaultCode.NOT_ENERGIZED)
    _refuse(slot, axes & (slot.cycle.motions.mask | bank.speed | bank.torque_mode), FaultCode.AXIS_BUSY)


def _begin(slot: ProgramSlot, control: Control, _left: float, _waited: bool) -> Barrier | None:
    both = slot.cycle.bank.both(control.axes)
    _check_lease(slot, both)
    _check_homed(slot, both)
    _refuse(slot, both & slot.cycle.bank.fault, FaultCode.AXIS_LATCHED)
    _check_follows_paths(slot, control.axes)
    _check_free(slot, both)
    slot.playback.begin(control.axes, control.u)
    return None


def _end(slot: ProgramSlot, control: Control, _left: float, _waited: bool) -> Barrier | None:
    slot.playback.end(control.axes, control.u, control.values)
    return None


def _wait(slot: ProgramSlot, control: Control, _left: float, _waited: bool) -> Barrier | None:
    timeout = control.seconds if control.seconds > 0.0 else slot.cycle.machine.exact_stop_timeout
    return ExactStop(slot.cycle, slot.cycle.bank.both(control.axes), timeout)


def _dwell(slot: ProgramSlot, control: Control, _left: float, _waited: bool) -> Barrier | None:
    return Dwell(slot.cycle, control.seconds)


def _energize(slot: ProgramSlot, axes: int, mode: DriveMode) -> Barrier | None:
    """Energize what is not energized yet; None: all of it is."""
    bank = slot.cycle.bank
    axes = bank.both(axes)
    missing = axes & ~bank.energized
    if not missing:
        return None
    _check_power(slot, missing)
    bank.power(missing, mode)
    return Energized(slot.cycle, axes)


def _brake_captured(slot: ProgramSlot, axes: int, left: float) -> None:
    """Bring axes that coasted while they were captured to rest within their limits."""
    cycle = slot.cycle
    for column in cycle.bank.masks.columns(axes & cycle.bank.positioned & ~cycle.motions.mask):
        velocity = float(cycle.row.actual_velocity[column])
        if abs(velocity) > cycle.bank.standing_speed[column]:
            cycle.bank.take_over(column, float(cycle.row.actual[column]), velocity)
            state = (float(cycle.row.ordered[column]), velocity, 0.0)
            cycle.motions.halt_from(column, slot.index, state, left)


def _rapid(slot: ProgramSlot, control: Control, left: float, waited: bool) -> Barrier | None:
    cycle, bank, motions = slot.cycle, slot.cycle.bank, slot.cycle.motions
    assert control.values is not None
    targets = control.values
    if not waited:
        _check_power(slot, control.axes)
        _check_homed(slot, control.axes)
        _refuse(slot, control.axes & slot.playback.active, FaultCode.AXIS_BUSY)
        for column in bank.masks.columns(control.axes):
            _check_target(slot, column, targets[column])
        barrier = _energize(slot, control.axes, DriveMode.POSITION)
        if barrier is not None:
            slot.captured = control.axes & bank.starting
            return barrier
    _brake_captured(slot, slot.captured, left)
    slot.captured = 0
    hold_position(cycle, control.axes & (bank.speed | bank.torque_mode), slot.index, left)
    for column in bank.masks.columns(control.axes):
        motions.move(column, slot.index, targets[column], left, slot.rapid_rate)
    cycle.row.ordered_velocity[bank.masks.bools(control.axes & ~motions.mask)] = 0.0
    return None


def _check_target(slot: ProgramSlot, column: int, target: float) -> None:
    axis = slot.cycle.machine.axes[column]
    low, high = axis.min_position - axis.in_position, axis.max_position + axis.in_position
    if not (math.isfinite(target) and low <= target <= high):
        limit = axis.max_position if target > 0.5 * (low + high) else axis.min_position
        raise BarrierFault(FaultCode.SOFT_LIMIT, column, (target, limit))


def _speed(slot: ProgramSlot, control: Control, left: float, waited: bool) -> Barrier | None:
    bank = slot.cycle.bank
    assert control.values is not None
    if not waited:
        _check_power(slot, control.axes)
        _check_homed(slot, control.axes)
        _check_configured(slot, control.axes, DriveMode.VELOCITY)
        barrier = _energize(slot, control.axes, DriveMode.VELOCITY)
        if barrier is not None:
            return barrier
    hold_position(slot.cycle, control.axes & bank.torque_mode, slot.index, left)
    bank.power(control.axes, DriveMode.VELOCITY)
    for column in bank.masks.columns(control.axes):
        slot.cycle.motions.speed(column, slot.index, control.values[column], left, _surface_of(control))
    return None


def _surface_of(control: Control) -> tuple[int, SurfaceSpeed] | None:
    """Return column and law of a spindle that the radius leads (D-120)."""
    if not control.operation or control.values is None:
        return None
    leads = control.channel
    return leads, SurfaceSpeed(leads, control.values[leads], control.seconds, control.value)


def _torque(slot: ProgramSlot, control: Control, _left: float, waited: bool) -> Barrier | None:
    cycle, bank = slot.cycle, slot.cycle.bank
    assert control.values is not None
    if not waited:
        _check_power(slot, control.axes)
        _check_homed(slot, control.axes)
        _check_configured(slot, control.axes, DriveMode.TORQUE)
        for column in bank.masks.columns(control.axes):
            bank.torque[column] = 0.0
        barrier = _energize(slot, control.axes, DriveMode.TORQUE)
        if barrier is not None:
            return barrier
    cycle.motions.drop(control.axes)
    cycle.row.ordered_velocity[bank.masks.bools(control.axes)] = 0.0
    bank.power(control.axes, DriveMode.TORQUE)
    for column in bank.masks.columns(control.axes):
        bank.torque[column] = control.values[column]
    return None


def _axis(slot: ProgramSlot, control: Control, left: float, waited: bool) -> Barrier | None:
    """Carry out an axis command once the motion before it has ended, in two or three steps (D-40)."""
    cycle, bank, motions = slot.cycle, slot.cycle.bank, slot.cycle.motions
    axes = bank.both(control.axes)
    operation = _OPERATIONS[control.operation]
    if operation is AxisOperation.CAPTURE:
        # what follows is energized, and may move
        axes &= ~cycle.couplings.mask
    if not waited:
        _check_lease(slot, axes)
        if operation not in (AxisOperation.CAPTURE, AxisOperation.COUPLE):
            cycle.couplings.uncouple(axes)
        slot.acted = False
        slot.captured = 0
        _refuse(slot, axes & slot.playback.active, FaultCode.AXIS_BUSY)
        if operation is not AxisOperation.CAPTURE:
            # the drive is to have got its last setpoint
            return AtRest(cycle, axes, exchanged=True)
        if motions.mask & ~motions.speeding & axes:
            return AtRest(cycle, axes)
    if not slot.acted:
        slot.acted = True
        barrier = _act(slot, axes, operation)
        if barrier is not None:
            return barrier
    if operation is AxisOperation.CAPTURE:
        _brake_captured(slot, slot.captured, left)
    slot.captured = 0
    cycle.emit(EventKind.AXIS_DONE, slot.index, control.line, left)
    return None


def _act(slot: ProgramSlot, axes: int, operation: AxisOperation) -> Barrier | None:
    cycle, bank = slot.cycle, slot.cycle.bank
    if operation is AxisOperation.CAPTURE:
        slot.captured = axes & ~bank.energized
        return _energize(slot, axes, DriveMode.POSITION)
    if operation is AxisOperation.COUPLE:
        return _couple(slot, axes)
    if operation is AxisOperation.UNCOUPLE:
        return None
    cycle.motions.drop(axes)
    if operation is AxisOperation.RESET:
        bank.reset(axes)
        return DrivesDone(cycle, axes)
    # a latched axis is off already, and stays latched
    healthy = axes & ~bank.fault
    if operation is AxisOperation.OFF:
        bank.off(healthy)
    elif operation is AxisOperation.STOP:
        bank.stop(healthy)
        return DrivesDone(cycle, healthy)
    else:
        bank.release(healthy)
    return None


def _couple(slot: ProgramSlot, axes: int) -> Barrier | None:
    """Let an axis, or a tool's joints, follow a leader; u stands until it is in step (D-130)."""
    couplings, bank = slot.cycle.couplings, slot.cycle.bank
    _refuse(slot, axes & couplings.all_following, FaultCode.COUPLED)
    _check_still(slot, axes)
    columns = bank.masks.columns(axes)
    within = UNBOUNDED
    for column in columns:
        axis = slot.cycle.machine.axes[column]
        if slot.guard is not None:
            within = slot.guard.bounds(column)
            # what the leader does besides was not simulated
            _refuse(slot, axes if axis.reserved is not None else 0, FaultCode.ENVELOPE_COMMAND)
        if axis.superimposed is not None:
            _check_window(slot, column, axis, axis.superimposed)
    if len(columns) > 1:
        # where a tool is follows from all its joints
        _refuse(slot, slot.cycle.homed.barred(axes), FaultCode.NOT_HOMED)
    coupling = couplings.prepare(axes, slot.index, slot.generation, within)
    _check_homed(slot, 1 << coupling.leader.column)
    if coupling.leader.lost(0):
        raise BarrierFault(FaultCode.LEADER_LOST, coupling.leader.column)
    if not abs(coupling.apart) <= coupling.tolerance:
        raise BarrierFault(FaultCode.BESIDE_CAM, coupling.column, (coupling.apart, coupling.tolerance))
    couplings.couple(coupling)
    return InStep(slot.cycle, coupling)


def _check_window(slot: ProgramSlot, column: int, axis: Axis, own: Superimposed) -> None:
    """Raise where an axis may leave its travel by what it follows."""
    place = float(slot.cycle.row.ordered[column])
    for end, limit in ((place + own.low, axis.min_position), (place + own.high, axis.max_position)):
        beyond = limit - end if limit == axis.min_position else end - limit
        if beyond > axis.in_position and not slot.cycle.motions.unlimited >> column & 1:
            raise BarrierFault(FaultCode.SOFT_LIMIT, column, (end, limit))


def _halt(slot: ProgramSlot, control: Control, left: float, _waited: bool) -> Barrier | None:
    cycle, bank, motions = slot.cycle, slot.cycle.bank, slot.cycle.motions
    _check_lease(slot, control.axes)
    # what follows another axis is not stopped by itself, nor waited for
    named = control.axes & ~cycle.couplings.mask
    axes = named & bank.energized
    hold_position(cycle, axes & (bank.speed | bank.torque_mode), slot.index, left)
    for column in bank.masks.columns(axes & motions.mask):
        if not motions.halting >> column & 1:
            motions.halt(column, slot.index, left)
    return AtRest(cycle, named)


def _pause(slot: ProgramSlot, control: Control, left: float, _waited: bool) -> Barrier | None:
    if slot.orders is None:
        return None
    lent = signed(slot.lend())
    slot.cycle.emit(EventKind.PAUSED, slot.index, control.line, left, token=lent)
    return Paused(slot.orders.confirm)


def _home(slot: ProgramSlot, control: Control, _left: float, _waited: bool) -> Barrier | None:
    cycle, bank = slot.cycle, slot.cycle.bank
    _check_power(slot, control.axes)
    _refuse(slot, control.axes & ~bank.energized, FaultCode.NOT_ENERGIZED)
    if cycle.homed.assumed:
        return None
    return Homes(cycle, bank.both(control.axes), slot.index, lambda: slot.rapid_rate)


def _check_still(slot: ProgramSlot, axes: int) -> None:
    """Raise where axes are not energized and at rest, or cannot follow setpoints."""
    _check_power(slot, axes)
    _check_homed(slot, axes)
    _check_follows_paths(slot, axes)
    _check_free(slot, axes)


def _probe(slot: ProgramSlot, control: Control, _left: float, _waited: bool) -> Barrier | None:
    _check_still(slot, control.axes)
    return Probes(slot.cycle, control, slot.index, lambda: slot.rapid_rate)


def _thread(slot: ProgramSlot, control: Control, _left: float, _waited: bool) -> Barrier | None:
    _check_still(slot, control.axes)
    spindle, bank = 1 << control.channel, slot.cycle.bank
    _check_lease(slot, spindle)
    if not spindle & bank.speed & bank.energized:
        raise BarrierFault(FaultCode.SPINDLE_SPEED, control.channel, (0.0, 1.0))
    return ThreadPass(slot.cycle, control, slot.index)


def _follow(slot: ProgramSlot, control: Control, _left: float, _waited: bool) -> Barrier | None:
    _check_still(slot, control.axes)

    def lost(silence: float, counted: float) -> None:
        slot.cycle.fault(FaultCode.TARGETS_LOST, slot.index, 0, -1, (silence, counted))
        slot.stop(SlotState.STOPPED)

    low, high, guard = slot.follow_from, control.values, slot.guard
    slot.follow_from = None
    bounds = []
    for column in slot.cycle.bank.masks.columns(control.axes):
        given = UNBOUNDED if low is None or high is None else Bounds(low[column], high[column])
        bounds.append(given if guard is None else given.within(guard.bounds(column)))
    return Follows(
        slot.cycle,
        control.axes,
        slot.index,
        slot.ring.targets,
        lambda: slot.rapid_rate,
        lost,
        bounds,
        control.value or 1.0,
    )


def _follow_from(slot: ProgramSlot, control: Control, _left: float, _waited: bool) -> None:
    slot.follow_from = control.values


def _reference(slot: ProgramSlot, control: Control, _left: float, _waited: bool) -> Barrier | None:
    assert control.values is not None
    _check_lease(slot, control.axes)
    return Refers(slot.cycle, control.axes, control.values, slot.index)


def _settle(slot: ProgramSlot, control: Control, left: float, waited: bool) -> Barrier | None:
    cycle, bank, row = slot.cycle, slot.cycle.bank, slot.cycle.row
    if not waited:
        return AtRest(cycle, control.axes & ~cycle.couplings.mask)
    setpoints = row.ordered.tolist()
    encoders = (row.actual if bank.shaper is None else row.actual - bank.shaper.added).tolist()
    # an encoder that moves along with what it follows is behind
    ordered = bank.exact | cycle.couplings.superimposed()
    for column in bank.masks.columns(ordered & bank.energized & bank.positioned):
        encoders[column] = setpoints[column]
    values = (*setpoints, *encoders)
    if cycle.emit(EventKind.SETTLED, slot.index, control.line, left, token=control.token, values=values):
        return None
    # the planner waits for this report: it is made again as soon as there is room
    return NextCycle(cycle)


def _output(slot: ProgramSlot, control: Control, _left: float, _waited: bool) -> Barrier | None:
    if slot.cycle.estop:
        raise BarrierFault(FaultCode.EMERGENCY_STOP, -1)
    slot.cycle.io.set(control.channel, control.value, slot.index)
    slot.cycle.io.scale(control.channel, control.axes, control.seconds)
    return None


def _input(slot: ProgramSlot, control: Control, left: float, _waited: bool) -> Barrier | None:
    cycle, mode, column = slot.cycle, WaitMode(control.operation), control.channel

    def report(value: float, seconds: float, left: float = 0.0) -> None:
        cycle.emit(EventKind.INPUT, slot.index, control.line, left, token=column, values=(value, seconds))

    value = cycle.io.value(column)
    level = mode is (WaitMode.LOW if value == 0.0 else WaitMode.HIGH)
    if mode is not WaitMode.IMMEDIATE and not level:
        cycle.emit(EventKind.INPUT_WAIT, slot.index, control.line, left, token=column)
        return InputWait(cycle, column, mode, control.seconds, report)
    report(value, 0.0, left)
    return None


def _finish(slot: ProgramSlot, control: Control, left: float, _waited: bool) -> Barrier | None:
    superimposed = slot.cycle.couplings.superimposed(slot.index)
    if superimposed:
        slot.cycle.couplings.uncouple(superimposed)
        return AtRest(slot.cycle, superimposed, exchanged=True)
    if control.operation:
        slot.cycle.io.make_safe(slot.index)
    slot.finish(control.line, left)
    return None


def _payload(slot: ProgramSlot, control: Control, _left: float, _waited: bool) -> Barrier | None:
    if slot.cycle.feed_forward is not None:
        slot.cycle.feed_forward.choose(control.operation)
    return None


def _tool(slot: ProgramSlot, control: Control, _left: float, _waited: bool) -> Barrier | None:
    shaper = slot.cycle.bank.shaper
    if shaper is not None:
        shaper.choose(control.operation)
    return None


def _advance(slot: ProgramSlot, control: Control, _left: float, _waited: bool) -> Barrier | None:
    shaper = slot.cycle.bank.shaper
    if shaper is not None and shaper.advance is not None:
        shaper.advance.choose(control.value)
    return None


def _mesh(slot: ProgramSlot, control: Control, left: float, _waited: bool) -> Barrier | None:
    cycle, use = slot.cycle, MeshUse(control.operation)
    _check_lease(slot, control.axes)
    _refuse(slot, control.axes & cycle.motions.mask, FaultCode.AXIS_BUSY)
    assert cycle.bed is not None
    if use is MeshUse.MET:
        _check_homed(slot, control.axes)
        cycle.bed.take()
    else:
        cycle.bed.switch(on=use is MeshUse.ON)
    reported = cycle.emit(EventKind.MESHED, slot.index, control.line, left, token=int(use))
    # a start in the midst of a program goes by it: it is reported again as soon as there is room
    return None if reported else NextCycle(cycle)


def _passed(slot: ProgramSlot, control: Control, left: float, _waited: bool) -> Barrier | None:
    slot.cycle.emit(EventKind.PASSED, slot.index, control.line, left)
    return None


_Rule = Callable[["ProgramSlot", Control, float, bool], Barrier | None]
_RULES: Mapping[ControlKind, _Rule] = MappingProxyType(
    {
        ControlKind.LINE_START: _line_start,
        ControlKind.LINE_END: _line_end,
        ControlKind.BEGIN: _begin,
        ControlKind.END: _end,
        ControlKind.WAIT: _wait,
        ControlKind.DWELL: _dwell,
        ControlKind.RAPID: _rapid,
        ControlKind.SPEED: _speed,
        ControlKind.TORQUE: _torque,
        ControlKind.AXIS: _axis,
        ControlKind.HALT_AXES: _halt,
        ControlKind.PAUSE: _pause,
        ControlKind.FINISH: _finish,
        ControlKind.SETTLE: _settle,
        ControlKind.OUTPUT: _output,
        ControlKind.INPUT: _input,
        ControlKind.HOME: _home,
        ControlKind.REFERENCE: _reference,
        ControlKind.PROBE: _probe,
        ControlKind.THREAD: _thread,
        ControlKind.FOLLOW: _follow,
        ControlKind.FOLLOW_FROM: _follow_from,
        ControlKind.PAYLOAD: _payload,
        ControlKind.TOOL: _tool,
        ControlKind.ADVANCE: _advance,
        ControlKind.MESH: _mesh,
        ControlKind.PASSED: _passed,
    }
)
