"""Runs read in columns give the same values, state and faults as line by line."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.gcode.fast_path.code_text import CodeText
from mcserver.gcode.fast_path.interpreted_batch import MIN_LINES, InterpretedBatch
from mcserver.gcode.fast_path.vocabulary import vocabulary_of
from mcserver.gcode.fast_path.word_columns import WordReader
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.text.parser import scan_line
from mcserver.gcode.text.source import find_odd_line, split_lines
from mcserver.gcode.text.words import Word
from mcserver.motion.canonical import Canonical, PathBatch
from tests.gcode.arc_programs import arc_programs, contours
from tests.gcode.run_programs import programs, stretches
from tests.gcode.support import machine_of

MACHINE = machine_of(
    "0:linear:-50:50 1:linear 2:linear 3:rotary 4:rotary:-90:90 6:linear 7:linear",
    motion="[motion]\npath_tolerance_mm = 0.1\n",
)


def line_by_line(interpreter: Interpreter, texts: list[str]) -> tuple[list[Canonical], list[Diagnostic]]:
    values: list[Canonical] = []
    faults: list[Diagnostic] = []
    for number, text in enumerate(texts, start=1):
        try:
            values += interpreter.interpret_text(text, number)
        except ProgramRejected as rejected:
            faults += rejected.diagnostics
    return values, faults


def lines_of(batch: InterpretedBatch) -> list[Canonical]:
    values: list[Canonical] = []
    for value in batch.values:
        values += value.values() if isinstance(value, PathBatch) else [value]
    return values


def by_batches(interpreter: Interpreter, texts: list[str]) -> tuple[list[Canonical], list[Diagnostic]]:
    values: list[Canonical] = []
    faults: list[Diagnostic] = []
    at = 0
    while at < len(texts):
        found = interpreter.interpret_batch(texts[at:], at + 1)
        if found is not None:
            assert found.taken >= MIN_LINES
            values += lines_of(found)
            at += found.taken
            continue
        try:
            values += interpreter.interpret_text(texts[at], at + 1)
        except ProgramRejected as rejected:
            faults += rejected.diagnostics
        at += 1
    return values, faults


@settings(max_examples=150)
@given(st.one_of(programs, arc_programs()), st.sampled_from([None, None, frozenset({0, 1, 3, 6})]))
def test_runs_and_single_lines_are_equal_to_the_last_bit(
    texts: list[str], lease: frozenset[int] | None
) -> None:
    quick, general = Interpreter(MACHINE, lease=lease), Interpreter(MACHINE, lease=lease)
    values, faults = by_batches(quick, texts)
    expected, expected_faults = line_by_line(general, texts)
    assert values == expected
    assert repr(values) == repr(expected)  # tells -0.0 from 0.0 and shows every bit
    assert faults == expected_faults
    assert quick.modal == general.modal
    assert repr(quick.positions) == repr(general.positions)
    assert quick.ended == general.ended


@settings(max_examples=100)
@given(st.one_of(programs, arc_programs()))
def test_a_check_finds_the_faults_that_single_lines_have(texts: list[str]) -> None:
    text = "\n".join(texts)
    single = Interpreter(MACHINE)
    expected: list[Diagnostic] = []
    for number, line in enumerate(text.replace("\r\n", "\n").split("\n"), start=1):
        if not single.ended:
            expected += single.check_line(scan_line(line, number))[0]
    odd = find_odd_line(split_lines(text))
    # a file that no machine takes has this one fault
    assert check_program(text, MACHINE) == (expected if odd is None else [odd])
    assert (odd is None) == ("\n" in text or "\r" not in text)


@settings(max_examples=400)
@given(st.one_of(stretches(), contours()))
@example(["X1\t"])
@example(["5 X1", "X2"])
@example(["5 X1", "G5 X1"])
@example(["G01 X1 I2 R3"])
@example(["", "", "X-"])
@example(["", "; said", ""])
def test_a_table_of_words_holds_what_the_scanner_reads(texts: list[str]) -> None:
    table = WordReader(vocabulary_of(MACHINE)).read(CodeText.of(texts), 1)
    if table is None:
        return
    rows = dict(zip(table.lines.tolist(), range(len(table.lines)), strict=True))
    code, feed = -1, math.nan
    for index, text in enumerate(texts[: table.taken]):
        parsed = scan_line(text, index + 2)
        if index not in rows:
            # what lines without motion say counts for the next
            for command in (each for group in parsed.groups for each in group):
                assert not command.moves
                assert not parsed.faults
                code = code if command.spec is None else command.spec.number
                feed = next((word.value for word in command.items if isinstance(word, Word)), feed)
            continue
        row = rows[index]
        shape = table.shapes[table.shape[row]]
        if shape.curved and table.codes[row] in (0, 1):
            assert parsed.faults
            continue
        assert not parsed.faults
        ((command,),) = parsed.groups
        words = [item for item in command.items if isinstance(item, Word)]
        values = {word.letter: word.value for word in words}
        assert (code if command.spec is None else command.spec.number) == table.codes[row]
        assert shape.axes == tuple(word.axis for word in words if word.axis >= 0)
        assert [table.values[row, table.axes.index(axis)] for axis in shape.axes] == [
            word.value for word in words if word.axis >= 0
        ]
        assert [("IJK"[each], table.offsets[row, each]) for each in shape.offsets] == [
            (word.letter, word.value) for word in words if word.letter in "IJK"
        ]
        feeds = np.full(len(table.lines), math.nan) if table.feeds is None else table.feeds
        for letter, column, before in (("R", table.radii, math.nan), ("F", feeds, feed)):
            assert repr(values.get(letter, before)) == repr(float(column[row]))
        code, feed = -1, math.nan
        assert values.keys() <= {*"XYZABC[IJKRF"}
