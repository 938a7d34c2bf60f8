"""Canned drilling cycles become the moves that RS-274 gives them (D-75)."""

from __future__ import annotations

from itertools import pairwise

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.errors import Diagnostic
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import Canonical, DwellGroup, EndLine, FeedGroup, MotionLine, RapidGroup
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from mcserver.simulation.simulation import simulate
from tests.corpus.test_corpus import ends, machine_of

Move = tuple[str, str, float]


def values(text: str, machine: Machine | None = None) -> list[Canonical]:
    interpreter = Interpreter(machine or machine_of("cnc"))
    return [
        value
        for number, line in enumerate(text.split("\n"), start=1)
        for value in interpreter.interpret_text(line, number)
    ]


def moves(text: str, machine: Machine | None = None) -> list[Move]:
    """Each move as (rapid or feed, axis, where it ends in mm), dwells as (dwell, "", seconds)."""
    found: list[Move] = []
    for value in values(text, machine):
        if not isinstance(value, MotionLine):
            continue
        (group,) = value.groups
        if isinstance(group, DwellGroup):
            found.append(("dwell", "", group.seconds))
        elif isinstance(group, RapidGroup):
            found += [
                ("rapid", "XYZ"[axis], round(end * 1e3, 6))
                for axis, end in zip(group.axes, group.targets, strict=True)
            ]
        elif isinstance(group, FeedGroup):
            (curve,) = group.curves
            assert value.exact_stop or curve.axes == (0,)
            found += [
                ("feed", "XYZ"[axis], round(float(end) * 1e3, 6))
                for axis, end in zip(curve.axes, curve.end, strict=True)
            ]
    return found


def faults(text: str) -> list[Diagnostic]:
    return [each for each in check_program(text, machine_of("cnc")) if each.severity == "error"]


def test_g81_goes_over_the_hole_to_r_drills_and_returns() -> None:
    assert moves("G0 Z10\nG81 X5 Y6 Z-3 R2 F300")[1:] == [
        ("rapid", "X", 5.0),
        ("rapid", "Y", 6.0),
        ("rapid", "Z", 2.0),
        ("feed", "Z", -3.0),
        ("rapid", "Z", 10.0),
    ]


def test_axis_words_repeat_the_cycle_until_g80_or_another_motion_code() -> None:
    text = "G0 Z10\nG99 G81 X5 Z-3 R2 F300\nX7\nY4 Z-4\n"
    drilled = [end for kind, _, end in moves(text) if kind == "feed"]
    assert drilled == [-3.0, -3.0, -4.0]
    assert [fault.code for fault in faults(text + "G80\nX9")] == ["MC113"]

    assert ends(text + "G1 X9\nX11 Z5") == [11.0, 4.0, 5.0]


def test_g98_returns_to_the_height_before_the_cycle_and_g99_to_r() -> None:
    text = "G0 Z10\n{}G81 X5 Z-3 R2 F300\nX7\nG1 X0"
    heights = [[end for kind, axis, end in moves(text.format(mode)) if axis == "Z"] for mode in ("", "G99 ")]
    assert heights[0] == [10.0, 2.0, -3.0, 10.0, 2.0, -3.0, 10.0]
    assert heights[1] == [10.0, 2.0, -3.0, 2.0, -3.0, 2.0]


def test_g83_clears_the_hole_after_each_peck_and_g73_goes_up_a_little() -> None:
    assert [move for move in moves("G83 Z-5 R1 Q2 F300") if move[1] == "Z"] == [
        ("rapid", "Z", 1.0),
        ("feed", "Z", -1.0),
        ("rapid", "Z", 1.0),
        ("rapid", "Z", -0.75),
        ("feed", "Z", -3.0),
        ("rapid", "Z", 1.0),
        ("rapid", "Z", -2.75),
        ("feed", "Z", -5.0),
        ("rapid", "Z", 1.0),
    ]
    assert moves("G73 Z-3 R1 Q2.5 F300") == [
        ("rapid", "Z", 1.0),
        ("feed", "Z", -1.5),
        ("rapid", "Z", -1.25),
        ("feed", "Z", -3.0),
        ("rapid", "Z", 1.0),
    ]


def test_pecks_get_smaller_as_haas_has_them_and_g73_clears_the_hole_after_k() -> None:
    down = [end for kind, _, end in moves("G83 Z-10 R2 I5 J2 K1.5 P0.5 F300") if kind in ("feed", "dwell")]
    assert down == [-3.0, -6.0, -7.5, -9.0, -10.0, 0.5]
    assert [move for move in moves("G73 Z-8 R1 Q2 K4 F300") if move[0] == "rapid"] == [
        ("rapid", "Z", 1.0),
        ("rapid", "Z", -0.75),
        ("rapid", "Z", 1.0),
        ("rapid", "Z", -2.75),
        ("rapid", "Z", -4.75),
        ("rapid", "Z", 1.0),
        ("rapid", "Z", -6.75),
        ("rapid", "Z", 1.0),
    ]
    # each of the words counts for the lines to come
    feeds = [end for kind, _, end in moves("G83 Z-4 R0 I3 J1 K2 F300\nX5\nX6 Q1") if kind == "feed"]
    assert feeds == [-3.0, -4.0, -3.0, -4.0, -1.0, -2.0, -3.0, -4.0]


