"""Every listing of the reference, its scanning errors corrected, gives what the dialect's table says."""

import math

import numpy as np
import pytest

from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.motion.canonical import AxisLine, AxisOperation, DwellGroup, FeedGroup, MotionLine, RapidGroup
from mcserver.motion.geometry.curves import ArcCurve, LineCurve, SampledCurve
from tests.gcode.support import CARTESIAN, Gantries, Program, machine_of

DOG = machine_of(" ".join(f"{n}:linear" for n in range(12)), "3:0,1,2 6:3,4,5 9:6,7,8 12:9,10,11")
DOG_START = {2: 0.0, 5: 0.8, 8: -0.1, 11: -0.8} | dict.fromkeys((1, 4, 7, 10), -0.4)

ARCS = [
    "G1010",
    "G94 F30000",
    "G00 X0 Y0",
    "G01 V1000",
    "G02 X1000 Y2000 R1000",
    "G01 U1000",
    "G02 X3000 Y1000 R1000",
    "G01 V-1000",
    "G02 X2000 Y-1000 I-1000 J0",
    ";G02 X2000 Y-1000 R1000",
    "G01 U-1000",
    "G02 X0 Y0 I0 J1000",
    ";G02 X0 Y0 R1000",
    "G01 U500 V500",
    ";Full Circle",
    "G02 X500 Y500 I1000 J0",
    "G04 P2.5",
    "G1011",
]


def test_g01_listing_takes_the_times_of_its_comments() -> None:
    program = Program()
    program.run("G1010", "G94", "F6000")
    first = program.straight("G01 X-100 Y200 Z-100 ;Linear Cartesian axes")
    assert first.axes == (0, 1, 2)
    assert first.end == pytest.approx((-0.1, 0.2, -0.1))
    assert first.length == pytest.approx(math.sqrt(0.06))
    increment = program.feed("G01 U-10 V-50 W-100")
    assert increment.requested == pytest.approx(math.sqrt(0.0126) / 0.1)
    assert [program.mm(axis) for axis in (0, 1, 2)] == [-110.0, 150.0, -200.0]
    program.run("G93", "F120")
    assert program.feed("G01 [3]-45 [4]90 [5]-180 ;Rotary axes").requested == pytest.approx(0.5)
    program.run("G93 F240")
    mixed = program.motion("G01 X100 Y90 [3]45 [4]90")
    assert isinstance(mixed.groups[0], FeedGroup)
    assert mixed.groups[0].requested == pytest.approx(0.25)
    assert mixed.groups[0].axes == (0, 1, 3, 4)
    reset, release = program.run("G1000", "G1011")
    assert isinstance(reset, AxisLine)
    assert isinstance(release, AxisLine)
    assert (reset.operation, release.operation) == (AxisOperation.RESET, AxisOperation.RELEASE)
    assert reset.axes == tuple(range(12))


def test_arc_listing_has_a_feed_path_of_17273_millimetres_and_goes_through_its_points() -> None:
    interpreter = Interpreter(CARTESIAN)
    points: list[tuple[float, float]] = []
    length = 0.0
    for number, text in enumerate(ARCS, start=1):
        for value in interpreter.interpret_text(text, number):
            if isinstance(value, MotionLine):
                length += value.feed_length
                if not isinstance(value.groups[0], DwellGroup):
                    here = interpreter.positions
                    points.append((round(here[0] * 1e3, 6), round(here[1] * 1e3, 6)))
    assert round(length * 1e3, 1) == 17273.5
    assert points == [
        *[(0, 0), (0, 1000), (1000, 2000), (2000, 2000), (3000, 1000), (3000, 0)],
        *[(2000, -1000), (1000, -1000), (0, 0), (500, 500), (500, 500)],
    ]


def test_arc_listing_ends_with_a_clockwise_circle_about_1500_500_and_a_dwell() -> None:
    program = Program()
    program.run(*ARCS[:-3])
    circle = program.arc(ARCS[-3])
    assert circle.centre == pytest.approx((1.5, 0.5))
    assert circle.sweep == pytest.approx(-2.0 * math.pi)
    assert program.motion(ARCS[-2]).groups == (DwellGroup(2.5),)


@pytest.mark.parametrize(
    ("centre_form", "radius_form", "before"),
    [
        ("G02 X2000 Y-1000 I-1000 J0", "G02 X2000 Y-1000 R1000", "G00 X3000 Y0"),
        ("G02 X0 Y0 I0 J1000", "G02 X0 Y0 R1000", "G00 X1000 Y-1000"),
    ],
)
def test_alternatives_in_the_arc_listing_give_the_same_arc(
    centre_form: str, radius_form: str, before: str
) -> None:
    curves = []
    for form in (centre_form, radius_form):
        program = Program()
        program.run("F6000", before)
        curves.append(program.arc(form))
    assert curves[0].centre == pytest.approx(curves[1].centre)
    assert curves[0].sweep == pytest.approx(curves[1].sweep)


def test_helix_version_1_is_two_turns_about_1000_0_timed_by_the_helix() -> None:
    program = Program()
    program.run("G1010 P0", "G1010 P1", "G1010 P2", "G01 X0 Y0 Z0 F30000")
    group = program.feed("G03 X0 Y0 Z2000 I1000 J0 P2")
    (helix,) = group.curves
    assert isinstance(helix, ArcCurve)
    assert helix.axes == (0, 1, 2)
    assert helix.centre == pytest.approx((1.0, 0.0))
    assert helix.sweep == pytest.approx(4.0 * math.pi)
    assert (helix.start[2], helix.end[2]) == (0.0, 2.0)
    assert group.requested == pytest.approx(math.hypot(4.0 * math.pi, 2.0) / 0.5)


