"""Axis commands (D-40), and where positions come from after them (D-14, D-25)."""

import msgspec
import pytest

from mcserver.errors import ProgramRejected
from mcserver.gcode.text.parser import scan_line
from mcserver.machine.follow_section import Follow
from mcserver.motion.canonical import AxisLine, AxisOperation, MotionLine
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from tests.gcode.support import Gantries, Program, feeding, machine_of

TOOLED = machine_of("0:linear 1:linear 2:linear 3:linear", "3:0,1,2")


def need(program: Program, text: str) -> set[int]:
    return set(program.interpreter.axes_to_sync(scan_line(text, 9)))


@pytest.mark.parametrize(
    ("code", "operation"),
    [
        ("G1000", AxisOperation.RESET),
        ("G1001", AxisOperation.OFF),
        ("G1002", AxisOperation.STOP),
        ("G1010", AxisOperation.CAPTURE),
        ("G1011", AxisOperation.RELEASE),
    ],
)
def test_axis_commands_mean_all_axes_or_the_one_of_p(code: str, operation: AxisOperation) -> None:
    program = Program()
    assert program.run(code) == [AxisLine(1, operation, tuple(range(12)))]
    assert program.run(f"{code} P5") == [AxisLine(2, operation, (5,))]


def test_all_axes_are_those_of_the_lease() -> None:
    program = Program(lease=frozenset({1, 2}))
    assert program.run("G1010") == [AxisLine(1, AxisOperation.CAPTURE, (1, 2))]


@pytest.mark.parametrize("text", ["G1010 P12", "G1010 P-1", "G1010 P1.5", "G1010 P64", "G1010 P1000000"])
def test_p_names_an_axis_of_the_machine(text: str) -> None:
    (fault,) = Program().faults(text)
    assert (fault.code, fault.column) == ("MC108", 7)


def test_several_axis_commands_of_a_line_come_in_reading_order() -> None:
    values = Program().run("G1000 P1 G1010 P2, G1011 P3")
    assert [(value.operation, value.axes) for value in values if isinstance(value, AxisLine)] == [
        (AxisOperation.RESET, (1,)),
        (AxisOperation.CAPTURE, (2,)),
        (AxisOperation.RELEASE, (3,)),
    ]


def test_no_line_needs_the_encoder_before_an_axis_command() -> None:
    assert need(feeding(), "G91 G01 X1") == set()


def test_a_tool_whose_number_cannot_be_read_is_left_to_the_interpreter() -> None:
    program = feeding("G1010")
    assert need(program, "G01 T1e9 X5") == {0}
    assert program.faults("T1e9 X5")


@pytest.mark.parametrize("command", ["G1010", "G1010 P0", "G1030 X5", "G1040 X5", "G1001", "G1011 P0"])
def test_after_capture_speed_and_torque_the_encoder_gives_start_and_base(command: str) -> None:
    program = feeding("G01 X10", command)
    assert need(program, "G01 X20") == {0}
    assert need(program, "G91 G00 X20") == {0}
    assert need(program, "G00 X20") == set()
    assert need(program, "G1020 U1") == {0}
    program.interpreter.sync_positions({0: 0.002})
    assert need(program, "G01 X20") == set()
    curve = program.straight("G91 G01 X1")
    assert (curve.start, curve.end) == (pytest.approx((0.002,)), pytest.approx((0.003,)))


def test_after_a_servo_move_the_path_starts_at_the_stop_but_increments_at_the_commanded_end() -> None:
    program = feeding("G1020 X100")
    assert need(program, "G01 U10") == {0}
    assert need(program, "G91 G00 X10") == set()
    assert need(program, "G01 Y5") == set()
    program.interpreter.sync_positions({0: 0.04})
    group = program.feed("G01 U10")
    (curve,) = group.curves
    assert curve.start == pytest.approx((0.04,))  # type: ignore[attr-defined]
    assert curve.end == pytest.approx((0.11,))  # type: ignore[attr-defined]
    assert group.requested == pytest.approx(0.7)


def test_an_arc_after_a_servo_move_starts_where_the_axis_was_stopped() -> None:
    program = feeding("G1020 X100")
    assert need(program, "G02 Y10 I10 J0") == {0}
    program.interpreter.sync_positions({0: 0.04})
    arc = program.arc("G02 X60 Y0 I10 J0")
    assert arc.centre == pytest.approx((0.05, 0.0))


def test_a_later_move_settles_the_axis_again() -> None:
    program = feeding("G1020 X100 Y100", "G00 X0")
    assert need(program, "G01 X5 Y5") == {1}
    program.interpreter.sync_positions({1: 0.05})
    program.run("G01 X5 Y5")
    assert need(program, "G01 X5 Y5") == set()
    assert program.straight("G01 Y10").start == pytest.approx((0.005,))


