"""What does not fit between a machine file and its URDF, all of it at once (``mcserver machine check``)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mckinematics.description import MachineDescription
from mckinematics.dynamics import JointDynamics
from mckinematics.errors import ModelError
from mckinematics.model import RobotModel
from mckinematics.search import LIMIT_SLACK
from mckinematics.solver import build_machine_tool, load_machine_model, refuse_shared_joints
from mckinematics.text import joint_text
from mckinematics.tool import Targets, ToolModel

# a start whose smallest singular value is below this leaves only few paths
POOR_CONDITIONING = 0.01


@dataclass(frozen=True)
class Finding:
    """One thing that does not fit.

    Attributes:
        message, hint: a sentence with the values, and what to change.
        tool, axis: numbers, where they apply.
        severity: ``error``: the machine cannot be used; ``warning``: some of its motions will be refused.
        code: stable code.
    """

    message: str
    hint: str
    tool: int | None = None
    axis: int | None = None
    severity: Literal["error", "warning"] = "error"
    code: str = ModelError.code


def check_machine(machine: MachineDescription) -> tuple[Finding, ...]:
    """Return every fault of the machine's tools; empty if all fit or there are no tools.

    Faults: a missing or broken URDF, an unknown frame, another number or kind of joints than axes, limits
    that leave no travel, a joint with two axes, a start outside a joint's limits, and, as a warning, a start
    that is singular.
    """
    if not machine.tools:
        return ()
    try:
        robot = load_machine_model(machine)
    except ModelError as error:
        return (_finding(error),)
    findings: list[Finding] = []
    tools: list[ToolModel] = []
    for tool in machine.tools:
        try:
            tools.append(build_machine_tool(robot, tool, machine))
        except ModelError as error:
            findings.append(_finding(error))
    try:
        refuse_shared_joints(tools)
    except ModelError as error:
        findings.append(_finding(error))
    for model in tools:
        findings += _start_findings(machine, model)
    if not any(finding.severity == "error" for finding in findings):
        findings += _torque_findings(machine, robot, tools)
    return tuple(findings)


def _torque_findings(machine: MachineDescription, robot: RobotModel, tools: list[ToolModel]) -> list[Finding]:
    try:
        dynamics = JointDynamics(robot, machine, {tool.number: tool for tool in tools})
    except ModelError as error:
        return [_finding(error)]
    start = {axis.index: axis.initial_position for axis in machine.axes}
    torques = dynamics.at_rest(np.array([[start[axis] for axis in dynamics.axes]]))[0]
    return [
        Finding(
            f"axis {axis} needs {abs(torque):.4g} N·m to be held at its start with the heaviest payload, of"
            f" {limit:.4g}",
            "start elsewhere, or with less payload: motion from there will be refused",
            axis=axis,
            severity="warning",
        )
        for axis, torque, limit in zip(dynamics.axes, torques.tolist(), dynamics.limits.tolist(), strict=True)
        if abs(torque) > limit
    ]


def _finding(error: ModelError) -> Finding:
    return Finding(error.message, error.hint, error.tool, error.axis)


def _start_findings(machine: MachineDescription, tool: ToolModel) -> list[Finding]:
    chain = tool.chain
    start = {axis.index: axis.initial_position for axis in machine.axes}
    joints = np.array([start[axis] for axis in chain.axes])
    findings = []
    for column, axis in enumerate(chain.axes):
        if not chain.lower[column] - LIMIT_SLACK <= joints[column] <= chain.upper[column] + LIMIT_SLACK:
            findings.append(
                Finding(
                    f"axis {axis} starts at {joint_text(chain, column, float(joints[column]))}, outside the"
                    f" limits of joint {chain.joint_names[column]!r}"
                    f" ({joint_text(chain, column, float(chain.lower[column]))} to"
                    f" {joint_text(chain, column, float(chain.upper[column]))})",
                    "set the drive's initial_position within them",
                    tool.number,
                    axis,
                )
            )
    positions, rotations = chain.forward(joints[None])
    jacobians = tool.linearise(joints[None], Targets(positions, rotations if tool.orientation else None))[1]
    conditioning = float(tool.conditioning(jacobians)[0])
    if conditioning < POOR_CONDITIONING:
        findings.append(
            Finding(
                f"tool {tool.number} starts in a singular position (smallest singular value"
                f" {conditioning:.2g}): paths from there may be refused",
                "set initial_position of its drives so that no limb is straight and no two wrist axes align",
                tool.number,
                severity="warning",
            )
        )
    return findings