def test_a_dwell_belongs_to_its_code() -> None:
    text = "G82 Z-1 R1 P0.5 F300\n{}"
    assert [kind for kind, _, _ in moves(text.format("X5"))].count("dwell") == 2
    for code in ("G81", "G83 Q5", "G73 Q5", "G85"):
        assert [kind for kind, _, _ in moves(text.format(f"{code} X5"))].count("dwell") == 1
    assert [kind for kind, _, _ in moves(text.format("G89 X5"))].count("dwell") == 2


def test_milliseconds_that_are_read_as_seconds_are_pointed_out() -> None:
    text = "G82 Z-1 R1 P500 F300\nX5"
    assert [(each.code, each.line, each.severity) for each in check_program(text, machine_of("cnc"))] == [
        ("MC129", 1, "warning")
    ]
    assert [kind for kind, _, _ in moves(text)].count("dwell") == 2


def test_k_repeats_as_l_does_and_0_only_keeps_the_cycle() -> None:
    text = "G0 X1 Z10\nG91 G81 X10 R-8 Z-5 K3 F300\nG90 G80"
    assert [end for kind, axis, end in moves(text) if axis == "X"] == [1.0, 11.0, 21.0, 31.0]
    for word in ("L0", "K0"):
        for cycle in ("G81", "G83 Q9"):
            kept = f"G0 Z10\n{cycle} X5 Z-3 R2 {word} F300"
            assert len(moves(kept)) == 1
            assert moves(f"{kept}\nX7")[1:] == moves("G0 Z10\nG81 X7 Z-3 R2 F300")[1:]


def test_g82_waits_at_the_bottom_and_g85_and_g89_go_out_at_f() -> None:
    assert moves("G82 Z-1 R1 P0.5 F300")[1:3] == [("feed", "Z", -1.0), ("dwell", "", 0.5)]
    assert moves("G85 Z-1 R1 F300") == [("rapid", "Z", 1.0), ("feed", "Z", -1.0), ("feed", "Z", 1.0)]
    assert moves("G89 Z-1 R1 P2 F300")[2:] == [("dwell", "", 2.0), ("feed", "Z", 1.0)]


def test_under_g91_r_counts_from_the_start_the_depth_from_r_and_l_repeats() -> None:
    text = "G0 X1 Z10\nG91 G81 X10 R-8 Z-5 L3 F300\nG90 G80"
    assert [end for kind, axis, end in moves(text) if axis == "X"] == [1.0, 11.0, 21.0, 31.0]
    assert {end for kind, axis, end in moves(text) if kind == "feed"} == {-3.0}


@pytest.mark.parametrize(
    ("text", "depths", "of_fanuc"),
    [
        ("G0 Z10\nG81 X5 R2 Z-3 F300\nG91 X5\nX5 L2", [-3.0, 9.0, 9.0, 9.0], [-3.0] * 4),
        ("G0 Z10\nG91 G81 X5 R-5 Z-8 F300\nG90 X25\nG91 X5", [-3.0, -8.0, -3.0], [-3.0] * 3),
        ("G0 Z10\nG91 G99 G81 X5 R-8 Z-5 F300\nG90 X25 R2\nX30", [-3.0, -5.0, -5.0], [-3.0] * 3),
    ],
)
def test_kept_heights_count_by_the_mode_in_force_and_of_fanuc_stay(
    text: str, depths: list[float], of_fanuc: list[float]
) -> None:
    assert [end for kind, axis, end in moves(text) if kind == "feed"] == depths
    assert [each.code for each in check_program(text, machine_of("cnc")) if each.line > 2][:1] == ["MC199"]
    fanuc = msgspec.structs.replace(
        machine_of("cnc"), dialect=msgspec.structs.replace(machine_of("cnc").dialect, macros="fanuc")
    )
    assert [end for kind, axis, end in moves(text, fanuc) if kind == "feed"] == of_fanuc
    assert check_program(text, fanuc) == []


def test_an_axis_below_r_goes_to_r_before_it_goes_over_the_hole() -> None:
    assert moves("G81 X5 Z-3 R2 F300")[:2] == [("rapid", "Z", 2.0), ("rapid", "X", 5.0)]


def test_a_cycle_drills_along_the_normal_of_its_plane_in_the_work_system_in_force() -> None:
    assert ("feed", "Y", -3.0) in moves("G18\nG81 X5 Z5 Y-3 R2 F300")
    assert ("feed", "Z", 17.0) in moves("G10 L2 P1 Z20\nG81 X5 Z-3 R2 F300")
    assert ("feed", "Z", -25.4) in moves("G20\nG81 X1 Z-1 R.1 F10")
    assert ("feed", "Z", 17.0) in moves("T1 M6\nG43 H1\nG81 X5 Z-3 R2 F300")


