"""Inputs and outputs in the cycle: set in step with motion, waited for, interlocks, safe values."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.executor.entries import ControlKind, EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.io_bank import NOBODY, OPERATOR
from mcserver.executor.shm.feedback import SlotState
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.motion.canonical import WaitMode
from tests.executor.rig import CYCLE_S, Rig
from tests.machine_text import axes_text

LAMP = '[[output]]\nnumber = 0\nname = "lamp"\n'
VALVE = '[[output]]\nnumber = 1\nname = "valve"\nsafe = "keep"\n'
BUTTON = '[[input]]\nnumber = 0\nname = "button"\n'
DOOR = '[[input]]\nnumber = 1\nname = "door"\nhold_on = true\n'
GUARD = '[[input]]\nnumber = 2\nname = "guard"\nstop_on = false\ninitial = true\n'


def machine(*sections: str, drive: str = "ideal") -> Machine:
    axis = axes_text(velocity=1000.0, acceleration=10000.0, drive=drive)
    return parse_machine(f'[machine]\nname = "rig"\n{axis}{"".join(sections)}')


class IoRig(Rig):
    """A rig that keeps inputs and outputs of every cycle."""

    def __post_init__(self) -> None:
        self.inputs: list[list[float]] = []
        self.outputs: list[list[float]] = []
        super().__post_init__()

    def step(self, cycles: int = 1) -> None:
        for _ in range(cycles):
            super().step()
            row = self.executor.executor.row
            self.inputs.append(row.inputs.tolist())
            self.outputs.append(row.outputs.tolist())

    def set_input(self, column: int, value: float) -> None:
        self.executor.mailbox.set_input(column, value)

    @property
    def state(self) -> SlotState:
        return self.executor.feedback.slots[0].state

    def codes(self, slot: int | None = None) -> list[int]:
        return [e.code for e in self.of(EventKind.FAULT) if slot is None or e.program == slot]

    def captured(self) -> IoRig:
        self.program.capture()
        return self


def test_outputs_start_at_their_initial_values_before_any_program() -> None:
    rig = IoRig(machine(LAMP + "initial = true\n", VALVE))
    rig.step()
    assert rig.outputs == [[1.0, 0.0]]
    assert rig.executor.feedback.owners.tolist() == [NOBODY, NOBODY]


@pytest.mark.parametrize("drive", ["ideal", "simulated"])
def test_an_output_changes_in_the_cycle_in_which_its_place_is_passed(drive: str) -> None:
    rig = IoRig(machine(LAMP, drive=drive)).captured()
    program = rig.program
    program.move({0: 0.01}, 50)
    program.start_line(2)
    program.control(ControlKind.OUTPUT, channel=0, value=1.0)
    program.move({0: 0.02}, 50)
    rig.play(line=True)
    changed = [outputs[0] for outputs in rig.outputs].index(1.0)
    assert changed == round(rig.time_of(EventKind.LINE_START, 2) / CYCLE_S)


def test_an_output_between_two_cycles_changes_in_the_cycle_that_ends_behind_it() -> None:
    rig = IoRig(machine(LAMP)).captured()
    rig.program.u = 10.25
    rig.program.control(ControlKind.OUTPUT, channel=0, value=1.0)
    rig.program.u = 20.0
    rig.play()
    assert [outputs[0] for outputs in rig.outputs].index(1.0) == 11


def test_a_feed_hold_holds_outputs_too() -> None:
    rig = IoRig(machine(LAMP)).captured()
    program = rig.program
    program.move({0: 0.1}, 200)
    program.control(ControlKind.OUTPUT, channel=0, value=1.0)
    program.move({0: 0.2}, 200)
    program.finish()
    rig.step(50)
    rig.executor.mailbox.set_hold(True, 0)
    rig.step(1000)
    assert rig.state is SlotState.HELD
    assert rig.outputs[-1] == [0.0]
    rig.executor.mailbox.resume(0)
    rig.run()
    assert rig.outputs[-1] == [1.0]


def test_outputs_stay_behind_the_end_of_a_program() -> None:
    rig = IoRig(machine(LAMP))
    rig.program.control(ControlKind.OUTPUT, channel=0, value=1.0)
    rig.play()
    rig.step(5)
    assert rig.outputs[-1] == [1.0]
    assert rig.executor.feedback.owners.tolist() == [NOBODY]


@pytest.mark.parametrize("how", ["abort", "emergency_stop", "stop"])
def test_an_aborted_programs_outputs_are_safe_in_the_cycle_of_the_order(how: str) -> None:
    rig = IoRig(machine(LAMP, VALVE)).captured()
    program = rig.program
    for channel in (0, 1):
        program.control(ControlKind.OUTPUT, channel=channel, value=1.0)
    program.move({0: 0.1}, 200)
    program.control(ControlKind.OUTPUT, channel=0, value=1.0)
    program.finish()
    rig.step(100)
    assert rig.outputs[-1] == [1.0, 1.0]
    order = getattr(rig.executor.mailbox, how)
    order(0) if how == "abort" else order()
    rig.step()
    assert rig.outputs[-1] == [0.0, 1.0], "the lamp is off, the valve keeps its value"
    rig.step(500)
    assert rig.outputs[-1] == [0.0, 1.0], "nothing of the program is carried out any more"


def test_outputs_are_safe_in_the_cycle_behind_the_loss_of_the_server() -> None:
    rig = IoRig(machine(LAMP, VALVE, '[[output]]\nnumber = 2\nname = "fan"\n')).captured()
    rig.program.control(ControlKind.OUTPUT, channel=0, value=1.0)
    rig.executor.mailbox.set_output(1, 1.0)
    rig.executor.mailbox.set_output(2, 1.0)
    rig.program.dwell(10.0)
    rig.step(20)
    assert rig.outputs[-1] == [1.0, 1.0, 1.0]
    rig.executor.executor.stop_all(FaultCode.SERVER_LOST)
    rig.step()
    assert rig.outputs[-1] == [0.0, 1.0, 0.0], "those of operators too"


def test_a_program_that_a_faulty_line_has_ended_leaves_its_outputs_safe() -> None:
    rig = IoRig(machine(LAMP))
    rig.program.control(ControlKind.OUTPUT, channel=0, value=1.0)
    rig.program.dwell(0.01)
    rig.program.control(ControlKind.FINISH, operation=1)
    rig.run()
    assert rig.outputs[-1] == [0.0]


def test_an_abort_leaves_outputs_of_others_alone() -> None:
    rig = IoRig(machine(LAMP, '[[output]]\nnumber = 1\nname = "fan"\n')).captured()
    rig.executor.mailbox.set_output(1, 1.0)
    rig.program.control(ControlKind.OUTPUT, channel=0, value=1.0)
    rig.program.dwell(1.0)
    rig.step(20)
    assert rig.executor.feedback.owners.tolist() == [0, OPERATOR]
    rig.executor.mailbox.abort(0)
    rig.step(2)
    assert rig.outputs[-1] == [0.0, 1.0]


def test_nothing_sets_an_output_while_the_emergency_stop_is_latched() -> None:
    rig = IoRig(machine(LAMP))
    rig.executor.mailbox.emergency_stop()
    rig.step(2)
    rig.executor.mailbox.set_output(0, 1.0)
    rig.program.control(ControlKind.OUTPUT, channel=0, value=1.0)
    rig.program.finish()
    rig.step(5)
    assert rig.outputs[-1] == [0.0]
    assert FaultCode.EMERGENCY_STOP in rig.codes(0)
    rig.executor.mailbox.reset()
    rig.step(2)
    rig.executor.mailbox.set_output(0, 1.0)
    rig.step()
    assert rig.outputs[-1] == [1.0]


def test_values_from_outside_that_no_output_can_have_are_dropped() -> None:
    rig = IoRig(machine('[[output]]\nnumber = 0\nname = "laser"\nkind = "analog"\nmax = 10.0\n'))
    for value in (-1.0, 10.1, float("nan"), float("inf")):
        rig.executor.mailbox.set_output(0, value)
        rig.step()
        assert rig.outputs[-1] == [0.0]
    rig.executor.mailbox.set_output(0, 10.0)
    rig.step()
    assert rig.outputs[-1] == [10.0]


# ---------------------------------------------------------------- inputs


def test_a_script_sets_a_simulated_input_in_the_first_cycle_that_is_not_earlier() -> None:
    script = "simulated = [{ at_s = 0.0105, value = true }, { at_s = 0.02, value = false }]\n"
    rig = IoRig(machine(BUTTON + script))
    rig.step(30)
    on = [cycle for cycle, inputs in enumerate(rig.inputs) if inputs[0]]
    assert on == list(range(11, 20))


def test_a_value_from_outside_ends_an_inputs_script() -> None:
    rig = IoRig(machine(BUTTON + "simulated = [{ at_s = 0.02, value = false }]\n"))
    rig.set_input(0, 1.0)
    rig.step(30)
    assert rig.inputs[-1] == [1.0]


@pytest.mark.parametrize(("cycles", "seen"), [(4, False), (5, True)])
def test_a_digital_input_has_to_last_its_debounce_time(cycles: int, seen: bool) -> None:
    rig = IoRig(machine(BUTTON + "debounce_ms = 4\n"))
    rig.set_input(0, 1.0)
    rig.step(cycles)
    rig.set_input(0, 0.0)
    rig.step(20)
    assert any(inputs[0] for inputs in rig.inputs) is seen


def test_a_bouncing_contact_starts_its_debounce_time_anew() -> None:
    rig = IoRig(machine(BUTTON + "debounce_ms = 4\n"))
    for _ in range(10):
        rig.set_input(0, 1.0)
        rig.step(2)
        rig.set_input(0, 0.0)
        rig.step(1)
    assert not any(inputs[0] for inputs in rig.inputs)


def wait_for(rig: IoRig, mode: WaitMode, seconds: float) -> None:
    rig.program.line = 7
    rig.program.control(ControlKind.INPUT, channel=0, operation=mode, seconds=seconds)
    rig.program.start_line(8)
    rig.program.finish()


@pytest.mark.parametrize(
    ("mode", "values", "passed"),
    [
        (WaitMode.HIGH, (1, 1, 1), 0),
        (WaitMode.HIGH, (0, 0, 1), 2),
        (WaitMode.LOW, (1, 1, 0), 2),
        (WaitMode.RISE, (1, 0, 1), 2),
        (WaitMode.FALL, (0, 1, 0), 2),
        (WaitMode.IMMEDIATE, (0, 0, 0), 0),
    ],
)
def test_m66_passes_in_the_cycle_in_which_the_input_is_as_asked(
    mode: WaitMode, values: tuple[int, ...], passed: int
) -> None:
    rig = IoRig(machine(BUTTON))
    rig.set_input(0, values[0])
    rig.step(3)
    wait_for(rig, mode, 1.0)
    begin = len(rig.inputs)
    rig.step(5)
    for value in values[1:]:
        rig.set_input(0, value)
        rig.step(5)
    (read,) = rig.of(EventKind.INPUT)
    assert read.line == 7
    assert read.token == 0
    cycle = round(read.time / CYCLE_S)
    assert (cycle - begin) // 5 == passed
    assert rig.time_of(EventKind.LINE_START, 8) == pytest.approx(read.time)
    assert rig.state is SlotState.FINISHED


def test_m66_that_waits_in_vain_is_a_fault_that_names_the_input() -> None:
    rig = IoRig(machine(BUTTON, LAMP))
    rig.program.control(ControlKind.OUTPUT, channel=0, value=1.0)
    wait_for(rig, WaitMode.HIGH, 0.05)
    rig.step(60)
    (fault,) = rig.of(EventKind.FAULT)
    assert fault.code == FaultCode.INPUT_TIMEOUT
    assert fault.line == 7
    assert fault.values == (0.0, 0.05)
    assert round(fault.time / CYCLE_S) == 50
    assert rig.state is SlotState.FAULTED
    assert rig.outputs[-1] == [0.0]


def test_the_time_out_of_m66_does_not_pass_in_feed_hold() -> None:
    rig = IoRig(machine(BUTTON))
    wait_for(rig, WaitMode.HIGH, 0.05)
    rig.step(20)
    rig.executor.mailbox.set_hold(True, 0)
    rig.step(500)
    assert rig.codes() == []
    rig.executor.mailbox.resume(0)
    rig.step(40)
    assert rig.codes() == [FaultCode.INPUT_TIMEOUT]


# ---------------------------------------------------------------- interlocks


def moving(rig: IoRig) -> None:
    rig.program.capture()
    rig.program.move({0: 0.5}, 1000)
    rig.program.finish()
    rig.step(200)


def test_an_input_holds_programs_in_the_cycle_behind_its_reading() -> None:
    rig = IoRig(machine(DOOR))
    moving(rig)
    rig.set_input(0, 1.0)
    rig.step(2)
    velocity = np.diff(rig.setpoint[:, 0])
    assert velocity[-1] < velocity[-2], "the cycle after the reading brakes"
    assert rig.codes() == [FaultCode.INTERLOCK_HOLD]
    rig.step(500)
    assert rig.state is SlotState.HELD
    assert rig.executor.feedback.interlocked


def test_a_door_that_closes_does_not_start_the_machine() -> None:
    rig = IoRig(machine(DOOR))
    moving(rig)
    rig.set_input(0, 1.0)
    rig.step(500)
    rig.executor.mailbox.resume(0)
    rig.step(100)
    assert rig.state is SlotState.HELD, "a resume while the door is open does nothing"
    rig.set_input(0, 0.0)
    rig.step(100)
    assert rig.state is SlotState.HELD, "nor does the door that closes, even after that resume"
    assert rig.codes() == [FaultCode.INTERLOCK_HOLD, FaultCode.INTERLOCK_FREE]
    rig.executor.mailbox.resume(0)
    rig.run()
    assert rig.state is SlotState.FINISHED
    assert rig.setpoint[-1, 0] == pytest.approx(0.5)


def test_a_program_that_is_opened_with_the_door_open_stands_until_it_is_resumed() -> None:
    rig = IoRig(machine(DOOR + "initial = true\n"))
    rig.step()
    moving(rig)
    assert rig.state is SlotState.HELD
    assert not rig.setpoint.any()
    rig.set_input(0, 0.0)
    rig.step(50)
    assert not rig.setpoint.any()
    rig.executor.mailbox.resume(0)
    rig.run()
    assert rig.setpoint[-1, 0] == pytest.approx(0.5)


def test_resuming_one_program_leaves_the_others_held() -> None:
    rig = IoRig(machine(DOOR, axes_text([1])))
    rig.executor.mailbox.abort(0)
    rig.step(20)
    first = rig.open(1, 1)
    first.dwell(0.2)
    first.finish()
    other = rig.open(2, 2)
    other.dwell(0.2)
    other.finish()
    rig.step(20)
    rig.set_input(0, 1.0)
    rig.step(20)
    rig.set_input(0, 0.0)
    rig.step(20)
    rig.executor.mailbox.resume(1)
    rig.step(400)
    states = [slot.state for slot in rig.executor.feedback.slots]
    assert states[1] is SlotState.FINISHED
    assert states[2] is SlotState.HELD


def test_a_stop_input_stops_like_an_emergency_stop_and_names_itself() -> None:
    rig = IoRig(machine(GUARD, LAMP))
    rig.program.control(ControlKind.OUTPUT, channel=0, value=1.0)
    moving(rig)
    rig.set_input(0, 0.0)
    rig.step(2)
    faults = rig.of(EventKind.FAULT)
    assert {fault.code for fault in faults} == {FaultCode.INTERLOCK_STOP}
    assert [fault.program for fault in faults] == [-1, 0]
    assert all(fault.values == (0.0, 0.0) for fault in faults)
    assert rig.outputs[-1] == [0.0]
    rig.step(500)
    assert rig.state is SlotState.FAULTED
    assert rig.executor.feedback.estop
    rig.executor.mailbox.reset()
    rig.step(10)
    assert rig.executor.feedback.estop, "what has stopped it is still there"
    rig.set_input(0, 1.0)
    rig.step(10)
    assert rig.executor.feedback.estop, "a reset that came before does not count"
    rig.executor.mailbox.reset()
    rig.step(10)
    assert not rig.executor.feedback.estop


def test_an_analog_input_stops_below_its_threshold() -> None:
    air = '[[input]]\nnumber = 0\nname = "air"\nkind = "analog"\nunit = "bar"\ninitial = 6.0\n'
    air += "stop_below = 4.0\n"
    rig = IoRig(machine(air))
    rig.step(5)
    rig.set_input(0, 4.0)
    rig.step(5)
    assert not rig.executor.feedback.estop
    rig.set_input(0, 3.9)
    rig.step(1)
    assert rig.executor.feedback.estop


def test_what_moves_by_itself_behind_its_programs_end_stops_for_the_door() -> None:
    rig = IoRig(machine(DOOR))
    rig.program.rapid({0: 1.0})
    rig.program.finish()
    rig.step(100)
    assert rig.state is SlotState.FINISHED
    rig.set_input(0, 1.0)
    rig.step(500)
    stood = rig.setpoint[-1, 0]
    assert 0.0 < stood < 1.0
    rig.set_input(0, 0.0)
    rig.step(500)
    assert rig.setpoint[-1, 0] == stood
