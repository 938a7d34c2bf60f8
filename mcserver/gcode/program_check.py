"""Find every fault of a program without running it (D-04)."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mckinematics.pose import Kinematics

from mcserver.errors import Diagnostic
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.text.parser import scan_line
from mcserver.gcode.text.source import split_lines
from mcserver.machine.machine_file import Machine

Progress = Callable[[int, int], None]
PROGRESS_STEP = 1000  # lines between two reports


def check_program(
    text: str,
    machine: Machine,
    kinematics: Kinematics | None = None,
    progress: Progress | None = None,
    *,
    positions: Mapping[int, float] | None = None,
    lease: frozenset[int] | None = None,
) -> list[Diagnostic]:
    """Find every fault of a program, in reading order; tools' paths are solved too.

    After a faulty line the check goes on from a best guess: a motion's endpoint counts as reached if it is
    known, and a feed or tool that could not be read causes no further faults in the lines that use it.

    Args:
        text: the whole program.
        progress: called with (lines read, lines in all) about every `PROGRESS_STEP` lines.
        positions: where the axes start [m or rad]; the drives' initial positions by default.
        lease: axes that the program may use; all by default.
    """
    interpreter = Interpreter(machine, kinematics=kinematics, positions=positions, lease=lease)
    lines = split_lines(text)
    found: list[Diagnostic] = []
    done = 0
    while done < len(lines) and not interpreter.ended:
        taken = _check_next(interpreter, lines, done, found)
        if progress is not None and (done + taken) // PROGRESS_STEP > done // PROGRESS_STEP:
            progress(done + taken, len(lines))
        done += taken
    if progress is not None:
        progress(len(lines), len(lines))
    return found


def _check_next(interpreter: Interpreter, lines: list[str], done: int, found: list[Diagnostic]) -> int:
    """Check the next line, or a whole run of simple blocks; return how many lines were read."""
    window = interpreter.run_window(done + 1)
    if window:
        run = interpreter.interpret_run(lines[done : done + window], done + 1)
        if run is not None:
            return run[1]
    found.extend(interpreter.check(scan_line(lines[done], done + 1)))
    return 1
