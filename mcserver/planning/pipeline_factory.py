"""Makes the pipelines of a machine's programs: kinematics, and where the axes are."""

from __future__ import annotations

from mcserver.executor.entries import MotionSink
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.planning.planner_messages import PipelineRequest
from mcserver.planning.service_pipeline import ServicePipeline
from mcserver.service.executor_view import ExecutorView


class PipelineFactory:
    """For one machine.

    Args:
        machine: its axes and tools.
        view: tells where the axes are when a program starts.

    Raises:
        ConfigurationError: the model of a tool does not fit.
    """

    def __init__(self, machine: Machine, view: ExecutorView) -> None:
        self._machine = machine
        self._view = view
        self._kinematics = build_kinematics(machine)

    def make(self, request: PipelineRequest, sink: MotionSink) -> ServicePipeline:
        """A program's pipeline, in the planner's thread."""
        return ServicePipeline(
            self._machine,
            sink,
            kinematics=self._kinematics,
            positions=self._view.positions(),
            energized=self._view.energized(),
            lease=request.axes,
            modal=request.modal,
        )
