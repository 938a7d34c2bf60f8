"""Interpret batches of simple blocks: the same values as line by line, without an object for each.

Lines of G01 to G03 come as `PathBatch`.

Bit for bit: numbers are read as `float` reads them; products, sums, quotients and comparisons are the same
IEEE operations in the same order (an accumulated sum adds one after the other); the root of the sum of
squares is `math.hypot` itself, since `numpy.hypot` may differ in the last bit.
"""

from __future__ import annotations

from collections.abc import Sequence

from mcserver.gcode.fast_path.code_text import CodeText
from mcserver.gcode.fast_path.interpreted_batch import MIN_LINES, InterpretedBatch
from mcserver.gcode.fast_path.path_batches import PathBatchInterpreter
from mcserver.gcode.fast_path.tip_batches import TipBatchInterpreter
from mcserver.gcode.fast_path.vocabulary import vocabulary_of
from mcserver.gcode.semantics.block_state import Setup
from mcserver.gcode.semantics.commanded_state import CommandedState
from mcserver.gcode.semantics.modal import ModalState

MAX_LINES = 4096
_FIRST_WINDOW = 32
_GROWTH = 4
_MAX_BACKOFF = 64


class BatchInterpreter:
    """Finds and interprets batches, with a window that adapts to the program.

    The window grows with the batches found, so that short batches do not read the same lines repeatedly.
    After each failed attempt the wait for the next one doubles, so that single other lines between batches,
    and programs without batches, cost little.
    """

    __slots__ = ("_backoff", "_paths", "_retry_at", "_tips", "_window")

    def __init__(self, setup: Setup) -> None:
        vocabulary = vocabulary_of(setup.machine)
        self._paths = PathBatchInterpreter(setup, vocabulary)
        self._tips = TipBatchInterpreter(setup, vocabulary)
        self._window = _FIRST_WINDOW
        self._backoff = 1
        self._retry_at = 0

    def window(self, number: int) -> int:
        """Return how many lines from line ``number`` on an attempt would read; 0: no attempt now."""
        return 0 if number < self._retry_at else self._window

    def interpret(
        self, texts: Sequence[str], number: int, modal: ModalState, commanded: CommandedState, most: int
    ) -> InterpretedBatch | None:
        """Interpret the batch at the beginning of the lines, and advance the positions."""
        size = min(len(texts), self.window(number), most)
        if size < MIN_LINES:
            return None
        found = None
        led = modal.tool is not None or (modal.frame is not None and modal.frame.tip_tool is not None)
        if not (modal.exact_next or modal.absolute_centres) and (led or not commanded.poses):
            interpreter = self._tips if led else self._paths
            found = interpreter.interpret(CodeText.of(texts[:size]), number, modal, commanded)
        if found is None:
            if self._backoff > 1:
                self._window = _FIRST_WINDOW
            self._retry_at = number + self._backoff
            self._backoff = min(2 * self._backoff, _MAX_BACKOFF)
            return None
        taken = found.taken
        self._retry_at = 0
        self._backoff = 1
        self._window = min(MAX_LINES, max(_FIRST_WINDOW, taken * (_GROWTH if taken == size else 2)))
        return found
