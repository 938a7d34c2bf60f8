"""Runs that a check has interpreted are what interpreting their lines again gives."""

from __future__ import annotations

import contextlib

from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.errors import ProgramRejected
from mcserver.gcode.fast_path.kept_batches import KeptBatches
from mcserver.gcode.program_check import check_lines
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.motion.canonical import Canonical
from tests.gcode.arc_programs import arc_programs
from tests.gcode.run_programs import programs
from tests.gcode.support import machine_of

MACHINE = machine_of(
    "0:linear:-50:50 1:linear 2:linear 3:rotary 4:rotary:-90:90 6:linear 7:linear",
    motion="[motion]\npath_tolerance_mm = 0.1\n",
)
FIRST = "G01 X1 F600"
LINES = [f"X{number % 7} Y{number % 3}" for number in range(60)]


def in_windows(interpreter: Interpreter, texts: list[str], window: int) -> list[Canonical]:
    values: list[Canonical] = []
    at = 0
    while at < len(texts):
        found = interpreter.interpret_batch(texts[at : at + window], at + 1)
        if found is not None:
            values += found.motion_lines()
            at += found.taken
            continue
        with contextlib.suppress(ProgramRejected):
            values += interpreter.interpret_text(texts[at], at + 1)
        at += 1
    return values


def checked(texts: list[str]) -> KeptBatches:
    kept = KeptBatches()
    check_lines(texts, MACHINE, kept=kept)
    kept.filling = False
    return kept


def taken(kept: KeptBatches, interpreter: Interpreter, number: int, size: int) -> int:
    commanded = interpreter._commanded
    found = kept.take(number, size, size, interpreter.modal, commanded)
    return 0 if found is None else found.taken


@settings(max_examples=100, deadline=None)
@given(st.one_of(programs, arc_programs()), st.integers(12, 40))
def test_a_program_is_the_same_whether_its_check_kept_runs_or_not(texts: list[str], window: int) -> None:
    plain, quick = Interpreter(MACHINE), Interpreter(MACHINE, kept=checked(texts))
    expected, values = in_windows(plain, texts, 12), in_windows(quick, texts, window)
    assert repr(values) == repr(expected)  # tells -0.0 from 0.0 and shows every bit
    assert quick.modal == plain.modal
    assert repr(quick.positions) == repr(plain.positions)


def begun(first: str) -> Interpreter:
    """Behind the first three lines of a program: there the check begins its first run."""
    program = Interpreter(MACHINE)
    for number, text in enumerate((first, "G04 P0", LINES[0]), start=1):
        program.interpret_text(text, number)
    return program


def test_a_run_is_taken_in_parts() -> None:
    kept, program = checked([FIRST, "G04 P0", *LINES]), begun(FIRST)
    assert taken(kept, program, 4, 20) == 20
    assert program.positions[0] == 6e-3
    assert taken(kept, program, 24, 12) == 12


def test_a_run_is_not_taken_from_another_modal_state() -> None:
    for first in ("G20 G01 X1 F600", "G01 X1 F601", "G91 G01 X1 F600", "G64 P0.5 G01 X1 F600"):
        assert not taken(checked([FIRST, "G04 P0", *LINES]), begun(first), 4, 20)


def test_a_run_is_not_taken_from_another_position() -> None:
    program = begun(FIRST)
    program.interpret_text("X3", 4)
    assert not taken(checked([FIRST, "G04 P0", *LINES]), program, 4, 20)


def test_nothing_is_taken_while_a_check_keeps() -> None:
    kept = checked([FIRST, "G04 P0", *LINES])
    kept.filling = True
    assert not taken(kept, begun(FIRST), 4, 20)
