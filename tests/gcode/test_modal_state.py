"""Modal state (D-10 to D-15, D-05)."""

import pytest

from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.semantics.modal import INITIAL
from mcserver.machine.machine_file import parse_machine
from mcserver.motion.canonical import EndLine, FeedGroup, MotionLine, PauseLine
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from tests.gcode.support import CARTESIAN, Program, check, feeding, machine_of
from tests.machine_text import axes_text

ROUNDING = machine_of("0:linear 1:linear", motion="[motion]\npath_tolerance_mm = 0.25\n")


def test_a_program_starts_in_g21_g90_g94_g64_with_nothing_else() -> None:
    modal = Interpreter(CARTESIAN).modal
    assert (modal.inch, modal.incremental, modal.inverse_time, modal.exact_stop) == (
        False,
        False,
        False,
        False,
    )
    assert (modal.tool, modal.feed, modal.plane, modal.motion, modal.tolerance) == (None,) * 5


@pytest.mark.parametrize("end", ["M02", "M30", "M2"])
def test_the_programs_end_brings_the_initial_state_back(end: str) -> None:
    program = Program()
    values = program.run("G20 G91 G93 F60 G61 G18 G09", "G01 X1", end, "G01 X1")
    assert program.interpreter.modal == INITIAL
    assert program.interpreter.ended
    assert values[-1] == EndLine(3)


def test_what_follows_the_end_is_not_read() -> None:
    program = Program()
    assert program.run("M30", "G01 X10", "F-1") == [EndLine(1)]
    assert program.run("M30 G01 X10") == []
    values = feeding().run("G01 X1 M30 G01 Y5")
    assert [type(value) for value in values] == [MotionLine, EndLine]


def test_two_programs_do_not_share_modal_state() -> None:
    one, other = Program(), Program()
    one.run("G20 G91 F60")
    assert other.interpreter.modal == INITIAL


def test_pause_stands_before_or_after_the_lines_motion() -> None:
    program = feeding()
    first = program.run("M00 G01 X1")
    assert [type(value) for value in first] == [PauseLine, MotionLine]
    second = program.run("G01 X2 M01")
    assert [type(value) for value in second] == [MotionLine, PauseLine]
    assert [type(value) for value in program.run("G01 X3 M30")] == [MotionLine, EndLine]


def test_f_is_read_in_the_units_where_it_stands_and_kept_as_a_speed() -> None:
    program = Program()
    program.run("F6000", "G20")
    assert program.feed("G01 X1").speed == pytest.approx(0.1)
    program.run("F60")
    assert program.feed("G01 X2").speed == pytest.approx(0.0254)
    program.run("G21")
    assert program.feed("G01 X3").speed == pytest.approx(0.0254)


def test_f_keeps_its_number_for_a_rotary_move_whatever_the_units() -> None:
    program = Program()
    program.run("G20 F360")
    group = program.feed("G01 [3]90")
    assert group.requested == pytest.approx(15.0)
    program.run("G21")
    assert program.feed("G01 [3]0").requested == pytest.approx(15.0)


def test_f_after_the_axis_words_holds_for_the_whole_command() -> None:
    assert feeding().feed("G01 X100 F600").requested == pytest.approx(10.0)


def test_f_between_modal_codes_is_read_where_it_stands() -> None:
    program = Program()
    assert program.feed("G01 F60 G20 X1").speed == pytest.approx(0.001)
    assert program.feed("G01 G20 F60 X2").speed == pytest.approx(0.0254)


@pytest.mark.parametrize("text", ["F0", "F-100", "G01 X1 F0", "G93 F-60", "F0.0000000001"])
def test_f_must_be_above_zero(text: str) -> None:
    assert feeding().codes(text) == ["MC120"]


def test_changing_between_g93_and_g94_forgets_f() -> None:
    program = feeding("G93")
    (fault,) = program.faults("G01 X1")
    assert fault.code == "MC121"
    program.run("F60", "G01 X1", "G94")
    assert program.codes("G01 X2") == ["MC121"]


def test_repeating_the_mode_keeps_f() -> None:
    program = feeding("G94", "G94")
    assert program.feed("G01 X100").requested == pytest.approx(1.0)


def test_f_before_a_change_of_mode_in_one_command_is_forgotten() -> None:
    assert Program().codes("G01 F60 G93 X1") == ["MC121"]


