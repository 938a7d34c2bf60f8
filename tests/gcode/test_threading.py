"""G33 and G76 as text: what they mean and what is refused (D-89, D-90)."""

from __future__ import annotations

import pytest

from mcserver.errors import ProgramRejected
from mcserver.gcode.axes_used import axes_used
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.motion.canonical import Canonical, DwellGroup, MotionLine, RapidGroup, SpeedGroup, ThreadLine
from mcserver.motion.thread_cam import stopping_seconds
from mcserver.units import DEGREE, MM, TURN
from tests.executor.threading_rig import SPINDLE, lathe, lathe_text
from tests.gcode.support import Program
from tests.machine_text import axes_text

LATHE = lathe(drive="ideal")
HEAD = ("G21 G18 G90", "S400 M3", "G0 X10 Z3")


def faults(*lines: str, machine: Machine = LATHE, head: tuple[str, ...] = HEAD) -> list[tuple[str, int]]:
    return [(each.code, each.line) for each in check_program("\n".join([*head, *lines]), machine)]


def values(*lines: str) -> list[Canonical]:
    return Program(LATHE, positions=dict.fromkeys(range(4), 0.0)).run(*HEAD, *lines)


def test_g33_is_a_straight_move_by_the_turns_of_the_spindle() -> None:
    (found,) = [each for each in values("G33 X12 Z-20 K1.5") if isinstance(each, ThreadLine)]
    assert dict(zip(found.axes, found.targets, strict=True)) == pytest.approx({0: 0.012, 2: -0.02})
    assert found.pitch == pytest.approx(1.5 * MM)
    assert (found.spindle, found.turns_s) == (SPINDLE, pytest.approx(400.0 / 60.0))
    (left,) = [each for each in values("M4", "G91 G33 Z-20 K1.5") if isinstance(each, ThreadLine)]
    assert left.targets == pytest.approx((-0.017,))
    assert left.turns_s == pytest.approx(-400.0 / 60.0)


def test_the_passes_of_g76_are_where_rs274_puts_them() -> None:
    found: list[tuple[float, float, float]] = []
    at = {0: 0.0, 2: 0.0}
    for value in values("G76 P1.5 Z-20 I-1 J0.3 K0.92 R2 Q29.5 H1"):
        if isinstance(value, MotionLine) and isinstance(value.groups[0], RapidGroup):
            at.update(zip(value.groups[0].axes, value.groups[0].targets, strict=True))
        elif isinstance(value, ThreadLine):
            found.append((at[0] / MM, at[2] / MM, value.targets[0] / MM))
            at[2] = value.targets[0]
    # X, Z of the beginning and of the end of each feed move that rs274 of LinuxCNC 2.9 prints for it
    expected = [
        (8.7, 2.8303, -19.6492),
        (8.5757, 2.76, -19.7195),
        (8.4804, 2.706, -19.7735),
        (8.4, 2.6605, -19.819),
        (8.3292, 2.6205, -19.859),
        (8.2652, 2.5842, -19.8952),
        (8.2063, 2.5509, -19.9286),
        (8.1515, 2.5199, -19.9596),
        (8.1, 2.4908, -19.9887),
        (8.08, 2.4795, -20.0),
        (8.08, 2.4795, -20.0),
    ]
    assert [tuple(round(each, 4) for each in place) for place in found] == expected
    assert at == pytest.approx({0: 0.01, 2: 0.003})


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("G33 Z-20", "MC118"),
        ("G33 Z-20 K-1", "MC118"),
        ("G33 K1.5", "MC118"),
        ("G33 Z-20 K1.5 I2", "MC112"),
        ("G33 Z-20 K1.5 Q90", "MC113"),
        ("G33 Z-20 K1.5 E1", "MC113"),
        ("G33 [3]20 K1.5", "MC177"),
        ("G1 G33 Z-20 K1.5", "MC153"),
        ("G33 Z-200 K1.5", "MC201"),
        # 30 mm a turn at S400 are the axis's 200 mm/s
        ("G33 Z-20 K30", "MC179"),
        ("G33 Z2 K10", "MC180"),
        ("G33 Z3 K1", "MC180"),
        ("M5 G33 Z-20 K1.5", "MC178"),
        ("S0 G33 Z-20 K1.5", "MC178"),
        ("G76 P1.5 Z-20 I-1 J0.3 K0.9 L1", "MC116"),
        ("G76 P1.5 Z-20 I-1 J0.3 K0.2", "MC116"),
        ("G76 P1.5 Z-20 I-1 J0 K0.2", "MC116"),
        ("G76 P1.5 Z-20 I-1 J0.3 K0.9 R0.5", "MC116"),
        ("G76 P1.5 Z-20 I-1 J0.3 K0.9 Q95", "MC116"),
        ("G76 P1.5 Z-20 J0.3 K0.9", "MC118"),
        ("G76 Z-20 I-1 J0.3 K0.9", "MC118"),
        ("G76 P1.5 X5 Z-20 I-1 J0.3 K0.9", "MC118"),
        ("G76 P010060 Q100 R50", "MC118"),
        ("G76 P1.5 Z-20 I-1 J0.00001 K90", "MC180"),
        ("G17 G76 P1.5 Z-20 I-1 J0.3 K0.9", "MC180"),
        ("G76 P1.5 Z-20 I-150 J0.3 K0.9", "MC201"),
    ],
)
def test_what_cannot_be_a_thread_is_refused_at_its_line(line: str, code: str) -> None:
    assert (code, 4) in faults(line)


