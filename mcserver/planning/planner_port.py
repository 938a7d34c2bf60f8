"""The executor as the planner's process sees it, through the memory that they share."""

from __future__ import annotations

from mcserver.executor.entries import ExecutorEvent, MotionSink
from mcserver.executor.shm.feedback import FeedbackState
from mcserver.executor.shm.shared_memory import SharedParts
from mcserver.machine.machine_file import Machine
from mcserver.service.executor_view import ExecutorView


class SharedPlannerPort(ExecutorView):
    """`mcserver.service.motion_port.PlannerPort` over shared memory.

    Args:
        machine: its axes. parts: of an executor that has run a cycle.
    """

    def __init__(self, machine: Machine, parts: SharedParts) -> None:
        super().__init__(machine, self._feedback)
        self._parts = parts

    def poll_events(self) -> list[ExecutorEvent]:
        return self._parts.events.take()

    def sink(self, slot: int) -> MotionSink:
        ring = self._parts.rings[slot]
        # what the server has told the executor about where the program begins in it stays right: only this
        # side's own notes are of the program before
        ring.restart()
        return ring

    def _feedback(self) -> FeedbackState:
        state = self._parts.feedback.latest()
        if state is None:
            raise RuntimeError("no cycle has passed yet")
        return state
