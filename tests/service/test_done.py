"""``done`` is the last line with which everything before it has ended, by the real planner and executor."""

from __future__ import annotations

import pytest

from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.service.journal_reader import read_programs
from mcserver.service.program import Program
from mcserver.service.program_options import ProgramOptions
from tests.machine_text import axes_text
from tests.service.virtual_cell import VirtualCell

MOVES = [f"G01 X{number % 7} F6000" for number in range(1000)]


def machine() -> Machine:
    axes = axes_text(range(2), keys="in_position = 0.01\nmax_following_error = 50.0")
    return parse_machine(f'[machine]\nname = "cell"\n{axes}')


async def begun(cell: VirtualCell, lines: list[str], *, line: int, close: bool = True) -> Program:
    """A program whose line ``line`` is under way."""
    program = await cell.service.open("test")
    cell.service.lines.submit("test", program.program, 1, lines)
    if close:
        cell.service.lines.close("test", program.program)
    await cell.until(lambda: program.progress.started >= line or program.state == "paused")
    return program


@pytest.mark.parametrize(
    ("first", "faulty"),
    [
        (["G90"], 2),
        (["G04 P0"], 2),
        (["G90", "", "; nothing", "G04 P0.01"], 5),
        (["G04 P0", "G90"], 3),
        ([], 1),
    ],
)
async def test_a_line_that_faults_before_it_moves_is_not_done(
    cell: VirtualCell, first: list[str], faulty: int
) -> None:
    program = await cell.run(*first, *MOVES)
    assert (program.state, program.fault is not None and program.fault.code) == ("faulted", "MC401")
    assert program.fault is not None
    assert (program.fault.line, program.done) == (faulty, faulty - 1)
    assert all(event.line == program.done for event in cell.events if event.kind == "program.ended")


async def test_a_program_that_starts_in_its_middle_is_done_before_the_line_that_faults(
    cell: VirtualCell,
) -> None:
    text = ["G90", *MOVES]
    program = await cell.service.open("test", ProgramOptions(start_line=231, before=text[:230]))
    cell.service.lines.submit("test", program.program, 231, text[230:])
    await cell.ended(program)
    assert program.fault is not None
    assert (program.fault.line, program.done) == (231, 230)


async def test_a_pause_is_done_when_it_has_been_resumed(cell: VirtualCell) -> None:
    program = await begun(cell, ["G04 P0.01", "G90", "M00", "G04 P10"], line=4)
    await cell.until(lambda: program.done > 0)
    assert (program.state, program.done) == ("paused", 2)
    cell.service.abort(program.program)
    await cell.ended(program)
    assert program.done == 2


async def test_lines_behind_the_one_that_was_aborted_are_not_done(cell: VirtualCell) -> None:
    program = await begun(cell, ["G1010", "G91", *["G09 G01 X1 F600"] * 20, "G04 P0"], line=6)
    cell.service.abort(program.program)
    await cell.ended(program)
    assert program.state == "aborted"
    # each move is a millimetre, behind two lines that move nothing
    moved = 1000.0 * cell.position(0)
    assert moved - 1.0 < program.done - 2 <= moved + 1e-6


async def test_lines_without_time_are_done_when_what_is_before_them_has_ended(cell: VirtualCell) -> None:
    program = await begun(cell, ["G1010", "G01 X20 F600", "G90", "; a word"], line=2, close=False)
    assert program.done < 2
    await cell.until(lambda: program.done == 4)
    assert cell.position(0) == pytest.approx(0.02)
    # and the next ones at once
    cell.service.lines.submit("test", program.program, 5, ["G91", "G90"])
    await cell.until(lambda: program.done == 6)


async def test_lines_behind_a_faulty_one_are_not_done_where_the_program_ends_there(cell: VirtualCell) -> None:
    program = await begun(cell, ["G1010", "G01 X5 F600", "G01 X7 F0", "G01 X9 F600"], line=1)
    await cell.ended(program)
    assert (program.state, program.rejected, program.done) == ("rejected", 3, 2)


async def test_what_an_end_of_program_leaves_out_is_not_done(cell: VirtualCell) -> None:
    program = await cell.run("G04 P0", "M30", "G04 P0", "G04 P0")
    assert (program.state, program.done, program.status().progress) == ("finished", 2, 1.0)
    # nor does it lack to the program, also for a server that has been started anew
    (kept,) = read_programs(cell.service.options.journal, limit=1)
    assert (kept.state, kept.done, kept.accepted, kept.progress) == ("finished", 2, 4, 1.0)
