"""What a machine's node publishes of its state."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from mcclient.telemetry import Samples
from mcclient.types import Info, MachineStatus, ModelReply

from mcserver.ros.diagnosis import KIND as DIAGNOSTICS
from mcserver.ros.diagnosis import diagnosis
from mcserver.ros.frames import TF, Frames
from mcserver.ros.graph import Qos
from mcserver.ros.interfaces import interfaces
from mcserver.ros.joints import Joint, units_of
from mcserver.ros.node import Node
from mcserver.ros.servo_topics import ServoSaid
from mcserver.ros.stamps import stamp_of

JOINT_STATE = "sensor_msgs/msg/JointState"
LATCHED = Qos(depth=1, transient_local=True)
TF_HZ = 50.0
DIAGNOSTICS_S = 1.0


class StateTopics:
    """``joint_states``, ``robot_description``, tf, ``/diagnostics`` and the scaling of speed.

    Args:
        frames: of a machine that has a URDF.
        rate_hz: of ``joint_states``, as far as the machine's cycles allow.
    """

    def __init__(
        self,
        node: Node,
        info: Info,
        model: ModelReply,
        joints: tuple[Joint, ...],
        frames: Frames | None,
        rate_hz: float,
    ) -> None:
        self._machine = info.machine
        self._joints = joints
        self._units = units_of(joints)
        self._rotary = np.array([joint.rotary for joint in joints])
        # Unix time of executor time 0
        self._epoch = info.epoch
        self._stride = max(1, round(1.0 / (rate_hz * info.cycle_s)))
        self._tf_stride = max(1, round(1.0 / (TF_HZ * info.cycle_s)))
        self._next_tf = 0
        self._diagnosed_at = -math.inf
        self._joint_states = node.publisher("joint_states", JOINT_STATE)
        self._diagnostics = node.publisher("/diagnostics", DIAGNOSTICS)
        self._scaling = node.publisher(
            "speed_scaling_state_broadcaster/speed_scaling", "std_msgs/msg/Float64"
        )
        self._frames = frames
        if frames is not None:
            described = node.publisher("robot_description", "std_msgs/msg/String", LATCHED)
            described.publish(interfaces().make("std_msgs/msg/String", data=model.urdf))
            self._tf = node.publisher("/tf", TF, Qos(depth=100))
            fixed = frames.fixed(stamp_of(self._epoch))
            if fixed.transforms:
                node.publisher("/tf_static", TF, LATCHED).publish(fixed)

    def publish_samples(self, samples: Samples) -> None:
        """Publish cycles, as many of them as the rates ask for."""
        make = interfaces().make
        for row, time_s in enumerate(samples.time_s.tolist()):
            cycle = samples.seq + row
            if cycle % self._stride and cycle < self._next_tf:
                continue
            position = samples.actual[row] * self._units
            stamp = stamp_of(self._epoch + time_s)
            if not cycle % self._stride:
                message = make(
                    JOINT_STATE,
                    header=make("std_msgs/msg/Header", stamp=stamp),
                    name=[joint.name for joint in self._joints],
                    position=position,
                    velocity=samples.velocity[row] * self._units,
                    # a linear axis's torque is its motor's, which is not the force that ROS has here
                    effort=np.where(self._rotary, samples.torque[row], np.nan),
                )
                self._joint_states.publish(message)
            if self._frames is not None and cycle >= self._next_tf:
                self._next_tf = cycle + self._tf_stride
                values = dict(zip((joint.name for joint in self._joints), position.tolist(), strict=True))
                self._tf.publish(self._frames.moving(stamp, values))

    def publish_status(self, status: MachineStatus, servo: Callable[[MachineStatus], ServoSaid]) -> None:
        """Publish what changes less often; ``servo`` is asked with each of the diagnostics."""
        self._epoch = status.wall - status.t
        held = any(program.servo is not None and program.state == "held" for program in status.programs)
        scaling = 0.0 if held else status.override
        self._scaling.publish(interfaces().make("std_msgs/msg/Float64", data=scaling))
        stamp = stamp_of(status.wall)
        if self._frames is not None and status.tools:
            self._tf.publish(self._frames.tips(stamp, status.tools))
        if status.t >= self._diagnosed_at + DIAGNOSTICS_S or status.t < self._diagnosed_at:
            self._diagnosed_at = status.t
            self._diagnostics.publish(diagnosis(self._machine, status, self._joints, servo(status), stamp))
