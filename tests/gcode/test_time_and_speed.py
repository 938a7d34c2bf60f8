"""Durations, speeds, concatenation and commas (D-02, D-21, D-24 to D-26, D-28, D-30 to D-32)."""

import math

import pytest

from mcserver.motion.canonical import DwellGroup, FeedGroup, RapidGroup, SpeedGroup, TorqueGroup
from tests.gcode.support import Program, feeding, machine_of

MANY = machine_of("0:linear 1:linear 2:linear 3:rotary 4:rotary 6:linear 7:linear:-100:100 8:rotary:-90:90")


def many(*lines: str) -> Program:
    return feeding(*lines, machine=MANY)


def test_g93_lasts_sixty_seconds_over_f() -> None:
    group = many("G93", "F240").feed("G01 X5 [3]7 [4]9 [6]1")
    assert (group.duration, group.requested, group.speed) == (0.25, 0.25, None)


def test_g93_without_travel_lasts_as_long() -> None:
    group = many("G93 F120").feed("G01 X0")
    assert (group.requested, group.curves[0].length) == (0.5, 0.0)


def test_g93_does_not_care_for_inches() -> None:
    assert many("G20 G93 F120").feed("G01 X1").requested == 0.5


@pytest.mark.parametrize(
    ("text", "length"),
    [
        ("G01 X30 Y40", 50.0),
        ("G01 X-30", 30.0),
        ("G01 X10 Y10 Z10", math.sqrt(300)),
        ("G01 X30 [6]40", 50.0),
        ("G01 X0 Y5", 5.0),
    ],
)
def test_g94_length_is_the_root_of_squares_over_up_to_three_linear_axes(text: str, length: float) -> None:
    group = many().feed(text)
    assert group.curves[0].length == pytest.approx(length / 1e3)
    assert group.requested == pytest.approx(length / 100.0)
    assert (group.speed, group.duration) == (pytest.approx(0.1), None)


def test_one_rotary_axis_moves_in_degrees_per_minute() -> None:
    group = many().feed("G01 [3]90 F360")
    assert group.requested == pytest.approx(15.0)
    assert group.speed == pytest.approx(math.radians(6.0))
    assert group.curves[0].length == pytest.approx(math.pi / 2.0)


@pytest.mark.parametrize(
    "text",
    [
        "G01 [3]5 [4]5",
        "G01 X5 [3]5",
        "G01 X5 Y5 Z5 [6]5",
        "G01 X5 [3]0",
        "G01 [3]0 [4]0",
        "G01 [3]5 [4]5 G01 X5",
    ],
)
def test_g94_has_no_speed_for_other_mixes_travelling_or_not(text: str) -> None:
    (fault,) = many().faults(text)
    assert fault.code == "MC122"
    assert "G93" in fault.hint


def test_feed_length_sums_the_linear_part() -> None:
    program = many()
    assert program.motion("G01 X3 Y4").feed_length == pytest.approx(0.005)
    assert program.motion("G01 [3]90").feed_length == 0.0
    assert program.motion("G00 X0 Y0").feed_length == 0.0
    assert program.motion("G93 F60 G01 X3 [3]0 G01 Y4").feed_length == pytest.approx(0.007)
    assert program.motion("G02 X3 Y24 R10").feed_length == pytest.approx(math.pi * 0.01)


def test_the_first_command_of_a_concatenation_sets_the_time() -> None:
    group = many().feed("G01 X50 G01 [3]90 [4]45")
    assert group.requested == pytest.approx(0.5)
    assert group.reference == 0
    assert [curve.axes for curve in group.curves] == [(0,), (3, 4)]


def test_an_f_in_a_later_command_of_a_concatenation_counts_from_there_on() -> None:
    program = many("G93")
    assert program.feed("G01 X5 F60 G01 Y5 F120").requested == 1.0
    assert program.feed("G01 X6").requested == 0.5


def test_a_first_command_without_travel_takes_the_longest_of_the_others() -> None:
    group = many().feed("G01 X0 G01 Y50 G01 Z100")
    assert group.reference == 2
    assert group.requested == pytest.approx(1.0)
    group = many().feed("G01 X0 G01 Y50 G01 [3]90 F360")
    assert (group.reference, group.speed) == (2, pytest.approx(math.radians(6.0)))


def test_a_first_command_without_travel_before_one_without_a_speed_is_refused() -> None:
    assert many().codes("G01 X0 G01 [3]90 [4]45") == ["MC122"]
    assert many().codes("G01 X0 G01 [3]0 [4]0") == []


