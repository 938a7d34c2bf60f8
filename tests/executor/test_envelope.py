"""An approved run stays within its envelope, whatever its planner puts: on the virtual clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from mcserver.executor.entries import Array, Control, ControlKind, EventKind, ExecutorEvent
from mcserver.executor.envelope_bounds import Envelope, enforced
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.shm.rings import ProgramRing
from mcserver.machine.machine_file import Machine, load_machine, parse_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.motion.kernels.envelope import tip_positions
from mcserver.motion.pieces import Rows
from mcserver.planning.start_state import StartState
from mcserver.simulation.preview import preview
from tests.executor.planned import Planned
from tests.limits import assert_keeps
from tests.machine_text import axes_text

VELOCITY, ACCELERATION, JERK = 0.1, 1.0, 20.0
SOFT = "max_jerk = 20000.0"


def machine() -> Machine:
    """Axes 0 and 1 in mm, axis 2 turns endlessly."""
    axes = axes_text(range(2), velocity=100.0, acceleration=1000.0, keys=SOFT)
    axes += axes_text([2], rotary=True, velocity=360.0, acceleration=3600.0, keys="max_jerk = 72000.0")
    return parse_machine(f'[machine]\nname = "bench"\n{axes}')


BOX = Envelope(low=(-0.001, -0.001, -1e-9), high=(0.060, 0.060, 1e-9), speed=(0.1, 0.1, 7.0), seconds=60.0)


class Run(Planned):
    """A text, planned without a word about the envelope: as by a planner that has gone wrong."""

    def __init__(
        self,
        text: str,
        envelope: Envelope | None = BOX,
        override: float = 1.0,
        *,
        made: Machine | None = None,
        **planned: Any,
    ) -> None:
        super().__init__(made or machine(), text, envelope=envelope, override=override, **planned)

    def play(self, orders: dict[int, Callable[[], None]] | None = None, cycles: int = 20_000) -> Run:
        """Play until the program has ended and everything stands."""
        for cycle in range(cycles):
            if orders and cycle in orders:
                orders[cycle]()
            self.step()
            if self.ended and self.executor.at_rest:
                break
        return self

    @property
    def fault(self) -> ExecutorEvent:
        (found,) = self.of(EventKind.FAULT)
        return found

    def setpoints(self, axis: int = 0) -> Array:
        return np.array(self.rows)[:, axis]


def assert_within_limits(setpoint: Array) -> None:
    """Speed, acceleration and jerk of an axis in mm, to its end, at rest."""
    assert_keeps(setpoint, (VELOCITY, ACCELERATION, JERK))
    assert abs(setpoint[-1] - setpoint[-2]) <= 1e-8


@pytest.mark.parametrize(
    "text", ["G01 X200", "G01 X59\nG01 X200 Y20", "G00 X200", "G1020 X200", "G02 X0 Y0 I35 J5"]
)
def test_a_run_beyond_its_extents_is_stopped_before_it_leaves_and_within_limits(text: str) -> None:
    run = Run(f"G1010\nG94 F6000\n{text}\nG01 X0 Y0").play()
    assert run.fault.code == FaultCode.ENVELOPE_POSITION
    assert run.fault.axis == 0
    assert run.events[-1].kind is EventKind.STOPPED
    for axis in (0, 1):
        assert run.setpoints(axis).max() <= 0.060 + 1e-9
        assert run.setpoints(axis).min() >= -0.001 - 1e-9
        assert_within_limits(run.setpoints(axis))


def test_what_stays_inside_ends_as_without_an_envelope() -> None:
    text = "G1010\nG94 F6000\nG01 X10 Y5\nG00 X0\nG1020 Y0\nG02 X5 Y5 R5\nG04 P0.1\nG01 X0 Y0"
    free, held = Run(text, None).play(), Run(text).play()
    assert held.faults == []
    assert np.array_equal(free.setpoints(), held.setpoints())
    assert np.array_equal(free.setpoints(1), held.setpoints(1))


@pytest.mark.parametrize("override", [0.2, 0.37, 1.0, 1.63, 2.0])
def test_at_every_override_the_extents_hold(override: float) -> None:
    envelope = msgspec.structs.replace(BOX, override=override)
    text = "G1010\nG94 F3000\nG01 X55 Y1\nG01 X40 Y3\nG01 X90 Y30"
    run = Run(text, envelope, override).play(cycles=80_000)
    assert run.fault.code == FaultCode.ENVELOPE_POSITION
    assert 0.05 <= run.setpoints().max() <= 0.060 + 1e-9
    assert_within_limits(run.setpoints())


def test_holds_overrides_and_resumes_on_the_way_do_not_open_the_envelope() -> None:
    run = Run("G1010\nG94 F3000\nG01 X50\nG01 X2\nG01 X50 Y2\nG01 X95 Y9")
    mailbox = run.executor.mailbox
    orders: dict[int, Callable[[], None]] = {}
    for at in range(100, 2000, 90):
        orders[at] = lambda: mailbox.set_hold(True, 0)
        orders[at + 30] = lambda: mailbox.resume(0)
        orders[at + 50] = lambda ratio=(at % 19) / 19.0: mailbox.set_override(max(0.05, ratio), 0)
    run.play(orders)
    assert run.fault.code == FaultCode.ENVELOPE_POSITION
    assert run.setpoints().max() <= 0.060 + 1e-9
    assert_within_limits(run.setpoints())


def test_a_faster_run_than_was_shown_is_refused_before_it_is_fast() -> None:
    slow = msgspec.structs.replace(BOX, speed=(0.02, 0.02, 0.0))
    run = Run("G1010\nG94 F600\nG01 X5\nG94 F6000\nG01 X0", slow).play()
    assert run.fault.code == FaultCode.ENVELOPE_SPEED
    assert run.fault.axis == 0
    assert np.abs(np.diff(run.setpoints())).max() / 1e-3 <= 0.02 + 1e-9
    assert_within_limits(run.setpoints())


def test_an_override_above_the_one_allowed_is_a_fault() -> None:
    # whoever asks the executor, past the server's own limit
    slow = msgspec.structs.replace(BOX, speed=(0.02, 0.02, 0.0), override=0.5)
    run = Run("G1010\nG94 F1200\nG01 X9", slow, 0.5)
    run.play({400: lambda: run.executor.mailbox.set_override(1.0, 0)})
    assert run.fault.code == FaultCode.ENVELOPE_SPEED
    # one cycle after the bound was passed it brakes, by what jerk allows
    assert np.abs(np.diff(run.setpoints())).max() / 1e-3 <= 0.012
    assert_within_limits(run.setpoints())


def test_longer_than_was_shown_is_a_fault_and_holds_do_not_count() -> None:
    short = msgspec.structs.replace(BOX, seconds=1.0)
    text = "G1010\nG94 F6000\nG01 X5\nG04 P0.5\nG01 X0"
    run = Run(text, short)
    mailbox = run.executor.mailbox
    run.play({50: lambda: mailbox.set_hold(True, 0), 3000: lambda: mailbox.resume(0)})
    assert run.events[-1].kind is EventKind.FINISHED
    late = Run("G1010\nG94 F6000\nG01 X5\nG04 P5\nG01 X0", short).play()
    assert late.fault.code == FaultCode.ENVELOPE_TIME
    assert len(late.rows) == pytest.approx(1000, abs=20)


@pytest.mark.parametrize(
    ("control", "code"),
    [
        (Control(ControlKind.TORQUE, 0.0, 1, 1, (0.1, 0.0, 0.0)), FaultCode.ENVELOPE_COMMAND),
        (Control(ControlKind.SPEED, 0.0, 1, 1, (0.01, 0.0, 0.0)), FaultCode.ENVELOPE_COMMAND),
        (Control(ControlKind.HOME, 0.0, 1, 1), FaultCode.ENVELOPE_COMMAND),
        (Control(ControlKind.REFERENCE, 0.0, 1, 1, (0.5, 0.0, 0.0)), FaultCode.ENVELOPE_COMMAND),
        (Control(ControlKind.SPEED, 0.0, 1, 4, (0.0, 0.0, 7.1)), FaultCode.ENVELOPE_SPEED),
        (Control(ControlKind.RAPID, 0.0, 1, 1, (float("nan"), 0.0, 0.0)), FaultCode.ENVELOPE_POSITION),
    ],
)
def test_commands_that_an_approval_cannot_bound_are_refused(control: Control, code: FaultCode) -> None:
    run = Run("", msgspec.structs.replace(BOX, turning=4))
    assert isinstance(run.sink, ProgramRing)
    run.sink.put_control(control)
    run.play(cycles=50)
    assert run.fault.code == code
    assert np.array(run.rows).min() == np.array(run.rows).max() == 0.0


def test_an_axis_that_may_turn_turns_on_at_its_speed() -> None:
    turning = Envelope((-0.001, -0.001, -np.inf), (0.01, 0.01, np.inf), (0.1, 0.1, 7.0), 60.0, turning=4)
    run = Run("G1010\nG94 F600\nG1030 [2]60\nG01 X5\nG1030 [2]0\nG01 X0", turning).play()
    assert [each for each in run.events if each.kind is EventKind.FAULT] == []
    assert run.setpoints(2).max() > 1.0


def test_a_superseding_rapid_that_swings_over_its_target_stays_inside() -> None:
    # on its way to the bound, and back to a place that it has all but passed
    text = "G1010\nG1020 X60\nG04 P0.58\nG1020 X55\nG04 P1"
    run = Run(text).play()
    assert run.setpoints().max() <= 0.060 + 1e-9
    assert_within_limits(run.setpoints())


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1e6, 0.0601])
def test_rows_of_a_planner_that_has_gone_wrong_do_not_go_out(wrong: float) -> None:
    run = Run("G1010\nG94 F3000\nG01 X50\nG01 X5")
    put_rows = run.sink.put_rows

    def patched(rows: Rows) -> None:
        position = rows.position.copy()
        beyond = np.arange(rows.first, rows.first + len(rows)) >= 700
        position[beyond, 0] = wrong
        put_rows(replace(rows, position=position))

    run.sink.put_rows = patched  # type: ignore[method-assign]
    run.play()
    assert run.fault.code == FaultCode.ENVELOPE_POSITION
    assert run.setpoints().max() <= 0.060 + 1e-9
    assert_within_limits(run.setpoints())


def test_an_end_of_rows_that_leaves_the_axes_elsewhere_is_refused() -> None:
    run = Run("G1010\nG94 F3000\nG01 X5\nG04 P0.1")
    put_control = run.sink.put_control

    def patched(control: Control, rows: int = 0) -> None:
        if control.kind is ControlKind.END:
            control = msgspec.structs.replace(control, values=(0.5, 0.0, 0.0))
        put_control(control, rows)

    run.sink.put_control = patched  # type: ignore[method-assign]
    run.play(cycles=2000)
    assert run.fault.code == FaultCode.ENVELOPE_POSITION
    assert run.setpoints().max() <= 0.060


def test_without_an_envelope_nothing_is_looked_at() -> None:
    run = Run("G1010\nG94 F6000\nG01 X200", None).play()
    assert run.setpoints().max() == pytest.approx(0.2)


def arm_run(text: str, envelope: Envelope | None) -> Run:
    """As `Run`, on the built-in arm, energized where it stands."""
    arm = load_machine("arm6")
    return Run(text, envelope, made=arm, kinematics=build_kinematics(arm))


def test_a_tool_s_tip_stays_in_its_box_though_every_joint_stays_in_its_own() -> None:
    arm = load_machine("arm6")
    text = "G1010\nG94 F600\nT1 G91 G01 Z20\nG01 Z-20"
    seen = preview(text, arm, StartState.of(arm), tuple(axis.index for axis in arm.axes))
    assert seen.envelope is not None, seen.report["diagnostics"]
    (tip,) = seen.envelope.tips
    # the joints may go anywhere; the tip may not
    wide = [10.0] * len(arm.axes)
    free = msgspec.structs.replace(
        seen.envelope, low=tuple(-each for each in wide), high=tuple(wide), speed=tuple(wide)
    )
    allowed = enforced(free, arm, 1.0, [0.0] * len(arm.axes))
    inside = arm_run(text, allowed).play()
    assert inside.faults == []
    further = arm_run(text.replace("Z20\n", "Z60\n"), allowed).play()
    assert further.fault.code == FaultCode.ENVELOPE_TIP
    assert further.fault.values[1] == 1.0
    chain = build_kinematics(arm).tool(1).chain
    tips = chain.forward(np.array(further.rows))[0]
    assert tips[:, 2].max() <= allowed.tips[0].high[2] + 1e-9
    assert tip.low[2] + 0.01 < tips[:, 2].max() <= tip.high[2] + 0.001


def test_the_tip_is_where_the_kinematics_have_it() -> None:
    for name in ("arm6", "robot-dog"):
        kinematics = build_kinematics(load_machine(name))
        assert kinematics is not None
        for tool in kinematics.tools:
            chain = kinematics.tool(tool).chain
            joints = np.random.default_rng(tool).uniform(-2.0, 2.0, (50, chain.size))
            steps, turning = np.ascontiguousarray(chain.steps[:, :3]), np.array(chain.revolute)
            assert tip_positions(steps, turning, joints) == pytest.approx(chain.forward(joints)[0], abs=1e-12)


PROBING = """
[dialect]
profile = "cnc"
capture = "auto"
[[input]]
number = 0
name = "probe"
[probe]
input = 0
"""


def test_a_probe_that_meets_nothing_comes_to_rest_at_the_bound() -> None:
    axes = axes_text(range(3), velocity=100.0, acceleration=1000.0, keys=SOFT)
    made = parse_machine(f'[machine]\nname = "bench"\n{axes}{PROBING}')
    low = (-0.001, -0.001, -0.02)
    box = Envelope(low, (0.01, 0.01, 0.001), (0.1, 0.1, 0.1), 60.0)
    # a real machine: contact does not come by itself at the end of the move, as in a simulation
    run = Run("G38.2 Z-50 F3000", box, made=made, homed=False).play()
    assert run.fault.code == FaultCode.ENVELOPE_POSITION
    assert run.fault.axis == 2
    assert -0.020 - 1e-9 <= run.setpoints(2).min() <= -0.019
    assert_within_limits(run.setpoints(2))


def test_comma_groups_are_held_axis_by_axis() -> None:
    run = Run("G1010\nG94 F3000\nG01 X30, G01 Y20\nG01 X55, G01 Y90").play()
    assert run.fault.code == FaultCode.ENVELOPE_POSITION
    assert run.fault.axis == 1
    for axis in (0, 1):
        assert run.setpoints(axis).max() <= 0.060 + 1e-9
        assert_within_limits(run.setpoints(axis))


def test_a_simulation_begins_energized_where_the_machine_is() -> None:
    for kind in ("ideal", "simulated"):
        axis = axes_text(velocity=100.0, acceleration=1000.0, keys=SOFT, drive=kind)
        made = parse_machine(f'[machine]\nname = "bench"\n{axis}')
        start = msgspec.structs.replace(StartState.of(made), energized=frozenset({0})).at({0: 0.05})
        # without G1010: the axis holds already
        seen = preview("G94 F6000\nG01 X60", made, start, (0,))
        assert seen.report["ok"], seen.report["diagnostics"]
        assert seen.envelope is not None
        assert (seen.envelope.low[0], seen.envelope.high[0]) == pytest.approx((0.05, 0.06))
        assert seen.effects == ()
        cold = preview("G94 F6000\nG01 X60", made, StartState.of(made), (0,))
        assert cold.report["diagnostics"][0]["code"] == "MC401"
