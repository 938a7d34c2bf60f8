"""Block delete and optional stop (D-98)."""

from __future__ import annotations

import pytest

from mcserver.errors import ProgramRejected
from mcserver.gcode.axes_used import axes_used
from mcserver.gcode.computing.macro_expansion import expansion_of
from mcserver.gcode.program_check import check_lines
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.gcode.text.parser import ParsedLine
from mcserver.machine.machine_file import Machine, load_machine, parse_machine
from mcserver.motion.canonical import PauseLine
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from tests.bench.rs274_programs import MACHINE, moves_here
from tests.gcode.macro_programs import MACHINE_TEXT

SKIPPING = Switches(block_delete=True)
FANUC = parse_machine(MACHINE_TEXT)


def codes(lines: list[str], machine: Machine, switches: Switches = AS_WRITTEN) -> list[tuple[str, int]]:
    return [(each.code, each.line) for each in check_lines(lines, machine, switches=switches)]


def ends(lines: list[str], machine: Machine, switches: Switches) -> list[float]:
    start = StartState.of(machine, switches=switches)
    found = state_before(lines, len(lines) + 1, machine, start).positions
    return [round(1e3 * found[axis], 6) for axis in range(3)]


@pytest.mark.parametrize("profile", ["reference", "cnc", "printer", "robot"])
def test_a_line_that_begins_with_a_slash_is_skipped_only_with_the_switch_on(profile: str) -> None:
    machine = parse_machine(MACHINE_TEXT.replace('"cnc"\nmacros = "fanuc"', f'"{profile}"'))
    lines = ["F600", "G1 X1", "/G1 X2", "N10 /G1 Y3", "/N20 G01 Z4", " /1 G1 X5", "/ (only said)"]
    assert ends(lines, machine, AS_WRITTEN) == [5, 3, 4]
    assert ends(lines, machine, SKIPPING) == [1, 0, 0]
    # of a skipped line nothing is read
    assert codes(["F600", "/G1 XO", "/ what else?", "G1 X1"], machine, SKIPPING) == []


@pytest.mark.parametrize("switches", [AS_WRITTEN, SKIPPING])
@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("/2 G1 X2", "MC198"),
        ("N5 /09 G1 X2", "MC198"),
        ("G1 X2 /", "MC103"),
        ("(first) /G1 X2", "MC103"),
        ("G1 X2 /Y3", "MC103"),
    ],
)
def test_a_slash_elsewhere_and_a_switch_that_is_not_there_are_refused(
    line: str, code: str, switches: Switches
) -> None:
    for machine in (MACHINE, FANUC):
        assert codes(["F600", line], machine, switches) == [(code, 2)]


def test_lines_alike_are_read_as_one_by_one() -> None:
    lines = ["F600", *(f"{'/' * (at % 7 == 3)}G1 X{at} Y{at % 5}" for at in range(60)), "/G1 X0"]
    for switches in (AS_WRITTEN, SKIPPING):
        kept = [line for line in lines if switches is AS_WRITTEN or line[0] != "/"]
        plain = [line.removeprefix("/") for line in kept]
        assert ends(lines, MACHINE, switches) == ends(plain, MACHINE, AS_WRITTEN)


def test_blocks_of_o_words_and_subprograms_lack_what_is_skipped() -> None:
    text = (
        "F100\no1 sub\n G1 X1\n/G1 X2\no1 endsub\n/#1=3\no1 call\n/o2 if [1]\n G1 Y1\n/o2 endif\n/o1 call\nM2"
    )
    assert moves_here(text)[0] == [(1, 0, 0), (2, 0, 0), (2, 1, 0), (1, 1, 0), (2, 1, 0)]
    assert moves_here(text, switches=SKIPPING)[0] == [(1, 0, 0), (1, 1, 0)]
    # half of a block is none
    assert codes(["o2 if [1]", "/o2 endif", "M2"], MACHINE, SKIPPING) == [("MC161", 1)]


def test_goto_finds_the_number_of_a_skipped_block() -> None:
    text = "F100\nGOTO 10\nG1 X1\nN10 /G1 Y1\nG1 Z1\n/M98 P7\nM30\nO7\n/G1 X7\nM99"
    assert moves_here(text, FANUC)[0] == [(0, 1, 0), (0, 1, 1), (7, 1, 1)]
    assert moves_here(text, FANUC, SKIPPING)[0] == [(0, 0, 1)]


def test_a_contour_under_compensation_is_that_of_the_lines_that_are_left() -> None:
    contour = ["F600", "G41.1 D2", "G1 X10", "Y10", "/X5", "/Y20", "X-10", "G40", "G1 X-20", "M2"]
    left = [line for line in contour if line[0] != "/"]
    assert moves_here("\n".join(contour), switches=SKIPPING) == moves_here("\n".join(left))
    written = [line.removeprefix("/") for line in contour]
    assert moves_here("\n".join(contour)) == moves_here("\n".join(written))


def test_m01_pauses_unless_the_switch_is_off() -> None:
    for machine in (load_machine("cartesian"), MACHINE):
        for switches, pauses in ((AS_WRITTEN, 1), (Switches(optional_stop=False), 0)):
            interpreter = Interpreter(machine, switches=switches)
            values = interpreter.interpret_text("G1 X1 F600 M01", 1)
            assert sum(isinstance(each, PauseLine) for each in values) == pauses
            # M0 asks nobody
            assert isinstance(interpreter.interpret_text("M0", 2)[0], PauseLine)
    # a pause is refused under cutter compensation, what is none is not
    contour = ["F600", "G41.1 D2", "G1 X10", "M1", "Y10", "G40", "G1 X-20", "M2"]
    assert codes(contour, MACHINE) == [("MC170", 4)]
    assert codes(contour, MACHINE, Switches(optional_stop=False)) == []


def test_a_lease_has_the_axes_of_lines_that_may_be_skipped() -> None:
    assert axes_used("/G1 X1\nN5 /G1 Z1\n/1 G1 Y2", MACHINE) == (0, 1, 2)


def test_a_line_that_is_refused_and_sent_again_takes_none_of_the_lines_before_with_it() -> None:
    interpreter = Interpreter(FANUC)
    expansion = expansion_of(interpreter)

    def run() -> None:
        while expansion.running:
            parsed = expansion.next()
            if isinstance(parsed, ParsedLine):
                interpreter.interpret(parsed)

    for number, text in enumerate(["F100", "#1=0", "N10 #1=#1+1"], start=1):
        expansion.take(text, number)
        run()
    with pytest.raises(ProgramRejected):
        expansion.take("/2 G1 X2", 4)
    expansion.drop()
    for number, text in enumerate(["IF [#1 LT 3] GOTO 10", "G1 X#1", "M30"], start=4):
        expansion.take(text, number)
        run()
    # a way back is known once the text is whole
    expansion.close()
    run()
    assert interpreter.positions[0] == pytest.approx(0.003)