def test_without_observation_the_commanded_ends_are_assumed() -> None:
    program = feeding("G01 X10", "G1010")
    assert program.straight("G01 U5").end == pytest.approx((0.015,))


def test_a_repeated_motion_needs_the_encoder_too() -> None:
    program = feeding("G01 X10", "G1010")
    assert need(program, "X20 Y5") == {0, 1}
    program.run("G00 Z1")
    assert need(program, "X20") == set()


def test_a_tool_needs_the_encoder_of_its_whole_chain() -> None:
    program = Program(TOOLED, Gantries(TOOLED))
    program.run("F6000", "G1010")
    assert need(program, "G01 T3 X5") == {0, 1, 2}
    assert need(program, "T3 G00 X5") == {0, 1, 2}
    assert need(program, "T3 G1050 G01 [3]5") == {3}


def test_a_tools_pose_is_read_again_where_the_capture_found_its_joints() -> None:
    program = Program(TOOLED, Gantries(TOOLED))
    program.run("F6000", "G01 T3 X5", "G1010")
    program.interpreter.sync_positions({0: 0.001, 1: 0.002, 2: 0.003})
    program.run("G01 U1")
    assert [program.mm(axis) for axis in range(3)] == [2.0, 2.0, 3.0]


def test_a_tools_path_starts_where_a_servo_move_of_its_joint_was_stopped() -> None:
    kinematics = Gantries(TOOLED)
    program = Program(TOOLED, kinematics)
    program.run("F6000", "G1020 X100", "T3")
    assert need(program, "G00 X5") == set()
    program.interpreter.sync_positions({0: 0.05})
    line = program.motion("G01 U10")
    assert isinstance(line, MotionLine)
    assert line.feed_length == pytest.approx(0.06)
    assert kinematics.solved[-1][2][0] == 0.05
    assert program.mm(0) == 110.0


def test_encoder_axes_are_none_after_the_end() -> None:
    program = feeding("G1010", "M30")
    assert need(program, "G01 X1") == set()


def coupling() -> Program:
    """A machine whose axis 3 can follow axis 0."""
    axes = [
        msgspec.structs.replace(axis, follow=Follow(0, 1e-3, 2.0, (), repeats=False, measured=False))
        if axis.index == 3
        else axis
        for axis in TOOLED.axes
    ]
    return Program(msgspec.structs.replace(TOOLED, axes=tuple(axes), tools=(), urdf=None))


def test_a_coupled_axis_is_moved_by_nothing_else_until_it_is_uncoupled() -> None:
    program = coupling()
    assert program.run("G1060 P3") == [AxisLine(1, AxisOperation.COUPLE, (3,))]
    for text in ("G00 [3]5", "G01 X5 F100 G01 [3]5", "G1020 [3]5", "G1030 [3]60", "G02 X5 Y0 R5 [3]1"):
        assert [(fault.code, fault.axis) for fault in program.faults(text)] == [("MC345", 3)]
    assert [fault.code for fault in program.faults("G1060 P3")] == ["MC346"]
    # what leads it, and others, go on
    assert program.run("G01 X5 Y5 F600")
    assert program.run("G1010") == [AxisLine(program.line, AxisOperation.CAPTURE, (0, 1, 2))]
    assert program.run("G1061") == [AxisLine(program.line, AxisOperation.UNCOUPLE, (3,))]
    assert program.run("G1061") == []
    # where it has been led to is the encoder's, as behind a capture
    assert need(program, "G91 G00 [3]5") == {3}
    program.run("G1060 P3")
    program.run("G1001 P3")
    assert not program.interpreter.modal.coupled


@pytest.mark.parametrize(("text", "code"), [("G1060", "MC118"), ("G1060 P1", "MC346"), ("G1060 P9", "MC108")])
def test_only_an_axis_with_a_leader_is_coupled(text: str, code: str) -> None:
    assert [fault.code for fault in coupling().faults(text)] == [code]


def test_a_program_does_not_start_where_an_axis_follows_another_one() -> None:
    machine = coupling().interpreter._setup.machine
    lines = ["G1010", "G1060 P3", "G00 X5", "G1061", "G00 X0"]
    with pytest.raises(ProgramRejected) as caught:
        state_before(lines, 3, machine, StartState.of(machine))
    assert [fault.code for fault in caught.value.diagnostics] == ["MC347"]
    assert state_before(lines, 5, machine, StartState.of(machine)).unknown == {3}
