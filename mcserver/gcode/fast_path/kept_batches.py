"""Batches of lines that the check of a program has interpreted, for the run of the same program behind it."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from mcserver.gcode.fast_path.interpreted_batch import InterpretedBatch
from mcserver.gcode.semantics.commanded_state import CommandedState
from mcserver.gcode.semantics.modal import ModalState
from mcserver.motion.canonical import MotionLine, PathBatch

# Lines that are kept at most, some 100 bytes each; later ones are interpreted twice.
MOST_LINES = 1 << 18


class _Kept(NamedTuple):
    """A batch, the modal state before and behind it, and whether the lines behind it are of another kind."""

    batch: PathBatch
    before: ModalState
    behind: ModalState
    ended: bool


class KeptBatches:
    """Batches of one program in order, to be taken in order too.

    A batch is only taken where it begins with the modal state and the positions that it was interpreted with:
    it is then what interpreting its lines again would give, to the last bit.

    Attributes:
        filling: the check is under way: batches are kept, and none is taken.
    """

    def __init__(self) -> None:
        self.filling = True
        self._batches: deque[_Kept] = deque()
        self._count = 0

    def keep(self, found: InterpretedBatch, before: ModalState, *, ended: bool) -> None:
        """Keep a batch, unless it has blank lines, or there are too many already.

        Args:
            before: modal state. ended: the line behind the batch was looked at, and is no part of it.
        """
        batch, taken = found.values[0], found.taken
        if isinstance(batch, MotionLine) or len(found.values) > 1:
            return
        if self.filling and taken == len(batch) and self._count + taken <= MOST_LINES:
            self._batches.append(_Kept(batch, before, found.modal, ended))
            self._count += taken

    def take(
        self, number: int, size: int, least: int, modal: ModalState, commanded: CommandedState
    ) -> InterpretedBatch | None:
        """Return the modal state behind up to ``size`` lines from line ``number`` on, these, and their count,
        and advance the positions; None where they have to be interpreted.

        Args:
            least: fewer are not worth it, or may be a batch of another kind.
        """
        if self.filling:
            return None
        batches = self._batches
        while batches and batches[0].batch.line + len(batches[0].batch) <= number:
            batches.popleft()
        if not batches or batches[0].batch.line > number:
            return None
        batch, before, behind, ended = batches[0]
        first = number - batch.line
        count = min(size, len(batch) - first)
        if modal != before or (count < size and not ended) or count < least:
            return None
        # amid a batch that changes it the modal state is not known
        if count < len(batch) and before != behind:
            return None
        if commanded.poses or not commanded.synced(batch.axes):
            return None
        if [commanded.positions[axis] for axis in batch.axes] != batch.points[first].tolist():
            return None
        part = batch if count == len(batch) else batch.part(first, first + count)
        commanded.positions.update(zip(part.axes, part.points[-1].tolist(), strict=True))
        return InterpretedBatch(behind, (part,), count)
