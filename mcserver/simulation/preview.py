"""A simulated run as an approval shows it: report, path, envelope, and what it leaves changed."""

from __future__ import annotations

from typing import Any

import msgspec

from mcserver.executor.envelope_bounds import Envelope
from mcserver.machine.clearance_section import AGENT
from mcserver.machine.machine_file import Machine
from mcserver.planning.line_marks import LineMarks
from mcserver.planning.start_state import StartState, axis_word, frame_changes


class Preview(msgspec.Struct, frozen=True):
    """What a simulation says about a run that somebody asks for.

    Attributes:
        report: the object of ``mcserver simulate --json``. path: as `mcserver.simulation.time_sampler`
            gives it.
        marks: of its times. envelope: without tolerances. All three None for a text with faults.
        effects: what it leaves changed, in sentences for people. inputs: columns of those that it reads.
        pushed: axes that it commands a torque. outputs: of each output the least and the greatest value.
        setpoints: SHA-256 of every setpoint.
    """

    report: dict[str, Any]
    path: dict[str, Any]
    marks: LineMarks | None = None
    envelope: Envelope | None = None
    effects: tuple[str, ...] = ()
    inputs: frozenset[int] = frozenset()
    pushed: frozenset[int] = frozenset()
    outputs: tuple[tuple[float, float], ...] = ()
    setpoints: str = ""


def preview(
    text: str, machine: Machine, start: StartState, axes: tuple[int, ...], role: str = AGENT
) -> Preview:
    """Simulate a run of some axes from a state; ``role``: of the agent whose run it is to be."""
    # the server names this type only; what computes is loaded in the worker
    from mcserver.machine.machine_kinematics import build_kinematics
    from mcserver.simulation.envelope_meter import EnvelopeMeter
    from mcserver.simulation.setpoint_digest import SetpointDigest
    from mcserver.simulation.simulation import simulate
    from mcserver.simulation.starting_machine import starting_at
    from mcserver.simulation.time_sampler import TimeSampler, moments_for, path_of
    from mcserver.simulation.tool_poses import ToolPoses

    kinematics = build_kinematics(machine)
    poses = ToolPoses(machine, kinematics)
    sampler = TimeSampler(moments_for(1 + len(axes) + 3 * len(poses.numbers)), len(machine.axes))
    meter = EnvelopeMeter(starting_at(machine, start.positions), kinematics, axes)
    digest = SetpointDigest()
    found = simulate(
        text,
        machine,
        start=start,
        lease=frozenset(axes),
        kinematics=kinematics,
        takers=(sampler, meter, digest),
        role=role,
    )
    path = path_of(sampler, machine, poses, axes)
    if not found.report["ok"] or found.end is None:
        return Preview(found.report, path)
    turned = {machine.column_of(axis): speed for axis, speed in found.turned.items()}
    return Preview(
        report=found.report,
        path=path,
        marks=found.marks(),
        envelope=meter.envelope(found.report["duration_s"], turned),
        effects=tuple(effects_of(machine, start, found.end)),
        inputs=found.inputs_read,
        pushed=found.pushed,
        outputs=found.outputs,
        setpoints=digest.hexdigest(),
    )


def effects_of(machine: Machine, start: StartState, end: StartState) -> list[str]:
    """Name what a run leaves changed for those that come after it, besides where its axes stand."""
    found = [
        f"moves {system} {axis} by {distance}"
        for system, axis, distance in frame_changes(machine, start.frame, end.frame)
    ]
    for channel, before, after in zip(machine.outputs, start.outputs, end.outputs, strict=True):
        if before != after:
            value = ("on" if after else "off") if channel.digital else f"at {after:g}"
            found.append(f'leaves the output "{channel.name}" {value}')
    for what, axes in (
        ("turning or pushing", end.unsettled),
        ("energized", end.energized - start.energized),
        ("without energy", start.energized - end.energized),
        ("not homed", start.homed - end.homed),
    ):
        words = ", ".join(axis_word(machine, axis) for axis in sorted(axes))
        if words:
            found.append(f"leaves {words} {what}")
    return found