def test_a_thread_without_a_spindle_that_is_an_axis_names_the_key() -> None:
    mill = parse_machine('[machine]\nname = "mill"\n[dialect]\nprofile = "cnc"\n' + axes_text(range(3)))
    (fault,) = check_program("G21\nS400 M3\nG33 Z-20 K1.5", mill)[-1:]
    assert (fault.code, fault.line) == ("MC177", 3)
    assert "spindle_axis" in fault.hint


def test_tapping_ends_where_it_began() -> None:
    found = values("G91 G33.1 Z-13 K1", "G1 X1 F100")
    (tap,) = [each for each in found if isinstance(each, ThreadLine)]
    assert (tap.taps, tap.targets, tap.travel) == (True, pytest.approx((-0.01,)), pytest.approx(0.026))
    assert faults("G33.1 Z2.8 K1") == [("MC180", 4)]
    # a spindle that is reversed faster than the axes can follow
    assert faults("G33.1 Z-20 K9.9") == [("MC179", 4)]


def test_tapping_cycles_tap_each_hole_with_the_pitch_of_f() -> None:
    found = values("G17 G99 G84 X10 Y5 Z-12 R4 F400", "X20", "G80")
    taps = [each for each in found if isinstance(each, ThreadLine)]
    assert [(each.line, each.taps, each.targets) for each in taps] == [
        (4, True, pytest.approx((-0.012,))),
        (5, True, pytest.approx((-0.012,))),
    ]
    # 400 mm/min at S400
    assert taps[0].pitch == pytest.approx(1.0 * MM)
    assert taps[0].length == pytest.approx(16.0 * MM)
    left = [each for each in values("M4", "G17 G74 Z-12 R4 F500") if isinstance(each, ThreadLine)]
    assert left[0].turns_s < 0.0


def test_tapping_in_pecks_falls_into_one_thread_from_r() -> None:
    found = values("G17 G84 X10 Z-12 R4 F400 Q6")
    taps = [each for each in found if isinstance(each, ThreadLine)]
    assert [each.targets for each in taps] == [pytest.approx((end * MM,)) for end in (-2.0, -8.0, -12.0)]
    # each from R to its depth and back
    assert [each.length for each in taps] == pytest.approx([6.0 * MM, 12.0 * MM, 16.0 * MM])


def test_rigid_taps_by_codes_of_their_own_are_g84_and_g74() -> None:
    for direction, code, same in (("M3", "G84.2", "G84"), ("M4", "G84.3", "G74")):
        words = "X10 Z-12 R4 F400"
        found, plain = (values(direction, f"G17 {each} {words}", "X20", "G80") for each in (code, same))
        assert found == plain


def spindle_speeds(found: list[Canonical]) -> list[float]:
    groups = [each.groups[0] for each in found if isinstance(each, MotionLine)]
    return [group.velocities[0] for group in groups if isinstance(group, SpeedGroup)]


def test_a_spindle_that_stands_turns_for_the_tap_alone() -> None:
    turning = 400.0 / 60.0 * TURN
    found = values("M5", "G17 M29 S400", "G84 X10 Z-12 R4 F400", "X20", "G80", "G95 G74 Z-12 R4 F1")
    assert spindle_speeds(found)[3:] == pytest.approx([turning, 0.0, turning, 0.0, -turning, 0.0])
    assert [each.pitch for each in found if isinstance(each, ThreadLine)] == pytest.approx([MM] * 3)
    assert faults("M5", "G17 G84 Z-12 R4 F400", "G33 Z-20 K1.5") == [("MC178", 6)]
    # what else the machine switches by M3 would be left out
    oiled = parse_machine(
        lathe_text(drive="ideal").replace("[[axis]]", "[dialect.outputs]\nM3 = { oil = true }\n[[axis]]", 1)
        + '[[output]]\nname = "oil"\nnumber = 0\n'
    )
    assert faults("M3 M5", "G17 G84 Z-12 R4 F400", machine=oiled, head=("S400",)) == [("MC178", 3)]


