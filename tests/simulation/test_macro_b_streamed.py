"""Programs in macro B, streamed on a virtual clock: the same way, and lines that are done in order (D-91)."""

from __future__ import annotations

from random import Random

import pytest

from mcserver.machine.machine_file import parse_machine
from mcserver.planning.pipeline import FaultRule
from tests.bench.rs274_programs import moves_here
from tests.gcode.macro_programs import MACHINE_TEXT, MacroWriter
from tests.simulation.test_computed_programs import Stream

MACHINE = parse_machine(MACHINE_TEXT)


@pytest.mark.parametrize("seed", [2, 3, 5, 8])
def test_a_stream_in_pieces_goes_the_way_of_the_whole_text(seed: int) -> None:
    program, unrolled = MacroWriter(seed).program()
    lines = program.splitlines()
    moves, _ = moves_here(unrolled, MACHINE)
    random = Random(seed)
    stream = Stream(MACHINE)
    while stream.sent < len(lines):
        piece = lines[stream.sent : stream.sent + random.randint(1, 4)]
        stream.send(*piece, last=stream.sent + len(piece) == len(lines))
        stream.run(20)
    stream.run(1000 * (2 + len(moves) // 4))
    assert stream.finished
    assert stream.place == [round(each, 6) for each in (moves[-1][:3] if moves else (0.0, 0.0, 0.0))]
    assert stream.done == sorted(stream.done)
    assert stream.done[-1] == lines.index("M30") + 1


def test_a_call_waits_for_its_subprogram_and_no_line_behind_it_is_done_before() -> None:
    stream = Stream(MACHINE)
    stream.send("G91 F6000", "G1 X1", "M98 P7 L2", "G1 Y1", "M30", "O7")
    stream.run(500)
    assert (stream.place[:2], stream.progress.done) == ([1.0, 0.0], 2)
    stream.send("G1 X10")
    stream.run(500)
    # it goes as far as it is known
    assert (stream.place[:2], stream.progress.done) == ([11.0, 0.0], 2)
    stream.send("M99")
    stream.run(1000)
    assert (stream.place[:2], stream.progress.done, stream.finished) == ([21.0, 1.0], 5, True)


def test_a_loop_counts_as_its_last_line_from_its_second_turn_on() -> None:
    stream = Stream(MACHINE)
    stream.send("G91 F6000 #1=2", "WHILE [#1 GT 0] DO1", "G1 X1", "G4 P0.5", "#1=#1-1", "END1", "X1")
    stream.run(700)
    assert (stream.place[0], stream.progress.done) == (2.0, 5)
    stream.run(2000)
    assert (stream.place[0], stream.progress.done) == (3.0, 7)


def test_a_faulty_line_is_sent_again_until_what_waits_has_begun_to_run() -> None:
    stream = Stream(MACHINE, on_fault=FaultRule.RETRY)
    stream.send("G91 F6000", "G1 X[1/0]")
    stream.run(100)
    assert stream.rejected == [(2, "MC163")]
    stream.sent = 1
    stream.send("G1 X1", "M98 P7", "END1")
    stream.run(300)
    assert stream.rejected[1:] == [(4, "MC181")]
    stream.sent = 3
    stream.send("G1 Y1", "M30", "O7", "G1 X5", "G1 XX", "M99", last=True)
    stream.run(1000)
    assert [line for line, _ in stream.rejected[2:]] == [8]
    assert (stream.place[:2], stream.progress.done) == ([6.0, 0.0], 2)
