"""What a program says to its operator, and the pauses of tool changes (D-65, D-76)."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from mcserver.errors import Diagnostic
from mcserver.gcode.notices import LONGEST, notice_of
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.motion.canonical import PauseLine
from tests.gcode.support import Program

MILL = load_machine(str(Path(__file__).parents[1] / "corpus" / "cnc.toml"))
PRINTER = load_machine(str(Path(__file__).parents[1] / "corpus" / "printer.toml"))


def mill(tool_change: str) -> Machine:
    return msgspec.structs.replace(
        MILL,
        dialect=msgspec.structs.replace(MILL.dialect, tool_change=tool_change),  # type: ignore[arg-type]
    )


def notices(machine: Machine, *lines: str) -> list[str | None]:
    """What each line says; raises if one is refused."""
    interpreter = Interpreter(machine)
    printer = machine.dialect.profile == "printer"
    return [
        notice_of(text, interpreter.interpret_text(text, number), printer=printer)
        for number, text in enumerate(lines, start=1)
    ]


def pauses(machine: Machine, *lines: str) -> list[tuple[int, str]]:
    found = Program(machine).run(*lines)
    return [(each.line, each.notice) for each in found if isinstance(each, PauseLine)]


def errors(text: str, machine: Machine = MILL) -> list[Diagnostic]:
    return [each for each in check_program(text, machine) if each.severity == "error"]


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("(MSG, fit the clamp)", "fit the clamp"),
        ("( msg ,turn the part )", "turn the part"),
        ("G1 X1 F100 (MSG, half way)", "half way"),
        ("M0 (turn the part over)", "turn the part over"),
        ("M1 ; look at it", "look at it"),
        ("M0", None),
        ("(turn the part over)", None),
        ("M30 (done)", None),
        (f"(MSG,{'x' * 500})", "x" * LONGEST),
    ],
)
def test_a_line_says_its_message_or_the_comment_of_its_pause(line: str, says: str | None) -> None:
    assert notices(MILL, line) == [says]


def test_m117_says_something_to_printers_only() -> None:
    assert notices(PRINTER, "M117 Layer 3 ; of 9") == ["Layer 3"]
    assert notices(PRINTER, "M1170") == [None]


def test_a_change_to_another_tool_pauses_and_names_it() -> None:
    lines = ("T1 M6", "G0 X1", "T2 M6", "T2 M6", "T0 M6")
    assert pauses(mill("pause"), *lines) == [
        (3, "fit tool 2, then resume"),
        (5, "take the tool out, then resume"),
    ]
    assert notices(mill("pause"), "T1 M6", "T3 M6 (drill 3 mm)")[1] == "fit tool 3, then resume"


def test_with_ask_the_first_tool_pauses_too() -> None:
    assert pauses(mill("ask"), "T1 M6", "G0 X1", "T1 M6") == [(1, "fit tool 1, then resume")]
    assert pauses(mill("ignore"), "T1 M6", "T2 M6") == []


def test_the_check_names_the_tool_that_counts_as_fitted() -> None:
    (said,) = check_program("T1\nM6\nG0 X1\nT2 M6", MILL)
    assert (said.code, said.severity, said.line) == ("MC154", "warning", 2)
    assert "tool 1" in said.message
    assert check_program("T1 M6", mill("ask")) == []


def test_a_tool_that_the_table_lacks_is_a_fault() -> None:
    (fault,) = errors("T9 M6\nG0 X1")
    assert (fault.code, fault.line) == ("MC143", 1)
    assert "1, 2, 3" in fault.hint
    assert errors("T0 M6\nG0 X1") == []


def test_a_refused_compensation_is_the_only_fault_of_what_follows_it() -> None:
    text = "G0 X0 Y-10\nG41 D3 G1 X0 Y0 F300\nZ-2\nG91\nY50\nG90\nG40 G1 X-10"
    assert [(each.code, each.line) for each in errors(text)] == [("MC143", 2)]


def test_settings_of_a_refused_line_hold_for_the_check() -> None:
    text = "G20 G66\nG1 X10 F20\nG2 X12 Y2 I0 J2"
    assert [(each.code, each.line) for each in errors(text)] == [("MC141", 1)]


def test_commands_to_firmware_are_named_as_such() -> None:
    (fault,) = errors("G0 X1\n$H")
    assert "firmware" in fault.message


def test_comments_that_would_write_a_file_are_named_as_without_effect() -> None:
    lines = [
        "(PROBEOPEN points.txt)",
        "G1 X1 F100 (logic)",
        "(log, x is #5061)",
        "(PROBECLOSE)",
        "(LOGIC)",
    ]
    (warning,) = check_program("\n".join(lines), MILL)
    assert (warning.code, warning.line) == ("MC142", 1)
    assert warning.message.endswith("(LOG) (1), (PROBECLOSE) (1), (PROBEOPEN) (1)")
