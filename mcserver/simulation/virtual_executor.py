"""The executor in this process, on a virtual clock, with rings in memory: for `mcserver simulate` and
tests.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from mcserver.drives.bus import DriveBus
from mcserver.drives.registry import VIRTUAL_FACTORIES, create_buses
from mcserver.executor.block import Block, LineEvents
from mcserver.executor.entries import Array, EventKind, ExecutorEvent
from mcserver.executor.executor import Executor
from mcserver.executor.faces import ExecutorFaces
from mcserver.executor.process_start import StoredReference
from mcserver.executor.shm.shared_memory import PARTS, SharedParts, parts_over
from mcserver.machine.machine_file import Machine
from mcserver.planning.start_state import StartState

Recorder = Callable[[float, int, Array, Array], None]


@runtime_checkable
class BlockRecorder(Protocol):
    """A recorder that takes many cycles in one go: with it they are played so where that can be."""

    def __call__(self, time: float, line: int, setpoint: Array, actual: Array) -> None: ...

    def block(self, times: Array, block: Block) -> None:
        """Record cycles at these executor times, shape (n,) [s]."""


class VirtualExecutor(ExecutorFaces):
    """An executor whose time passes as `step` is called.

    Args:
        buses: drives of another make; None: as the machine file says, those on CAN simulated.
        homed: every axis counts as homed. references: those of an earlier start, by axis number.

    Attributes:
        recorder: called after each cycle with (t, line, setpoint (K,), actual (K,));
            the arrays are the executor's own, to be copied. executor: the executor itself.
    """

    def __init__(
        self,
        machine: Machine,
        *,
        buses: Sequence[DriveBus] | None = None,
        recorder: Recorder | None = None,
        homed: bool = True,
        references: Mapping[int, StoredReference] | None = None,
    ) -> None:
        self.machine = machine
        self._parts = parts_over([None] * PARTS, machine)
        self.mailbox.initialise()
        self.recorder = recorder
        self.buses = list(create_buses(machine, VIRTUAL_FACTORIES) if buses is None else buses)
        self.executor = Executor(
            machine,
            self.buses,
            self._parts.rings,
            self.mailbox,
            self._parts.feedback,
            self._parts.events,
            references=references,
            assume_homed=homed,
        )
        self._cycles = 0
        self._reports: list[ExecutorEvent | LineEvents] = []

    @property
    def parts(self) -> SharedParts:
        return self._parts

    def bring_to(self, start: StartState) -> None:
        """Let axes be energized and homed, inputs and outputs have values, and the tool be in, as in a state;
        time stands.

        Raises:
            RuntimeError: a drive does not energize.
        """
        self.executor.mount(start.tool)
        self.executor.assume(
            energized=self.machine.mask_of(start.energized),
            homed=self.machine.mask_of(start.homed),
            inputs=start.inputs,
            outputs=start.outputs,
        )

    def u(self, slot: int) -> float:
        """Return where the program in a slot is on its time axis [cycles]."""
        return self.executor.u(slot)

    def step(self, cycles: int = 1) -> None:
        """Let cycles pass."""
        executor, recorder = self.executor, self.recorder
        cycle_s = self.machine.cycle_s
        # a look at what a protocol asks for takes a tenth of a cycle
        blocks = recorder if cycles > 1 and isinstance(recorder, BlockRecorder) else None
        end = self._cycles + cycles
        while self._cycles < end:
            if blocks is not None and end - self._cycles > 1:
                block = executor.play_block(self._cycles * cycle_s, end - self._cycles - 1)
                if block is not None:
                    last = self._cycles + len(block.lines)
                    times: Array = np.arange(self._cycles, last, dtype=np.float64) * cycle_s
                    blocks.block(times, block)
                    self._cycles += len(block.lines)
                    if len(block.events.line):
                        self._reports += [*self._parts.events.take(), block.events]
            executor.cycle(self._cycles * cycle_s)
            self._cycles += 1
            if recorder is not None:
                recorder(executor.time, executor.line(), executor.row.setpoint, executor.row.actual)

    def miss(self, cycles: int) -> None:
        """Let cycles be missed, as where the computer is held up: time passes, and nothing is exchanged."""
        self._cycles += cycles
        self.executor.late_cycles += cycles

    def events(self) -> list[ExecutorEvent]:
        """Reports since the last call, in order."""
        return [event for report in self.reports() for event in _one_by_one(report)]

    def reports(self) -> list[ExecutorEvent | LineEvents]:
        """Return what `events` returns, with those of lines in columns where they came in blocks."""
        reports, self._reports = [*self._reports, *self._parts.events.take()], []
        return reports

    @property
    def time(self) -> float:
        """Executor time of the next cycle [s]."""
        return self._cycles * self.machine.cycle_s

    @property
    def at_rest(self) -> bool:
        """Whether no program runs and no positioned axis is commanded to move."""
        return self.executor.at_rest

    def close(self) -> None:
        """Give the drives back."""
        self.executor.close()


def _one_by_one(report: ExecutorEvent | LineEvents) -> list[ExecutorEvent]:
    if isinstance(report, ExecutorEvent):
        return [report]
    columns = (report.line.tolist(), report.time.tolist(), report.ends.tolist())
    return [
        ExecutorEvent(EventKind.LINE_END if ends else EventKind.LINE_START, report.program, line, time)
        for line, time, ends in zip(*columns, strict=True)
    ]
