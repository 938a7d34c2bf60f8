"""Plan the approach to a line in the middle of a program: lift to a safe height, move over, move down."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Literal

import msgspec

from mcserver.errors import ServiceError
from mcserver.gcode.semantics.program_units import motor_rpm
from mcserver.machine.axis import Axis, axis_name
from mcserver.machine.machine_file import Machine
from mcserver.machine.recovery_section import Recovery
from mcserver.motion.canonical import MeshUse
from mcserver.planning.start_state import Awaited, StartState, StateBefore

# Share of an axis's velocity limit by default.
SHARE = 0.1
# Distance below which an axis is at its target [m or rad].
SAME = 1e-9

Outputs = Literal["set", "leave"]


class Confirmation(msgspec.Struct, frozen=True):
    """Answers of a person to the needs of an approach.

    Attributes:
        way: the axes may move along the planned way. outputs: ``set`` restores the outputs and speeds of the
            program, ``leave`` keeps the present ones; None: not answered.
    """

    way: bool = False
    outputs: Outputs | None = None


NO_CONFIRMATION = Confirmation()


class WayStep(msgspec.Struct, frozen=True):
    """One step of an approach: a move of axes, or a wait for an input.

    Attributes:
        text: description for people. targets: end of the move, by axis number as text [mm, deg]; empty: no
            axis moves. rapid: each axis moves at its own limits; otherwise at the approach velocity.
    """

    text: str
    targets: dict[str, float] = {}
    rapid: bool = False


class AxisStart(msgspec.Struct, frozen=True):
    """An axis of a program that is to start at a line.

    Attributes:
        now: present position [mm, deg]. there: position in the program before the line [mm, deg]; None:
            unknown. energized: the axis is energized in the program there. away: the two positions differ by
            more than the axis's in-position tolerance, or ``there`` is unknown.
    """

    axis: int
    unit: str
    now: float
    there: float | None
    energized: bool
    away: bool


class Switched(msgspec.Struct, frozen=True):
    """An output, or the speed or torque of an axis, that differs from its value in the program.

    Attributes:
        name: of the output, or such as ``axis 3``. there: value in the program before the line. now: present
            value. unit: of both values.
    """

    name: str
    there: float
    now: float
    unit: str = ""


class Need(msgspec.Struct, frozen=True):
    """What has to be resolved before a program starts at a line: code, message and remedy.

    Attributes:
        confirm: field of the request that confirms it, ``way`` or ``outputs``; empty: it cannot be confirmed.
    """

    code: str
    message: str
    hint: str
    confirm: str = ""


class Approach(msgspec.Struct, frozen=True):
    """Approach of a program to its first line.

    Attributes:
        energize: axes that are energized first. axes: of the program. way: steps in order; empty: the axes
            are in place. switched: values that differ from the program's. needs: to be resolved first.
        lines: G-code of the approach, in machine coordinates. lines_with_outputs: the same, and lines that
            restore ``switched``. Both wait for inputs of ``[dialect.waits]``; ``lines`` only for those whose
            outputs are as in the program.
    """

    energize: tuple[int, ...]
    axes: tuple[AxisStart, ...]
    way: tuple[WayStep, ...]
    switched: tuple[Switched, ...]
    needs: tuple[Need, ...]
    lines: tuple[str, ...]
    lines_with_outputs: tuple[str, ...]


def plan_approach(
    machine: Machine,
    state: StateBefore,
    now: StartState,
    lease: Iterable[int],
    running: Mapping[int, float] = {},
) -> Approach:
    """Plan the approach from the axes' present positions to those before a line.

    Args:
        state: of the program before the line. now: present state of the machine. lease: the program's axes.
        running: axes that turn or push at present (`turning_and_pushing`).
    """
    # the second drive of a gantry follows its leader
    leased = set(lease).difference(machine.followers)
    moved = state.energized & leased
    # axes at a speed or torque have no position to restore, and G1030 and G1040 energize them
    energize = tuple(sorted(moved - state.torques.keys() - state.speeds.keys()))
    free = free_axes(machine)
    known = {axis: state.positions[axis] for axis in energize if axis not in state.unknown | free}
    spindle = machine.dialect.spindle
    if spindle in known:
        # M19 orients the spindle: restore its angle, not its count of turns
        at = now.positions[spindle]
        known[spindle] = at + math.remainder(known[spindle] - at, math.tau)
    starts = []
    for axis in machine.axes:
        if axis.index not in leased:
            continue
        there = known.get(axis.index)
        scale = axis.type.si_per_unit
        held = axis.index in energize and axis.index not in free
        away = held and (there is None or abs(there - now.positions[axis.index]) > axis.in_position)
        starts.append(
            AxisStart(
                axis.index,
                axis.type.unit,
                now.positions[axis.index] / scale,
                None if there is None else there / scale,
                axis.index in moved,
                away,
            )
        )
    away_known = {each.axis for each in starts if each.away and each.there is not None}
    recovery = machine.recovery
    if recovery is not None and recovery.safe_axis is not None and recovery.safe_axis not in known:
        # the program has no known position of the machine's safe axis
        recovery = None
    moves = _moves(recovery, away_known, known)
    switched, restoring = _switched(machine, state, now, leased, running)
    waiting = [each for each in state.awaited if _is_restored(each, state, now)]
    waits = _wait_lines(machine, waiting)
    if restoring:
        settle = 2.0 if recovery is None else recovery.settle_s
        settle = max([settle, *(each.wait.settle for each in state.awaited)])
        restoring += [f"G04 P{settle:g}", *_wait_lines(machine, state.awaited)]
    # a spindle has to turn before the axes move down to the work
    at = len(moves) - 1 if moves and recovery is not None and recovery.safe_axis is not None else 0
    codes: list[str] = []
    place = dict(now.positions)
    for move in moves:
        codes.append(move.code(machine, recovery, place))
        place.update(move.targets)
    # axes within tolerance move too: increments of the program start from the exact positions
    rest = {axis: end for axis, end in known.items() if abs(end - place[axis]) > SAME}
    if rest:
        codes.append(_Move("", rest, rapid=False).code(machine, recovery, place))
    capture = [" ".join(f"G1010 P{axis}" for axis in energize)] if energize else []
    return Approach(
        energize=energize,
        axes=tuple(starts),
        way=(
            *(move.step(machine) for move in moves[:at]),
            *(WayStep(text) for text in _wait_texts(machine, waiting)),
            *(move.step(machine) for move in moves[at:]),
        ),
        switched=tuple(switched),
        needs=tuple(_needs(machine, state, now, starts, switched, by_machine=recovery is not None)),
        lines=(*capture, *codes[:at], *waits, *codes[at:]),
        lines_with_outputs=(*capture, *codes[:at], *(restoring or waits), *codes[at:]),
    )


class _Move(msgspec.Struct):
    """A move of an approach, in SI; ``verb``: for people."""

    verb: str
    targets: dict[int, float]
    rapid: bool

    def step(self, machine: Machine) -> WayStep:
        """Return the move as shown to people."""
        ends = {axis: end / _axis(machine, axis).type.si_per_unit for axis, end in self.targets.items()}
        places = ", ".join(
            f"{axis_name(axis)} to {end:.3f} {_axis(machine, axis).type.unit}" for axis, end in ends.items()
        )
        text = f"{self.verb}: {places}" + ("" if self.rapid else ", slowly")
        return WayStep(text, {str(axis): end for axis, end in ends.items()}, self.rapid)

    def code(self, machine: Machine, recovery: Recovery | None, place: Mapping[int, float]) -> str:
        """Return the move as a line in machine coordinates; ``place``: positions before it."""
        words = " ".join(
            f"[{axis}]{end / _axis(machine, axis).type.si_per_unit:.9f}" for axis, end in self.targets.items()
        )
        axes = [_axis(machine, axis) for axis in self.targets]
        if self.rapid or any(axis.profiled for axis in axes):
            return f"G00 {words}"
        duration = max(
            abs(self.targets[axis.index] - place[axis.index]) / _velocity(axis, recovery) for axis in axes
        )
        return f"G61 G93 F{60.0 / max(duration, machine.cycle_s):.9f} G01 {words}"


def _moves(recovery: Recovery | None, away: set[int], known: Mapping[int, float]) -> list[_Move]:
    """Return the moves of the axes ``away`` to their known positions."""
    if not away:
        return []
    safe = None if recovery is None else recovery.safe_axis
    groups = [set(group) & away for group in recovery.order] if recovery is not None else []
    rest = away - {axis for group in groups for axis in group} - {safe}
    # without a safe height, what is clear of the work is unknown: one axis at a time, never a diagonal
    groups += [rest] if safe is not None else [{axis} for axis in sorted(rest)]
    over = [{axis: known[axis] for axis in sorted(group)} for group in groups if group]
    if safe is None or recovery is None:
        return [_Move("move", targets, rapid=False) for targets in over]
    if not over:
        return [_Move("down", {safe: known[safe]}, rapid=False)]
    lift = _Move("lift", {safe: recovery.safe_position}, rapid=False)
    down = _Move("down", {safe: known[safe]}, rapid=False)
    return [lift, *(_Move("over", targets, rapid=True) for targets in over), down]


def _switched(
    machine: Machine,
    state: StateBefore,
    now: StartState,
    leased: set[int],
    running: Mapping[int, float],
) -> tuple[list[Switched], list[str]]:
    """Return the values that differ from the program's, and the lines that restore these."""
    found: list[Switched] = []
    codes: list[str] = []
    for column, output in enumerate(machine.outputs):
        there, at = state.outputs.get(column), now.outputs[column]
        if there is None or there == at:
            continue
        found.append(Switched(output.name, there, at, output.unit))
        if output.digital:
            codes.append(f"M{64 if there else 65} P{output.number}")
        else:
            codes.append(f"M68 E{output.number} Q{there:.9f}")
    for index, speed in sorted(state.speeds.items()):
        if index in leased and speed:
            turn = _axis(machine, index).travel_per_motor_turn
            rpm, at = (motor_rpm(each, turn) for each in (speed, running.get(index, 0.0)))
            found.append(Switched(f"axis {index}", rpm, at, "RPM"))
            codes.append(f"G1030 [{index}]{rpm:.9f}")
    for index, torque in sorted(state.torques.items()):
        if index in leased and torque:
            found.append(Switched(f"axis {index}", torque, running.get(index, 0.0), "N·m"))
            codes.append(f"G1040 [{index}]{torque:.9f}")
    return found, codes