def test_helix_version_2_is_the_same_curve_timed_by_its_circle() -> None:
    program = Program()
    program.run("G01 X0 Y0 Z0 F30000")
    group = program.feed("G03 X0 Y0 I1000 J0 P2 G01 Z2000")
    circle, rise = group.curves
    assert isinstance(circle, ArcCurve)
    assert isinstance(rise, LineCurve)
    assert circle.sweep == pytest.approx(4.0 * math.pi)
    assert (rise.start, rise.end) == ((0.0,), (2.0,))
    assert group.requested == pytest.approx(25.133, abs=5e-4)


def test_g1050_in_mid_line_joins_a_tool_move_and_a_direct_move() -> None:
    program = Program(DOG, Gantries(DOG))
    program.run("G93 F60")
    group = program.feed("G01 T3 X-59.0 Y-417.5 Z404.5 G1050 G01 [8]90")
    tool, direct = group.curves
    assert isinstance(tool, SampledCurve)
    assert tool.axes == (0, 1, 2)
    assert isinstance(direct, LineCurve)
    assert direct.axes == (8,)
    assert program.interpreter.modal.tool is None


def test_primitive_lasts_one_second() -> None:
    program = Program()
    program.run("G93", "F60")
    group = program.feed("G01 [5]100 [6]200 [7]0 [8]-90")
    assert (group.requested, group.duration, group.axes) == (1.0, 1.0, (5, 6, 7, 8))


def test_concatenation_lasts_one_second_together() -> None:
    program = Program()
    program.run("G00 X50 Y50", "G93", "F60")
    group = program.feed("G01 [5]100 [6]200 [7]0 [8]-90 G02 X100 Y100 R50")
    arc = group.curves[1]
    assert isinstance(arc, ArcCurve)
    assert arc.sweep == pytest.approx(-math.pi / 2.0)
    assert group.duration == 1.0


def test_concatenation_from_the_origin_has_a_chord_longer_than_the_diameter() -> None:
    program = Program()
    program.run("G93", "F60")
    (fault,) = program.faults("G01 [5]100 [6]200 [7]0 [8]-90 G02 X100 Y100 R50")
    assert fault.code == "MC104"
    assert "141.42" in fault.message


def test_comma_gives_each_group_its_own_time_and_the_line_the_longest() -> None:
    program = Program()
    program.run("G00 X50 Y50", "G93")
    line = program.motion("G01 [5]100 [6]200 [7]0 [8]-90 F60, G02 X100 Y100 R50 F120")
    first, second = line.groups
    assert isinstance(first, FeedGroup)
    assert isinstance(second, FeedGroup)
    assert (first.requested, second.requested) == (1.0, 0.5)


def test_robot_dog_lines_last_one_second_and_lift_the_feet() -> None:
    kinematics = Gantries(DOG)
    program = Program(DOG, kinematics, positions=DOG_START)
    program.run("G1010", "G93 F60 ;moves/min or steps/min")
    gait = [
        "G01 T3 X-159 Y-400 Z800 G01 T12 X159 Y-400 Z-100 G02 T6 Y-400 Z0 R500 G02 T9 Y-400 Z-800 R500",
        "G01 T6 X159 Y-400 Z800 G01 T9 X-159 Y-400 Z-100 G02 T3 Y-400 Z0 R500 G02 T12 Y-400 Z-800 R500",
    ]
    for text in gait:
        group = program.feed(text)
        assert len(group.curves) == 4
        assert group.requested == pytest.approx(1.0)
    s = np.linspace(0.0, 1.0, 2001)
    lift: dict[int, float] = {}
    for tool, path, _ in kinematics.solved:
        lift[tool] = max(lift.get(tool, 0.0), 1e3 * (float(path.position(s)[:, 1].max()) + 0.4))
    assert lift == pytest.approx({3: 200.0, 6: 200.0, 9: 142.9, 12: 142.9}, abs=0.05)


def test_g00_listing_moves_linear_and_rotary_axes() -> None:
    line = Program().motion("G00 X-100 [5]100 [6]200 [7]0 [8]-90")
    (group,) = line.groups
    assert isinstance(group, RapidGroup)
    assert group.axes == (0, 5, 6, 7, 8)
    assert group.wait
    assert line.exact_stop


def test_servo_speed_and_torque_listings() -> None:
    machine = machine_of("0:linear 1:linear 2:linear 3:rotary 4:rotary 5:rotary 10:rotary")
    program = Program(machine)
    servo = program.motion("G1020 [0]1000.5 [1]-40.18 [10]90").groups[0]
    assert isinstance(servo, RapidGroup)
    assert not servo.wait
    assert program.motion("G1020 X400.5 Y-119.785 Z100 A90 B-45 C0").groups[0].axes == (0, 1, 2, 3, 4, 5)  # type: ignore[union-attr]
    torque = program.motion("G1040 [0]0.14 [1]-1.2 [10]0.75").groups[0]
    assert torque.torques == (0.14, -1.2, 0.75)  # type: ignore[union-attr]
    program = Program(machine)
    speed = program.motion("G1030 [0]3000 [1]-1000 [10]150").groups[0]
    assert speed.velocities == pytest.approx((0.5, -1.0 / 6.0, 5.0 * math.pi))  # type: ignore[union-attr]


def test_names_and_indices_are_the_same_axes() -> None:
    assert Program().run("G00 Y3.5 Z-1.2") == Program().run("G00 [1]3.5 [2]-1.2")