def test_a_feed_move_without_f_is_an_error_that_says_so() -> None:
    (fault,) = Program().faults("G01 X1")
    assert fault.code == "MC121"
    assert "F" in fault.hint


def test_g20_governs_linear_words_and_radii_but_never_rotary_ones() -> None:
    program = feeding("G20")
    program.run("G01 X2 Y0", "G01 [3]90")
    assert program.mm(0) == 50.8
    assert program.deg(3) == 90.0
    arc = program.arc("G02 X4 Y0 R1")
    assert arc.centre == pytest.approx((0.0762, 0.0))
    arc = program.arc("G02 X2 Y0 I-1 J0")
    assert arc.centre == pytest.approx((0.0762, 0.0))


def test_the_last_word_stands_in_the_units_that_a_code_inside_the_command_chose() -> None:
    program = feeding()
    program.run("G01 G20 X1")
    assert program.mm(0) == 25.4


def test_g91_makes_words_increments_and_g90_ends_it() -> None:
    program = feeding("G93 F60", "G91")
    program.run("G01 X10 [3]5", "G01 X10 [3]5")
    assert (program.mm(0), program.deg(3)) == (20.0, 10.0)
    program.run("G90", "G01 X5")
    assert program.mm(0) == 5.0


def test_u_v_w_are_increments_in_either_mode() -> None:
    program = feeding("G00 X10 Y10 Z10", "G01 U1 V-2 W3", "G91", "G01 U1 V-2 W3")
    assert [program.mm(axis) for axis in range(3)] == [12.0, 6.0, 16.0]


def test_modal_codes_before_axis_words_leave_them_to_the_command() -> None:
    program = feeding("G01 X5", "G01 G91 X10")
    assert program.mm(0) == 15.0


def test_a_modal_code_behind_axis_words_acts_after_the_command() -> None:
    program = feeding("G01 X5", "G01 X10 G91")
    assert program.mm(0) == 10.0
    assert program.interpreter.modal.incremental


def test_commands_of_one_line_see_codes_from_left_to_right() -> None:
    program = feeding("G00 X5 Y5", "G01 X10 G91 G01 Y10")
    assert (program.mm(0), program.mm(1)) == (10.0, 15.0)


def test_offsets_are_increments_from_the_start_under_g90_too() -> None:
    program = feeding("G00 X100 Y100")
    assert program.arc("G02 X110 Y110 I10 J0").centre == pytest.approx((0.11, 0.1))


def test_g09_affects_only_the_next_motion() -> None:
    program = feeding()
    assert program.motion("G09 G01 X100.50").exact_stop
    assert not program.motion("G01 Y-100").exact_stop


def test_g09_alone_waits_for_the_next_motion_command() -> None:
    program = feeding("G09", "F100", "G91", "(nothing)")
    assert program.motion("G04 P1").exact_stop is False
    assert program.motion("G01 X1").exact_stop
    assert not program.motion("G01 X1").exact_stop


def test_g09_before_several_commands_holds_for_their_line() -> None:
    program = feeding("G93 F60")
    line = program.motion("G09 G01 X1 G01 Y1, G01 Z1")
    assert line.exact_stop
    assert not program.motion("G01 X2").exact_stop


def test_g09_behind_a_motion_holds_for_the_next_line() -> None:
    program = feeding()
    assert not program.motion("G01 X1 G09").exact_stop
    assert program.motion("G01 X2").exact_stop


def test_g09_is_used_up_by_g00_and_g1020() -> None:
    program = feeding("G09", "G00 X1")
    assert not program.motion("G01 X2").exact_stop
    program.run("G09", "G1020 X3")
    assert not program.motion("G01 Y2").exact_stop


def test_g61_is_modal_until_g64() -> None:
    program = feeding("G61")
    assert program.motion("G01 X1").exact_stop
    assert program.motion("G02 X3 R1 Y0").exact_stop
    program.run("G64")
    assert not program.motion("G01 X1").exact_stop


def test_g64_p_sets_the_tolerance_and_g64_alone_goes_back_to_the_machines() -> None:
    program = Program(ROUNDING)
    program.run("F6000")
    assert program.motion("G01 X1").tolerance == pytest.approx(0.25e-3)
    program.run("G64 P0.1")
    assert program.motion("G01 X2").tolerance == pytest.approx(0.1e-3)
    program.run("G64 P0")
    assert program.motion("G01 X3").tolerance == 0.0
    program.run("G20 G64 P0.01")
    assert program.motion("G01 X1").tolerance == pytest.approx(0.254e-3)
    program.run("G64")
    assert program.motion("G01 X0").tolerance == pytest.approx(0.25e-3)
    assert program.codes("G64 P-1") == ["MC116"]


