"""What goes out as 60B2h is the torque that the arm's model needs for the setpoints of that cycle."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from mckinematics.model import load_model

from mcserver.can.cob import Function
from mcserver.executor.entries import Control, ControlKind
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.machine.plausibility import find_doubts
from mcserver.motion.canonical import FeedGroup, MotionLine, RapidGroup
from mcserver.motion.geometry.curves import Array
from mcserver.planning.payload_entries import PayloadEntries
from tests.drives.can_rig import CanRig
from tests.drives.can_rig import machine as can_machine
from tests.kinematics import arm7

# a gear of 100, which takes that much of the torque
DEGREES_A_TURN, COUNTS, RATED = 3.6, 10_000, 2.0
DRIVE = (
    f'kind = "cia402"\nbus = "can{{bus}}"\nnode = {{node}}\ncounts_per_motor_rev = {COUNTS}\n'
    f"rated_torque = {RATED}\ntorque_feed_forward = true"
)
TOOLS = ("", "payload = { mass = 3.0 }")
MOVED = np.radians([20.0, -15.0, 10.0, 25.0, -30.0, 15.0, 60.0])


def rig(folder: Path, drive: str = DRIVE) -> CanRig:
    machine = arm7.machine(folder, tools=TOOLS, drive=drive, units_per_motor_rev=DEGREES_A_TURN)
    counts = [round(degrees / DEGREES_A_TURN * COUNTS) for degrees in arm7.START]
    made = CanRig(machine, positions=counts)
    made.program.position = np.radians(arm7.START)
    return made


def moved(made: CanRig, tools: int | None) -> list[list[int]]:
    """Moves all joints with some tools chosen; returns what each node's 60B2h was, cycle by cycle."""
    program = made.program
    program.start_line(1)
    program.capture()
    if tools is not None:
        program.control(ControlKind.PAYLOAD, operation=tools)
    program.move(dict(enumerate(np.radians(arm7.START) + MOVED)), 400)
    program.end_line()
    program.finish()
    made.run()
    return [
        [
            struct.unpack("<h", payload)[0]
            for port in made.ports.values()
            for identifier, payload in port.sent
            if identifier == Function.RPDO3 + axis.drive.node
        ]
        for axis in made.machine.axes
    ]


def expected(machine: Machine, setpoint: Array, mass: float) -> Array:
    """Torques at the motors in thousandths of the rated one, by RNEA of differences of setpoints, (N, 7)."""
    assert machine.urdf is not None
    model = load_model(machine.urdf).pinocchio_model
    if mass:
        frame = model.frames[model.getFrameId("tip")]
        load = pinocchio.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
        model.appendBodyToJoint(frame.parentJoint, load, frame.placement)
    data = model.createData()
    speed = (setpoint[2:] - setpoint[:-2]) / (2.0 * machine.cycle_s)
    change = np.diff(setpoint, 2, axis=0) / machine.cycle_s**2
    torques = [
        pinocchio.rnea(model, data, *each).copy() for each in zip(setpoint[1:-1], speed, change, strict=True)
    ]
    return np.array(torques) * math.radians(DEGREES_A_TURN) / (2.0 * math.pi) / RATED * 1000.0


@pytest.mark.parametrize(("tools", "mass"), [(0b01, 0.0), (0b10, 3.0), (None, 3.0)])
def test_each_drive_gets_the_torque_of_the_model_at_its_motor(
    tmp_path: Path, tools: int | None, mass: float
) -> None:
    made = rig(tmp_path)
    sent = np.array(moved(made, tools)).T
    wanted = expected(made.machine, made.setpoint, mass)
    moving = np.flatnonzero(np.abs(np.diff(made.setpoint, axis=0)).max(axis=1) > 1e-9)
    low, high = int(moving[0]) + 5, int(moving[-1]) - 5
    # accelerations are those of half a cycle before
    between = 0.5 * (wanted[low - 2 : high - 2] + wanted[low - 1 : high - 1])
    np.testing.assert_allclose(sent[low:high], between, atol=2.0)
    assert np.abs(wanted[low:high]).max() > 50.0


def test_without_the_key_no_model_is_loaded_for_the_cycle(tmp_path: Path) -> None:
    made = rig(tmp_path, DRIVE.replace("torque_feed_forward = true", ""))
    assert made.core._cycle.feed_forward is None
    assert not any(moved(made, None))


def test_a_chosen_tool_counts_from_the_start_of_its_line_and_only_where_it_changes(tmp_path: Path) -> None:
    machine = arm7.machine(tmp_path, tools=TOOLS, drive=DRIVE, units_per_motor_rev=DEGREES_A_TURN)
    kinematics = build_kinematics(machine)
    assert kinematics is not None
    entries = PayloadEntries(machine, kinematics.dynamics)
    lines = [
        MotionLine(3, (RapidGroup((0,), (0.1,), True, (2,)),)),
        MotionLine(4, (FeedGroup((), 1.0, carried=(2,)),)),
        MotionLine(5, (FeedGroup((), 1.0, carried=(2, 1)),)),
    ]
    for line in lines:
        entries.note(line)
    found = [entries.at(float(line.line), line.line) for line in lines]
    assert found == [
        [Control(ControlKind.PAYLOAD, 3.0, 3, operation=0b10)],
        [],
        [Control(ControlKind.PAYLOAD, 5.0, 5, operation=0b01)],
    ]


def test_a_drive_that_no_model_has_a_torque_for_is_warned_of(tmp_path: Path) -> None:
    described = arm7.machine(tmp_path, tools=TOOLS, drive=DRIVE, units_per_motor_rev=DEGREES_A_TURN)
    assert "MC024" not in {each.code for each in find_doubts(described)}
    plain = can_machine(1, drive="torque_feed_forward = true")
    assert [each.axis for each in find_doubts(plain) if each.code == "MC024"] == [0]
