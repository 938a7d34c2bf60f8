"""Runs of lines that the check of a program has interpreted, for the run of the same program behind it."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from mcserver.gcode.fast_path.run_state import FoundRun
from mcserver.gcode.semantics.commanded_state import CommandedState
from mcserver.gcode.semantics.modal import ModalState
from mcserver.motion.canonical import MotionLine, PathRun, PlainRun

# Lines that are kept at most, some 60 bytes each; later ones are interpreted twice.
MOST_LINES = 1 << 18


class _Kept(NamedTuple):
    """A run, the modal state before and behind it, and whether the lines behind it are of another kind."""

    run: PlainRun | PathRun
    before: ModalState
    behind: ModalState
    ended: bool


class KeptRuns:
    """Runs of one program in order, to be taken in order too.

    A run is only taken where it begins with the modal state and the positions that it was interpreted with:
    it is then what interpreting its lines again would give, to the last bit.

    Attributes:
        filling: the check is under way: runs are kept, and none is taken.
    """

    def __init__(self) -> None:
        self.filling = True
        self._runs: deque[_Kept] = deque()
        self._count = 0

    def keep(self, found: FoundRun, before: ModalState, *, ended: bool) -> None:
        """Keep a run, unless it has blank lines, or there are too many already.

        Args:
            before: modal state. ended: the line behind the run was looked at, and is no part of it.
        """
        run, taken = found.values[0], found.taken
        if isinstance(run, MotionLine) or len(found.values) > 1:
            return
        if self.filling and taken == len(run) and self._count + taken <= MOST_LINES:
            self._runs.append(_Kept(run, before, found.modal, ended))
            self._count += taken

    def take(
        self, number: int, size: int, least: int, modal: ModalState, commanded: CommandedState
    ) -> FoundRun | None:
        """Return the modal state behind up to ``size`` lines from line ``number`` on, these, and their count,
        and advance the positions; None where they have to be interpreted.

        Args:
            least: fewer are not worth it, or may be a run of another kind.
        """
        if self.filling:
            return None
        runs = self._runs
        while runs and runs[0].run.line + len(runs[0].run) <= number:
            runs.popleft()
        if not runs or runs[0].run.line > number:
            return None
        run, before, behind, ended = runs[0]
        first = number - run.line
        count = min(size, len(run) - first)
        if modal != before or (count < size and not ended) or count < least:
            return None
        # amid a run that changes it the modal state is not known
        if count < len(run) and before != behind:
            return None
        if commanded.poses or not commanded.synced(run.axes):
            return None
        if [commanded.positions[axis] for axis in run.axes] != run.points[first].tolist():
            return None
        part = run if count == len(run) else run.part(first, first + count)
        commanded.positions.update(zip(part.axes, part.points[-1].tolist(), strict=True))
        return FoundRun(behind, (part,), count)
