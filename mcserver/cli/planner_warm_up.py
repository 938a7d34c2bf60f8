"""The planner made ready, with a word to whoever waits for it."""

from __future__ import annotations

import threading

from mcserver.cli.console import narration
from mcserver.cli.program_lines import ProgramLines
from mcserver.motion.compiling import (
    COMPILING,
    PATIENCE_S,
    PLAIN,
    SHORT_LINES,
    kernels_kept,
    plain_kernels,
    start_compiling,
    use_plain_kernels,
)


def prepare_planner(lines: int) -> None:
    """Get the planner ready for a program of so many lines, before anything of it is imported.

    Kernels that are in the cache are read when they are called. Where they are not there yet, a short program
    is planned by the same source as plain Python, while a process in the background compiles for the next
    one; a long one is worth the wait.
    """
    if plain_kernels() or kernels_kept():
        return
    if lines <= SHORT_LINES and use_plain_kernels():
        start_compiling()
        narration().print(PLAIN)
        return
    from mcserver.motion.warm_up import warm_up

    notice = threading.Timer(PATIENCE_S, lambda: narration().print(COMPILING))
    notice.daemon = True
    notice.start()
    try:
        warm_up()
    finally:
        notice.cancel()


def prepare_planner_for(program: ProgramLines) -> None:
    """Get the planner ready for a program, which is read no further than it takes to know that it is long."""
    prepare_planner(SHORT_LINES + 1 if program.has_more_than(SHORT_LINES) else 0)