def test_a_line_of_a_cycle_is_one_line_of_the_report() -> None:
    report = simulate("G0 Z10\nG83 X5 Z-5 R2 Q2 F300\nX7\nM30", machine_of("cnc")).report
    second, third = (each for each in report["lines"] if each["line"] in (2, 3))
    assert second["start_s"] < second["end_s"] == third["start_s"]
    assert second["requested_s"] is None


def test_the_program_ends_behind_the_cycle_of_its_last_line() -> None:
    found = values("G81 X5 Z-3 R2 F300 M30")
    assert isinstance(found[-1], EndLine)
    assert isinstance(values("G0 X5\nG28 X0 M30")[-1], EndLine)


def test_a_program_goes_on_within_a_cycle() -> None:
    lines = ["G0 Z10", "G99 G81 X5 Z-3 R2 F300", "X7", "X9"]
    before = state_before(lines, 4, machine_of("cnc"), StartState.of(machine_of("cnc")))
    interpreter = Interpreter(machine_of("cnc"), modal=before.modal, positions=before.positions)
    assert len(interpreter.interpret_text(lines[3], 4)) == 3


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("G81 X5 Z3 R2 F300", "MC146"),  # upwards
        ("G81 X5 Z-3 F300", "MC118"),  # without R
        ("G83 X5 Z-3 R2 F300", "MC118"),  # without Q
        ("G82 X5 Z-3 R2 F300", "MC118"),  # without P
        ("G81 X5 Z-3 R2", "MC121"),  # without F
        ("G93 F10\nG81 X5 Z-3 R2", "MC146"),
        ("G81 X5 Z-3 R2 A90 F300", "MC146"),
        ("G81 X9000 Z-3 R2 F300", "MC201"),
        ("G81 X5 Z-900 R2 F300", "MC201"),
        ("G83 X5 Z-3 R2 Q0.0001 F300", "MC146"),
        ("G91 G81 X5 Z-3 R2 L0 F300", "MC146"),
        ("G81 X5 Z-3 R2 L2 K2 F300", "MC116"),
        ("G81 X5 Z-3 R2 L2.5 F300", "MC116"),
        ("G81 X5 Z-3 R2 K3.5 F300", "MC116"),
        ("G81 X5 Z-3 R2 I1 F300", "MC112"),
        ("G81 X5 Z-3 R2 P1 F300", "MC112"),  # a dwell is G82's
        ("G85 X5 Z-3 R2 Q1 F300", "MC112"),
        ("G83 X5 Z-3 R2 Q1 I2 F300", "MC112"),
        ("G83 X5 Z-3 R2 I2 J1 F300", "MC112"),  # the least is missing
        ("G83 X5 Z-3 R2 Q2 K3 F300", "MC112"),  # Fanuc's repeats, or no word of Haas's
        ("G91 G73 X5 Z-3 R2 Q2 K3 F300", "MC112"),
        ("G83 X5 Z-3 R2 Q-2 F300", "MC116"),
        ("G86 X5 Z-3 R2 F300", "MC178"),  # the spindle does not turn
        ("G81 X5 X6 Z-3 R2 F300", "MC111"),
        ("G83 X5 Z-3 R2 Q1 Q2 F300", "MC111"),
        ("G0 G81 X5 Z-3 R2 F300", "MC153"),
        ("G53 G81 X5 Z-3 R2 F300", "MC153"),
        ("G1 X5 F100\nX6 Q2", "MC113"),
        ("G84 X5 Z-3 R2 F300", "MC178"),  # the spindle does not turn
        ("G81 U5 Z-3 R2 F300", "MC112"),
    ],
)
def test_a_cycle_that_cannot_be_drilled_is_refused_for_one_reason(text: str, code: str) -> None:
    assert [fault.code for fault in faults(text)] == [code]


@settings(max_examples=60)
@given(
    code=st.sampled_from(["G73", "G81", "G83"]),
    before=st.integers(-20, 50),
    clear=st.integers(-10, 20),
    depth=st.integers(1, 30),
    peck=st.integers(1, 12),
    mode=st.sampled_from(["G98", "G99"]),
)
def test_a_cycle_feeds_down_only_below_what_is_drilled_and_moves_over_parts_only_at_a_safe_height(
    code: str, before: int, clear: int, depth: int, peck: int, mode: str
) -> None:
    pecks = f"Q{peck}" if code != "G81" else ""
    text = f"G0 Z{before}\n{mode} {code} X5 Z{clear - depth} R{clear} {pecks} F300\nX9\nX12"
    height, drilled, holes = float(before), float(clear), 0
    for (kind, axis, end), (following, _, _) in pairwise([*moves(text)[1:], ("end", "", 0.0)]):
        if axis != "Z":
            assert height >= clear
            holes, drilled = holes + 1, float(clear)
            continue
        if kind == "rapid":
            # never by rapid into what stands
            assert end >= drilled
        else:
            assert end >= clear - depth
            drilled = end
            assert following == "rapid"
        height = end
    assert (holes, drilled) == (3, clear - depth)
    assert height == (max(before, clear) if mode == "G98" else clear)
