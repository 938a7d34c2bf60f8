"""The planner's process: ``python -m mcserver.planning.process``, with its machine on standard input.

A process of its own leaves the service's loop an interpreter to itself. One thread takes commands, lets the
planner do a piece of work, and sends its events. It ends when the server closes its end of the pipe.
"""

from __future__ import annotations

import contextlib
import gc
import os
import select
import signal
import socket
import sys
import time
from collections.abc import Callable, Sequence

import msgspec

from mcserver.executor.entries import ExecutorEvent
from mcserver.executor.shm.feedback import FeedbackState, SlotView
from mcserver.executor.shm.rings import ProgramRing
from mcserver.executor.shm.shared_memory import SharedParts, map_block
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.motion.warm_up import warm_up
from mcserver.planning.clearance_guard import ClearanceGuards
from mcserver.planning.exchanges import mounted_by
from mcserver.planning.line_buffer import LineBuffer
from mcserver.planning.message_pipe import MessagePipe
from mcserver.planning.pipeline import FaultRule, Pipeline
from mcserver.planning.planner import Planner
from mcserver.planning.planner_messages import PipelineRequest, PlannerCommand, PlannerStart
from mcserver.planning.shared_space import SharedSpace
from mcserver.planning.unhomed import machine_for
from mcserver.processes import freeze_heap

NICE = 5
# Longest time between two signs of life to the server [s].
PULSE_S = 0.5


class SharedPlannerPort:
    """`mcserver.planning.planner.PlannerPort` over the memory that the executor shares.

    Args:
        parts: of an executor that has run a cycle.
    """

    def __init__(self, parts: SharedParts) -> None:
        self._parts = parts

    def poll_events(self) -> list[ExecutorEvent]:
        return self._parts.events.take()

    def views(self, slots: Sequence[int]) -> list[SlotView]:
        override_of = self._parts.mailbox.effective_override
        newest = self._parts.feedback.newest_slots()
        return [SlotView(newest[slot][0], newest[slot][1], override_of(slot)) for slot in slots]

    def sink(self, slot: int) -> ProgramRing:
        ring = self._parts.rings[slot]
        # the server has told the executor where the program begins; the counters of this side still belong to
        # the program before
        ring.restart()
        return ring


class PipelineFactory:
    """Make the pipelines of one machine's programs.

    Args:
        machine: its axes and tools.
        feedback: the executor's newest cycle.

    Raises:
        ConfigurationError: the model of a tool, or the bodies, do not fit.
    """

    def __init__(self, machine: Machine, feedback: Callable[[], FeedbackState | None]) -> None:
        self._machine = machine
        self._kinematics = build_kinematics(machine)
        self._guards: ClearanceGuards | None = None
        if machine.clearance is not None:
            self._guards = ClearanceGuards(machine, SharedSpace(machine, feedback))

    def make(self, request: PipelineRequest, lines: LineBuffer, sink: ProgramRing, slot: int) -> Pipeline:
        """Make the pipeline of a program that begins now."""
        guard = None
        if self._guards is not None:
            guard = self._guards.guard(
                request.program,
                slot,
                request.axes,
                mounted_by(self._machine, request.start.frame),
                tell=sink.put_zones_ahead,
                role=request.role,
                by_hand=request.machine_coordinates,
            )
        return Pipeline(
            machine_for(self._machine, request.start.homed, moves_unhomed=request.unhomed),
            sink,
            start=request.start,
            lines=lines,
            kinematics=self._kinematics,
            lease=request.axes,
            on_fault=FaultRule.RETRY,
            machine_coordinates=request.machine_coordinates,
            approach=request.approach,
            guard=guard,
            controls=request.controls,
        )


def run(pipe: MessagePipe, planner: Planner) -> None:
    """Plan until an empty message comes or the other end closes."""
    decode = msgspec.msgpack.Decoder(PlannerCommand).decode
    encode = msgspec.msgpack.Encoder().encode
    poller = select.poll()
    poller.register(pipe, select.POLLIN)
    pulse = time.monotonic()
    try:
        while True:
            for message in _exchange(pipe, poller, planner.pause_s):
                if not message:
                    return
                planner.handle(decode(message))
            events = planner.turn()
            now = time.monotonic()
            if events or now - pulse >= PULSE_S:
                pulse = now
                pipe.send(encode(events))
    except (EOFError, OSError):
        # the server is gone; the executor stops the machine by itself
        return


def _exchange(pipe: MessagePipe, poller: select.poll, timeout_s: float) -> list[bytes]:
    """Wait for messages, and send what is still queued."""
    poller.modify(pipe, select.POLLIN | (select.POLLOUT if pipe.blocked else 0))
    messages = []
    for _, ready in poller.poll(1000.0 * timeout_s):
        if ready & select.POLLOUT:
            pipe.flush()
        if ready & ~select.POLLOUT:
            messages = pipe.receive()
    return messages


def main() -> int:
    """Run until the server says that there is no more, or is gone."""
    start = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=PlannerStart)
    # Ctrl-C reaches the whole process group; the server ends this process in order
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    pipe = MessagePipe(socket.socket(fileno=start.connection))
    parts = map_block(start.memory, start.machine)
    os.close(start.memory)
    warm_up()
    # planning is ahead of the motion and can wait a moment; callers of the server are waiting now
    os.nice(NICE)
    pipelines = PipelineFactory(start.machine, parts.feedback.latest)
    planner = Planner(SharedPlannerPort(parts), pipelines, time.monotonic)
    gc.collect()
    freeze_heap()
    # if the server is gone already, `run` finds out
    with contextlib.suppress(OSError):
        pipe.send(msgspec.msgpack.encode([]))
    run(pipe, planner)
    pipe.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
