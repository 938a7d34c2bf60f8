"""Makes the pipelines of a machine's programs: kinematics, where the axes are, modal state rebuilt."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import cast

from mcserver.config import Machine
from mcserver.executor.entries import MotionSink
from mcserver.gcode.interpreter import modal_before
from mcserver.gcode.modal import ModalState
from mcserver.machine_model import build_kinematics
from mcserver.programs.executor_port import ExecutorPort
from mcserver.programs.planner_thread import PipelineRequest
from mcserver.programs.service_pipeline import ServicePipeline


class PipelineFactory:
    """For one machine.

    Args:
        machine: its axes and tools.
        port: tells where the axes are when a program starts.

    Raises:
        ConfigurationError: the model of a tool does not fit.
    """

    def __init__(self, machine: Machine, port: ExecutorPort) -> None:
        self._machine = machine
        self._port = port
        self._kinematics = build_kinematics(machine)
        # a solver keeps scratch memory, so what runs beside the planner thread has its own
        self._second_kinematics = build_kinematics(machine)
        self._second_lock = threading.Lock()

    def prepare(self, before: Sequence[str]) -> object:
        """Modal state after lines that are only read; from any thread.

        Raises:
            ProgramRejected: one of them has a fault.
        """
        with self._second_lock:
            return modal_before(
                before,
                len(before) + 1,
                self._machine,
                kinematics=self._second_kinematics,
                positions=self._port.positions(),
            ).modal

    def make(self, request: PipelineRequest, sink: MotionSink) -> ServicePipeline:
        """A program's pipeline, in the planner thread."""
        return ServicePipeline(
            self._machine,
            sink,
            kinematics=self._kinematics,
            positions=self._port.positions(),
            energized=self._port.energized(),
            lease=request.axes,
            modal=cast(ModalState | None, request.modal),
        )
