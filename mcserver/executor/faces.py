"""What an executor in a process of its own and one on a virtual clock have in common."""

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
        """Raises RuntimeError: the executor has not been started."""

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
        """Begin a program in a free slot; without a mask on all axes.

        Returns:
            Where its rows and control entries are put.
        """
        ring = self.sink(slot)
        mask = (1 << len(self.machine.axes)) - 1 if axes_mask is None else axes_mask
        self.mailbox.open_slot(
            slot, mask, ring.restart(), override=override, hold=hold, unhomed=unhomed, envelope=envelope
        )
        return ring

    def sink(self, slot: int) -> ProgramRing:
        """Return where the program in a slot puts its rows and control entries."""
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