def test_axis_words_without_a_code_repeat_the_last_motion() -> None:
    program = feeding("G01 X1")
    assert program.straight("X2 Y3").end == pytest.approx((0.002, 0.003))
    program.run("G00 X0 Y0", "X5", "F100", "G04 P1")
    assert program.motion("Y5").exact_stop
    program.run("G02 X10 Y0 R10", "G91")
    assert program.arc("X10 Y0 R10").centre is not None


def test_each_comma_group_repeats_too_and_the_last_motion_of_a_line_counts() -> None:
    program = feeding("G01 X1, Y2")
    assert (program.mm(0), program.mm(1)) == (1.0, 2.0)
    program.run("G02 X3 Y2 R1 G01 Z5")
    assert program.straight("X9").end == pytest.approx((0.009,))


def test_axis_words_with_nothing_to_repeat_are_an_error() -> None:
    assert feeding().codes("X10 Y5") == ["MC113"]
    assert feeding("G1020 X1").codes("X10") == ["MC113"]


def test_axis_words_behind_a_probe_do_not_drill_once_more() -> None:
    machine = parse_machine(
        '[machine]\nname = "mill"\n[probe]\ninput = 0\n[[input]]\nnumber = 0\nname = "probe"\n'
        f'[dialect]\nprofile = "cnc"\n{axes_text(range(3))}'
    )
    lines = "F100", "G0 Z10", "G81 X1 Y1 Z-1 R2", "G38.3 Z5", "X10"
    assert check(*lines, machine=machine) == [(5, "MC113")]


def test_offsets_on_a_repeated_straight_move_are_refused() -> None:
    assert feeding("G01 X1").codes("X10 I5") == ["MC112"]


def test_a_motion_code_alone_is_only_chosen() -> None:
    program = feeding()
    assert program.run("G01") == []
    assert program.straight("X10").end == pytest.approx((0.01,))


def test_a_faulty_line_leaves_the_state_as_it_was() -> None:
    program = feeding("G01 X1")
    before = (program.interpreter.modal, dict(program.interpreter.positions))
    for text in ("G20 G91 G01 X5 Y9999", "G93 G01 X1", "G61 F0", "G01 X5 G02 Y1", "G18 T9"):
        assert program.faults(text)
        assert (program.interpreter.modal, dict(program.interpreter.positions)) == before


def test_an_axis_that_the_machine_lacks_is_an_error_that_lists_its_axes() -> None:
    (fault,) = Program(machine_of("0:linear 2:linear")).faults("G00 Y5")
    assert (fault.code, fault.column, fault.axis) == ("MC108", 5, 1)
    assert "0, 2" in fault.hint


def test_an_axis_outside_the_lease_is_an_error() -> None:
    program = Program(CARTESIAN, lease=frozenset({0, 1}))
    assert program.codes("G00 X1 Z1") == ["MC109"]
    assert program.codes("G1010 P2") == ["MC109"]
    assert program.codes("G02 X1 Z1 R1 F100") == ["MC109"]


def test_modal_state_can_be_rebuilt_before_any_line() -> None:
    lines = ["G20 G91 F60", "G01 X1", "G61", "G01 X1 Y1", "G01 X1"]
    resumption = state_before(lines, 5, CARTESIAN, StartState.of(CARTESIAN))
    whole = Program()
    whole.run(*lines[:4])
    assert resumption.modal == whole.interpreter.modal
    assert resumption.positions == whole.interpreter.positions
    resumed = Interpreter(CARTESIAN, modal=resumption.modal, positions=resumption.positions)
    assert resumed.interpret_text(lines[4], 5) == whole.run(lines[4])


def test_several_feeds_of_a_line_are_in_force_in_reading_order() -> None:
    program = Program()
    first, second = program.motion("G01 X10 F600, G01 Y10 F1200").groups
    assert isinstance(first, FeedGroup)
    assert isinstance(second, FeedGroup)
    assert (first.speed, second.speed) == pytest.approx((0.01, 0.02))
    assert program.feed("G01 Z10").speed == pytest.approx(0.02)