def test_a_line_where_nothing_travels_asks_for_no_time_under_g94() -> None:
    assert many().feed("G01 X0 G01 Y0").requested == 0.0


def test_the_same_axis_in_two_commands_of_a_line_is_refused_at_the_second_word() -> None:
    for text, column in (("G01 X1 G01 X2", 12), ("G01 X1, G01 [0]2", 13), ("G00 X1, G1030 X5", 15)):
        (fault,) = many().faults(text)
        assert (fault.code, fault.column, fault.axis) == ("MC114", column, 0)


def test_groups_behind_commas_have_times_of_their_own() -> None:
    line = many().motion("G01 X100, G01 Y50 F1500, G00 Z5, G04 P3, G1020 [3]5, G1030 [4]10, G1040 [6]2")
    kinds = [type(group) for group in line.groups]
    assert kinds == [FeedGroup, FeedGroup, RapidGroup, DwellGroup, RapidGroup, SpeedGroup, TorqueGroup]
    first, second = line.groups[0], line.groups[1]
    assert isinstance(first, FeedGroup)
    assert isinstance(second, FeedGroup)
    assert (first.requested, second.requested) == (pytest.approx(1.0), pytest.approx(2.0))
    assert line.exact_stop


def test_a_group_may_hold_settings_only() -> None:
    program = many()
    assert len(program.motion("G01 X100, F1500").groups) == 1
    assert program.feed("G01 X0").requested == pytest.approx(4.0)


def test_dwell_needs_seconds_that_are_not_negative() -> None:
    assert many().motion("G04 P2.5").groups == (DwellGroup(2.5),)
    assert many().motion("G04 P0").groups == (DwellGroup(0.0),)
    assert many().codes("G04") == ["MC118"]
    assert many().codes("G04 P-1") == ["MC116"]


def test_servo_moves_do_not_wait_and_set_the_commanded_end() -> None:
    program = many("G1020 X5")
    assert program.mm(0) == 5.0
    line = program.motion("G91 G1020 X5")
    assert line.groups == (RapidGroup((0,), (pytest.approx(0.01),), wait=False),)
    assert not line.exact_stop


def test_servo_speed_and_torque_name_at_least_one_axis() -> None:
    for code in ("G1020", "G1030", "G1040"):
        assert many().codes(code) == ["MC118"]


def test_motor_speed_is_converted_by_the_travel_per_turn() -> None:
    assert many().motion("G1030 X60 [3]-60").groups == (
        SpeedGroup((0, 3), (pytest.approx(0.01), pytest.approx(-2.0 * math.pi))),
    )


def test_a_motor_speed_beyond_max_velocity_is_refused_with_the_most() -> None:
    (fault,) = many().faults("G1030 Y5 X6001")
    assert (fault.code, fault.column, fault.axis) == ("MC202", 10, 0)
    assert "6000" in fault.hint
    assert many().codes("G1030 X6000") == []


def test_speeds_and_torques_are_no_increments() -> None:
    assert many().codes("G1030 U5") == ["MC112"]
    assert many("G91").motion("G1040 X5").groups == (TorqueGroup((0,), (5.0,)),)


@pytest.mark.parametrize(
    ("text", "column"),
    [("G01 X1 [7]100.1", 8), ("G00 [7]-101", 5), ("G1020 [7]500", 7), ("G91 G01 [7]101", 9)],
)
def test_targets_beyond_an_axiss_travel_are_refused_at_its_word(text: str, column: int) -> None:
    (fault,) = many().faults(text)
    assert (fault.code, fault.column, fault.axis) == ("MC201", column, 7)
    assert "100 mm" in fault.message


def test_a_target_at_the_very_limit_is_fine_in_inches_too() -> None:
    assert many().codes("G01 [7]100") == []
    assert many("G20").codes("G01 [7]3.93700787401") == []
    assert many().codes("G00 [8]-90") == []


def test_an_axis_that_stands_outside_its_travel_may_come_back() -> None:
    program = Program(MANY, positions={7: 0.15})
    assert program.codes("G01 [7]120 F100") == ["MC201"]
    assert program.codes("G01 [7]90 F100") == []


def test_several_faults_of_one_line_come_in_reading_order() -> None:
    assert many("G93").codes("G01 [7]200 [9]1 [8]91 F-5") == ["MC201", "MC108", "MC201", "MC120"]