def test_what_stands_behind_m3_begins_when_the_spindle_has_its_speed() -> None:
    groups = [each.groups[0] for each in values("M3", "S300", "M4") if isinstance(each, MotionLine)]
    # a speed that it has needs no wait, and S alone changes it while it cuts
    expected = [SpeedGroup, DwellGroup, RapidGroup, SpeedGroup, SpeedGroup, SpeedGroup, DwellGroup]
    assert [type(each) for each in groups] == expected
    ramps = [each.seconds for each in groups if isinstance(each, DwellGroup)]
    spindle = LATHE.axes[3]
    assert ramps == pytest.approx([stopping_seconds(spindle, turns / 60.0) for turns in (400.0, 600.0)])


def test_g86_draws_the_tool_out_of_the_hole_while_the_spindle_stands() -> None:
    def kind(value: Canonical) -> str:
        assert isinstance(value, MotionLine)
        return type(value.groups[0]).__name__.removesuffix("Group")

    found = values("G17 G99 G86 X20 Z-5 R2 P0.5 F100", "X30")[3:]
    bored = ["Rapid", "Rapid", "Feed", "Dwell", "Speed", "Dwell", "Rapid", "Speed", "Dwell"]
    assert [kind(each) for each in found][:9] == bored
    turning = 400.0 / 60.0 * TURN
    assert spindle_speeds(found) == pytest.approx([0.0, turning] * 2)
    assert faults("G17 M5 G86 X20 Z-5 R2 F100") == [("MC178", 4)]


def test_fanucs_fine_boring_is_refused_as_such() -> None:
    assert faults("G17 G76 X5 Z-5 R2 P100 Q0.1 F100") == [("MC141", 4)]


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("G84 Z-12 R4 F400 P0.5", "MC146"),
        # the pitch without G95
        ("G84 Z-12 R4 F1.25", "MC173"),
        ("G84 Z-12 R4 F400 J2", "MC112"),
        # a peck has to hold the run-in
        ("G84 Z-12 R4 F400 Q0.1", "MC180"),
        ("G74 Z-12 R4 F400", "MC178"),
        ("M4 G84 Z-12 R4 F400", "MC178"),
        ("M5 S0 G84 Z-12 R4 F400", "MC178"),
        ("G84 Z-12 R4", "MC121"),
        ("G84 Z4 R-12 F400", "MC146"),
        ("G84 Z3.9 R4 F400", "MC180"),
        ("G93 G84 Z-12 R4 F400", "MC146"),
    ],
)
def test_what_cannot_be_tapped_is_refused(line: str, code: str) -> None:
    assert (code, 5) in faults("G17", line)


def test_m19_turns_the_spindle_to_an_angle_from_where_it_stands() -> None:
    for line, turned in (
        ("M19 R90", 90.0),
        ("M19 R270", -90.0),
        ("M19 R270 P1", 270.0),
        ("M19 R90 P2", -270.0),
        ("M19", 0.0),
    ):
        motion = values(line)[-1]
        assert isinstance(motion, MotionLine)
        (group,) = motion.groups
        assert isinstance(group, RapidGroup)
        assert (group.axes, group.targets[0] / DEGREE) == ((SPINDLE,), pytest.approx(turned))
    assert faults("M19 P3") == [("MC116", 4)]
    assert faults("M19 R0", "G33 Z-20 K1") == [("MC178", 5)]


def test_bare_words_do_not_repeat_a_thread() -> None:
    assert faults("G33 Z-20 K1.5", "Z-30") == [("MC113", 5)]
    assert faults("G17 G81 Z-1 R1 F100", "G33 Z-20 K1.5", "X5") == [("MC113", 6)]


def test_a_thread_does_not_go_with_cutter_compensation() -> None:
    assert ("MC170", 6) in faults("G42.1 D2", "G1 X12 F100", "G33 Z-20 K1.5")


@pytest.mark.parametrize("line", ["S400 M3", "M5", "S400", "G0 X1 S400", "M19"])
def test_a_spindle_that_is_not_leased_is_not_left_unsaid(line: str) -> None:
    interpreter = Interpreter(LATHE, lease=frozenset({0, 2}))
    with pytest.raises(ProgramRejected, match="axis 3 is not among the axes"):
        interpreter.interpret(interpreter.parse(line, 1))


@pytest.mark.parametrize(
    ("text", "axes"),
    [
        ("G0 X1", (0,)),
        ("G0 X1 S400M03\nG0 X1", (0, 3)),
        ("M30\nG0 X1", (0,)),
        ("G0 X1 S400", (0, 3)),
        ("G84 Z1", (2, 3)),
        ("#1=2\nG0 X#1", (0, 1, 2, 3)),
    ],
)
def test_a_run_that_is_asked_for_has_its_spindle(text: str, axes: tuple[int, ...]) -> None:
    known = tuple(axis.index for axis in LATHE.axes)
    assert axes_used(text, LATHE) == tuple(axis for axis in axes if axis in known)
