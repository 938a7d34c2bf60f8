"""The interface of an executor for its server, in a process of its own or on a virtual clock."""

from __future__ import annotations

from abc import ABC, abstractmethod

from mcserver.executor.envelope_bounds import Envelope
from mcserver.executor.shm.feedback import FeedbackRing, FeedbackState
from mcserver.executor.shm.mailbox import CommandMailbox
from mcserver.executor.shm.rings import ProgramRing
from mcserver.executor.shm.shared_memory import SharedParts
from mcserver.machine.machine_file import Machine


class ExecutorFaces(ABC):
    """The rings and the mailbox of an executor, as its server uses them."""

    machine: Machine

    @property
    @abstractmethod
    def parts(self) -> SharedParts:
        """The shared memory; raises RuntimeError before the executor has been started."""

    @property
    def mailbox(self) -> CommandMailbox:
        """Orders to the executor."""
        return self.parts.mailbox

    def open_slot(
        self,
        slot: int,
        axes_mask: int | None = None,
        *,
        override: float = 1.0,
        hold: bool = False,
        unhomed: bool = False,
        envelope: Envelope | None = None,
    ) -> ProgramRing:
        """Begin a program in a free slot; without a mask it may move all axes.

        Returns:
            The rings of its rows and control entries.
        """
        ring = self.sink(slot)
        mask = (1 << len(self.machine.axes)) - 1 if axes_mask is None else axes_mask
        self.mailbox.open_slot(
            slot, mask, ring.restart(), override=override, hold=hold, unhomed=unhomed, envelope=envelope
        )
        return ring

    def sink(self, slot: int) -> ProgramRing:
        """Return the rings of the program in a slot."""
        return self.parts.rings[slot]

    @property
    def feedback(self) -> FeedbackState:
        """The latest cycle.

        Raises:
            RuntimeError: no cycle has passed.
        """
        state = self.history.latest()
        if state is None:
            raise RuntimeError("no cycle has passed yet")
        return state

    @property
    def history(self) -> FeedbackRing:
        """The latest cycles."""
        return self.parts.feedback
