"""The shared memory of server, planner and executor: mailbox, feedback, events and the programs' rings.

It is anonymous (memfd): it has no name in the file system, and the kernel frees it with the last process that
maps it, however that process ends. So nothing is left behind.
"""

from __future__ import annotations

import ctypes
import mmap
import os
from collections.abc import Sequence
from dataclasses import dataclass

from mcserver.executor.shm.event_ring import EventRing, event_ring_size
from mcserver.executor.shm.feedback import FeedbackRing, feedback_ring_size
from mcserver.executor.shm.mailbox import SLOTS, CommandMailbox, mailbox_size
from mcserver.executor.shm.rings import CONTROLS, ROWS, ProgramRing, program_ring_size
from mcserver.executor.stopping import StopTimes, torque_axes
from mcserver.machine.machine_file import Machine

# mailbox, feedback, events, and a ring for each slot
PARTS = 3 + SLOTS
_ALIGNMENT = 4096
# of memfd_create(2)
_MFD_CLOEXEC = 1


@dataclass(frozen=True)
class SharedParts:
    """The parts of the block, as mapped by one process."""

    mailbox: CommandMailbox
    feedback: FeedbackRing
    events: EventRing
    rings: tuple[ProgramRing, ...]


def _sizes(machine: Machine) -> list[int]:
    axes = len(machine.axes)
    inputs, outputs = len(machine.inputs), len(machine.outputs)
    sizes = [
        mailbox_size(inputs, outputs),
        feedback_ring_size(axes, inputs=inputs, outputs=outputs),
        event_ring_size(axes),
    ]
    sizes += [program_ring_size(ROWS, CONTROLS, axes, torque_axes(machine))] * SLOTS
    return [-(-size // _ALIGNMENT) * _ALIGNMENT for size in sizes]


def create_block(machine: Machine) -> int:
    """Create a zeroed block for `map_block`; return its descriptor, which the caller closes."""
    descriptor = _anonymous_file()
    try:
        os.ftruncate(descriptor, sum(_sizes(machine)))
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def _anonymous_file() -> int:
    name = "mcserver-executor"
    if hasattr(os, "memfd_create"):
        return os.memfd_create(name)
    # a Python built for older systems, such as uv's, has no os.memfd_create, but this C library does
    create = ctypes.CDLL(None, use_errno=True).memfd_create
    descriptor: int = create(name.encode(), _MFD_CLOEXEC)
    if descriptor < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return descriptor


def map_block(descriptor: int, machine: Machine) -> SharedParts:
    """Map a block; it stays mapped while any of its parts exists, even after the descriptor is closed."""
    sizes = _sizes(machine)
    whole = memoryview(mmap.mmap(descriptor, sum(sizes)))
    offset = 0
    parts: list[memoryview] = []
    for size in sizes:
        parts.append(whole[offset : offset + size])
        offset += size
    return parts_over(parts, machine)


def parts_over(parts: Sequence[memoryview | None], machine: Machine) -> SharedParts:
    """Return the parts over pieces of a block; None: each in memory of this process."""
    axes, stops = len(machine.axes), StopTimes(machine)
    inputs, outputs = len(machine.inputs), len(machine.outputs)
    return SharedParts(
        CommandMailbox(parts[0], inputs=inputs, outputs=outputs),
        FeedbackRing(parts[1], axes, inputs=inputs, outputs=outputs),
        EventRing(parts[2], axes),
        tuple(ProgramRing(part, ROWS, CONTROLS, axes, stops, torque_axes(machine)) for part in parts[3:]),
    )


def map_feedback(descriptor: int, machine: Machine) -> FeedbackRing:
    """Map the feedback only, for a process that only reads: it cannot write to the block."""
    before, size = _sizes(machine)[:2]
    whole = memoryview(mmap.mmap(descriptor, before + size, prot=mmap.PROT_READ))
    inputs, outputs = len(machine.inputs), len(machine.outputs)
    return FeedbackRing(whole[before:], len(machine.axes), inputs=inputs, outputs=outputs)
