"""Runs read in columns give the same values, state and faults as line by line."""

from __future__ import annotations

import math

from hypothesis import example, given, settings
from hypothesis import strategies as st

from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.gcode.fast_path.code_text import CodeText
from mcserver.gcode.fast_path.columns import read_columns
from mcserver.gcode.fast_path.run_state import MIN_LINES
from mcserver.gcode.fast_path.word_columns import WordReader
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.text.parser import scan_line
from mcserver.gcode.text.source import find_odd_line, split_lines
from mcserver.motion.canonical import Canonical
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


def by_runs(interpreter: Interpreter, texts: list[str]) -> tuple[list[Canonical], list[Diagnostic]]:
    values: list[Canonical] = []
    faults: list[Diagnostic] = []
    at = 0
    while at < len(texts):
        found = interpreter.interpret_run(texts[at:], at + 1)
        if found is not None:
            run, taken = found
            assert taken >= MIN_LINES
            values += run.motion_lines()
            at += taken
            continue
        try:
            values += interpreter.interpret_text(texts[at], at + 1)
        except ProgramRejected as rejected:
            faults += rejected.diagnostics
        at += 1
    return values, faults


@settings(max_examples=250, deadline=None)
@given(st.one_of(programs, arc_programs()), st.sampled_from([None, None, frozenset({0, 1, 3, 6})]))
def test_runs_and_single_lines_are_equal_to_the_last_bit(
    texts: list[str], lease: frozenset[int] | None
) -> None:
    quick, general = Interpreter(MACHINE, lease=lease), Interpreter(MACHINE, lease=lease)
    values, faults = by_runs(quick, texts)
    expected, expected_faults = line_by_line(general, texts)
    assert values == expected
    assert repr(values) == repr(expected)  # tells -0.0 from 0.0 and shows every bit
    assert faults == expected_faults
    assert quick.modal == general.modal
    assert repr(quick.positions) == repr(general.positions)
    assert quick.ended == general.ended


@settings(max_examples=200, deadline=None)
@given(st.one_of(programs, arc_programs()))
def test_a_check_finds_the_faults_that_single_lines_have(texts: list[str]) -> None:
    text = "\n".join(texts)
    single = Interpreter(MACHINE)
    expected: list[Diagnostic] = []
    for number, line in enumerate(text.replace("\r\n", "\n").split("\n"), start=1):
        if not single.ended:
            expected += single.check(scan_line(line, number))
    odd = find_odd_line(split_lines(text))
    # a file that no machine takes has this one fault
    assert check_program(text, MACHINE) == (expected if odd is None else [odd])
    assert (odd is None) == ("\n" in text or "\r" not in text)


@settings(max_examples=400, deadline=None)
@given(stretches())
@example(["X1\t"])
@example(["X1\nX2", "X3"])
def test_what_is_read_in_columns_is_what_the_scanner_reads(texts: list[str]) -> None:
    columns = read_columns(CodeText.of(texts), 1)
    if columns is None:
        return
    rows = dict(zip(columns.lines.tolist(), range(len(columns.lines)), strict=True))
    for index, text in enumerate(texts[: columns.taken]):
        parsed = scan_line(text, index + 2)
        assert not parsed.faults
        if index not in rows:
            assert parsed.blank
            continue
        simple, row = parsed.simple, rows[index]
        feed = math.nan if columns.feeds is None else columns.feeds[row]
        if feed <= 0.0:
            assert simple is None  # refused by the block interpreter
            continue
        assert simple is not None
        assert simple.code in (None, 1)
        assert not simple.curved
        assert simple.axes == columns.axes
        assert simple.values == tuple(column[row] for column in columns.values)
        assert (simple.feed is None) == math.isnan(feed)
        assert simple.feed in (None, feed)


@settings(max_examples=400, deadline=None)
@given(st.one_of(stretches(), contours()))
@example(["X1\t"])
@example(["5 X1", "X2"])
@example(["5 X1", "G5 X1"])
@example(["G01 X1 I2 R3"])
@example(["", "", "X-"])
@example(["", "; said", ""])
def test_a_table_of_words_holds_what_the_scanner_reads(texts: list[str]) -> None:
    table = WordReader().read(CodeText.of(texts), 1)
    if table is None:
        return
    rows = dict(zip(table.lines.tolist(), range(len(table.lines)), strict=True))
    for index, text in enumerate(texts[: table.taken]):
        parsed = scan_line(text, index + 2)
        assert not parsed.faults or parsed.simple is None
        if index not in rows:
            assert parsed.blank
            continue
        simple, row = parsed.simple, rows[index]
        feed = math.nan if table.feeds is None else table.feeds[row]
        shape = table.shapes[table.shape[row]]
        if feed <= 0.0 or (shape.curved and table.codes[row] == 1):
            assert simple is None  # refused by the block interpreter
            continue
        assert simple is not None
        assert (simple.code or 0) == table.codes[row]
        assert simple.axes == shape.axes
        assert simple.values == tuple(table.values[row, [table.axes.index(axis) for axis in shape.axes]])
        assert simple.offsets == tuple((offset, table.offsets[row, offset]) for offset in shape.offsets)
        assert (simple.radius is not None) == shape.radius
        assert simple.radius in (None, table.radii[row])
        assert (simple.feed is None) == math.isnan(feed)
        assert simple.feed in (None, feed)