def _is_restored(each: Awaited, state: StateBefore, now: StartState) -> bool:
    """Return whether the outputs and the spindle before a wait are as in the program."""
    turns = each.spindle is not None and state.speeds.get(each.spindle)
    return not turns and all(state.outputs.get(column) == now.outputs[column] for column in each.outputs)


def _wait_lines(machine: Machine, awaited: Iterable[Awaited]) -> list[str]:
    waits = [each.wait for each in awaited]
    return [f"M66 P{machine.inputs[each.column].number} L3 Q{each.timeout:.9f}" for each in waits]


def _wait_texts(machine: Machine, awaited: Iterable[Awaited]) -> list[str]:
    waits = [each.wait for each in awaited]
    return [
        f'wait for the input "{machine.inputs[each.column].name}", {each.timeout:g} s at the most'
        for each in waits
    ]


def _needs(
    machine: Machine,
    state: StateBefore,
    now: StartState,
    starts: list[AxisStart],
    switched: list[Switched],
    *,
    by_machine: bool,
) -> list[Need]:
    """Return what has to be resolved first; ``by_machine``: the way is that of ``[recovery]``."""
    needs = []
    lost = [
        each.axis
        for each in starts
        if each.energized and _axis(machine, each.axis).homing is not None and each.axis not in now.homed
    ]
    if lost:
        names = " ".join(axis_name(axis) for axis in lost)
        needs.append(
            Need(
                "MC450",
                f"axes that do not know where they are: {names}",
                f"home them first: mcctl home {names}",
            )
        )
    unknown = [axis_name(each.axis) for each in starts if each.away and each.there is None]
    away = [axis_name(each.axis) for each in starts if each.away and each.there is not None]
    if unknown:
        message = (
            f"where the program had {', '.join(unknown)} is not known: a probe, a speed or a command moved it"
        )
        needs.append(Need("MC592", message, "jog there, then confirm the way", "way"))
    if away and not by_machine:
        message = f"{', '.join(away)} stand elsewhere than where the program has them before this line"
        hint = (
            "jog them there, or confirm the way; [recovery] of the machine file names one for programs "
            "that have its safe axis"
        )
        needs.append(Need("MC592", message, hint, "way"))
    if switched:
        names = ", ".join(f"{each.name} {each.there:g} {each.unit}".rstrip() for each in switched)
        answered = [each for each in state.awaited if not _is_restored(each, state, now)]
        then = "".join(f" and {text}," for text in _wait_texts(machine, answered))
        hint = f"say whether to set them{then} or to leave them"
        needs.append(Need("MC593", f"the program had switched {names}", hint, "outputs"))
    if state.scaled:
        names = ", ".join(machine.outputs[column].name for column in sorted(state.scaled))
        message = f"before this line M4 scales {names} with the speed, which no start in its midst sets up"
        needs.append(Need("MC593", message, "choose the line with the M4, or the one behind the M5"))
    if not state.mesh <= now.mesh:
        missing = max(state.mesh - now.mesh)
        line = {MeshUse.OFF: "M420 S0", MeshUse.ON: "M420 S1", MeshUse.MET: "G29"}[missing]
        message = "another mesh of the bed counts than at this line of the program"
        needs.append(Need("MC594", message, f"bring it back first: mcctl send '{line}'"))
    if state.ended:
        needs.append(Need("MC517", "the program has ended before this line", "choose an earlier line"))
    return needs


def refuse_needs(approach: Approach, *, way: bool, outputs: Outputs | None) -> None:
    """Refuse a start with needs that are not confirmed.

    Raises:
        ServiceError: MC450, MC517, MC592, MC593, MC594.
    """
    for need in approach.needs:
        if need.confirm == "way" and way:
            continue
        if need.confirm == "outputs" and outputs is not None:
            continue
        raise ServiceError(need.code, need.message, need.hint)


def free_axes(machine: Machine) -> frozenset[int]:
    """Return axes whose positions have no meaning outside of a program, such as a printer's extruders."""
    dialect = machine.dialect
    if dialect.profile != "printer":
        return frozenset()
    return frozenset(axis for letter, axis in dialect.letters.items() if letter not in "UVW")


def _velocity(axis: Axis, recovery: Recovery | None) -> float:
    given = None if recovery is None else recovery.approach_velocity
    if given is None or axis.type.unit != "mm":
        return axis.max_velocity * SHARE
    return min(given, axis.max_velocity)


def _axis(machine: Machine, index: int) -> Axis:
    found = machine.axis(index)
    assert found is not None
    return found
