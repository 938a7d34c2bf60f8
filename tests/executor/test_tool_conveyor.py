"""Arms that go along with a conveyor: the tip on a piece that moves, whatever moves the joints (D-145)."""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mckinematics.beside import places_beside

from mcserver.errors import ConfigurationError
from mcserver.executor.coupling import Coupling
from mcserver.executor.entries import Array, EventKind
from mcserver.executor.envelope_bounds import Envelope
from mcserver.executor.fault_codes import FaultCode
from mcserver.gcode.program_check import check_program
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.simulation.simulation import simulate
from mcserver.units import MM
from tests.executor.coupled import LAW, Coupled, abort, eye, hold, pushed, pushes, resume, under_orders
from tests.machine_text import axes_text

ARM = resources.files("mcserver.machine.builtin").joinpath("arm6.toml").read_text("utf-8")
FOLLOW = (
    "follow = { leader = 9, source = 'encoder', tolerance = 0.1, direction = [0.0, 1.0, 0.0], "
    "window = [-150.0, 250.0], reserve = 0.4MORE }\n"
)
BELT = axes_text(
    (9,),
    velocity=400.0,
    acceleration=2000.0,
    drive="simulated",
    drive_keys="encoder_resolution = 0.005",
    keys="max_following_error = 1e6",
)


def machine(more: str = "", inputs: str = "", **words: str) -> Machine:
    follow = FOLLOW.replace("MORE", more)
    for before, other in words.items():
        follow = follow.replace(before, other)
    return parse_machine(ARM.replace('euler = "ZYX"\n', f'euler = "ZYX"\n{follow}') + BELT + inputs)


class Worker(Coupled):
    """A program of an arm beside a belt.

    Attributes:
        ordered: of each cycle what the program orders the joints, shape (K,). steady: whether the tip is in
            step with the piece.
    """

    led = (9,)

    def __init__(self, made: Machine, text: str, **options: object) -> None:
        self.kinematics = build_kinematics(made)
        assert self.kinematics is not None
        self.chain = self.kinematics.tool(1).chain
        self.ordered: list[Array] = []
        self.steady: list[bool] = []
        assert check_program(text, made, kinematics=self.kinematics) == []
        super().__init__(made, text, kinematics=self.kinematics, **options)  # type: ignore[arg-type]

    def step(self, cycles: int = 1) -> None:
        for _ in range(cycles):
            super().step()
            self.ordered.append(self.executor.executor.row.ordered[: self.chain.size].copy())
            self.steady.append(any(each.in_step and not each.ending for each in self.engaged))

    @property
    def engaged(self) -> tuple[Coupling, ...]:
        return self.executor.executor._cycle.couplings.engaged

    @property
    def belt(self) -> Array:
        """Where the belt is, in each cycle [m]."""
        return np.array(self.actuals)[:, self.column(9)]

    def tip(self, joints: list[Array]) -> tuple[Array, Array]:
        """Position and orientation of the tip."""
        return self.chain.forward(np.array(joints)[:, : self.chain.size])

    def on_piece(self, first: int = 0, last: int | None = None) -> Array:
        """How far the tip goes beside the programmed place on the piece that moves [m], some cycles."""
        part = slice(first, last)
        beside = self.tip(self.rows)[0][part] - self.tip(self.ordered)[0][part]
        beside[:, 1] -= self.belt[part]
        return beside - beside[0]

    @property
    def following(self) -> slice:
        """Cycles from where the tip has come into step to where it is let go."""
        (found,) = np.nonzero(self.steady)
        return slice(int(found[0]), int(found[-1]))


def begun(speed: float = 600.0, y: float = -120.0) -> str:
    """The arm above a belt that runs at a tenth of the speed in mm/s, coupled."""
    return f"G1010\nG1030 [9]{speed}\nG04 P0.4\nT1 G0 X460 Y{y} Z400 A0 B0 C0\nF12000\nG1060\n"


SECOND = '[[tool]]\nnumber = 2\nframe = "tip"\naxes = [0, 1, 2, 3, 4, 5]\norientation = true\n'


def shape(y: float = -120.0) -> str:
    return f"G1 X500 Y{y + 20} Z350\nG1 X500 Y{y + 60}\nG2 X460 Y{y + 60} I-20 J0\nG0 X460 Y{y}\n"


MACHINE = machine()


def test_a_share_of_the_joints_limits_is_kept_from_programs() -> None:
    axis, whole = MACHINE.axes[0], parse_machine(ARM).axes[0]
    assert axis.reserved is not None
    assert axis.max_velocity == pytest.approx(0.6 * whole.max_velocity)
    assert axis.reserved.jerk == pytest.approx(0.4 * whole.max_jerk)
    assert MACHINE.axes[-1].reserved is None


@pytest.mark.parametrize(("speed", "reserve", "lines"), [(600.0, 0.4, 4), (1800.0, 0.4, 4), (2400.0, 0.5, 2)])
def test_the_tip_draws_on_a_piece_that_moves(speed: float, reserve: float, lines: int) -> None:
    made = machine(**{"-150.0, 250.0": "-50.0, 650.0", "reserve = 0.4": f"reserve = {reserve}"})
    drawn = "\n".join(shape(-330.0).split("\n")[:lines])
    text = f"{begun(speed, -330.0)}{drawn}\nG1061\nM2"
    cell = Worker(made, text).play()
    assert cell.faults == []
    assert cell.broken() == []
    part = cell.following
    assert part.stop - part.start > 400
    assert np.abs(cell.on_piece(part.start + 100, part.stop)).max() < 0.005 * MM
    turned = cell.tip(cell.rows)[1][part] - cell.tip(cell.ordered)[1][part]
    assert np.abs(turned).max() < 1e-4
    # and the joints come to rest by themselves while the belt goes on
    assert not np.diff(np.array(cell.rows)[-3:, :6], axis=0).any()
    assert np.diff(cell.belt)[-1] > 0.0


def test_in_a_feed_hold_the_tip_stands_on_the_piece_that_goes_on() -> None:
    cell = Worker(MACHINE, f"{begun()}{shape()}G1061\nM2").play({1300: hold, 2000: resume})
    assert cell.faults == []
    assert cell.broken() == []
    on_piece = cell.tip(cell.rows)[0][:, 1] - cell.belt
    assert np.ptp(on_piece[1700:1990]) < 0.005 * MM
    assert np.ptp(cell.tip(cell.rows)[0][1700:1990, 1]) > 25.0 * MM


@under_orders(2200, ends_from=500)
def test_whatever_is_ordered_limits_are_kept_and_a_stop_leaves_the_arm_at_rest(
    orders: dict[int, Callable[[Coupled], None]], at: int, end: Callable[[Coupled], None]
) -> None:
    cell = Worker(MACHINE, f"{begun()}{shape() * 2}G1061\nM2")
    cell.play({**orders, at: end})
    assert cell.broken(jerk=end is abort) == []
    assert cell.engaged == ()
    if end is abort:
        assert cell.faults == []
        assert not np.diff(np.array(cell.rows)[-2:, :6], axis=0).any()
        shaper = cell.executor.executor.bank.shaper
        assert shaper is not None
        assert not shaper.added.any()


@LAW
@given(pushed(range(600, 1500)), st.booleans())
def test_whatever_the_belt_does_the_joints_keep_their_limits(
    what: dict[int, tuple[str, float]], shaped: bool
) -> None:
    # the shaper of one axis delays all
    beside = axes_text((8,), keys='shaper = { type = "ei", frequency_hz = 40.0 }')
    made = machine(inputs=f"{beside}[motion]\npath_tolerance_mm = 0.3\n" if shaped else "")
    cell = Worker(made, f"{begun()}{shape()}G1061\nM2").play(pushes(what, 9))
    assert cell.broken() == []
    assert set(cell.faults) <= {FaultCode.OUT_OF_STEP, FaultCode.WINDOW_LEFT, FaultCode.TOOL_BEYOND}


@LAW
@given(
    st.floats(0.0, 2.0 * math.pi),
    st.integers(-1500, 1500).map(float),
    st.sampled_from([0.2, 0.3, 0.5, 0.7]),
    st.integers(-200, 60).map(float),
)
def test_whichever_way_the_belt_goes_the_tip_is_on_the_piece_or_the_program_ends(
    angle: float, speed: float, reserve: float, y: float
) -> None:
    words = {
        "[0.0, 1.0, 0.0]": f"[{math.cos(angle)}, {math.sin(angle)}, 0.1]",
        "-150.0, 250.0": "-60.0, 120.0",
        "reserve = 0.4": f"reserve = {reserve}",
    }
    cell = Worker(machine(**words), f"{begun(speed, y)}{shape(y)}G1061\nM2").play()
    assert cell.broken() == []
    assert cell.engaged == ()
    assert set(cell.faults) <= {FaultCode.OUT_OF_STEP, FaultCode.WINDOW_LEFT, FaultCode.TOOL_BEYOND}
    if sum(cell.steady) > 200:
        part = cell.following
        beside = (cell.tip(cell.rows)[0] - cell.tip(cell.ordered)[0])[part.start + 100 : part.stop]
        along = beside @ np.array([math.cos(angle), math.sin(angle), 0.1]) / 1.01
        on_piece = along - cell.belt[part.start + 100 : part.stop]
        # twice its tolerance
        assert np.ptp(on_piece) < 0.2 * MM


@pytest.mark.parametrize("axis", [0, 3])
def test_where_the_drive_of_a_joint_fails_the_others_come_to_rest_by_themselves(axis: int) -> None:
    cell = Worker(MACHINE, f"{begun()}{shape()}G1061\nM2")
    cell.play({1300: lambda each: each.bus.trip(each.column(axis))})
    assert cell.faults == [FaultCode.OVER_TEMPERATURE]
    assert cell.broken(but=(*cell.led, axis)) == []
    assert cell.engaged == ()


def test_the_end_of_the_window_stops_the_program_within_it() -> None:
    made = machine(**{"250.0": "100.0"})
    cell = Worker(made, f"{begun()}G04 P10\nG1061\nM2").play()
    assert cell.faults == [FaultCode.WINDOW_LEFT]
    assert cell.broken() == []
    assert np.ptp((cell.tip(cell.rows)[0] - cell.tip(cell.ordered)[0])[:-5, 1]) < 100.0 * MM + 1e-6


def test_three_works_come_and_the_one_that_has_left_the_window_is_passed_over() -> None:
    # 100 mm/s: at 0 of the window 1.2 s behind the eye, and out of it 1.5 s later
    made = machine(", latch = 4, after = 120.0", inputs=eye(0.5, 1.2, 5.0), **{"250.0": "150.0"})
    pick = "G1060\nG1 Z350\nG04 P0.3\nG1061\nG0 X460 Y-120 Z400\n"
    text = f"{begun().replace('G1060', pick)}G04 P2\n{pick}M2"
    cell = Worker(made, text).play()
    assert cell.faults == []
    assert cell.broken() == []
    spells = np.flatnonzero(np.diff(np.array(cell.steady, dtype=int)))
    assert len(spells) == 4
    y, belt = cell.tip(cell.rows)[0][:, 1], cell.belt
    for risen, end in ((500, spells[1]), (5000, spells[3])):
        due = belt[risen] + 120.0 * MM
        # what the belt goes in a cycle or two of the input
        assert abs(y[end - 100] - (belt[end - 100] - due) + 120.0 * MM) < 0.25 * MM


@pytest.mark.parametrize(
    ("risen", "belt"),
    [((), "G1030 [9]60\n"), ((0.1,), ""), ((), "")],
    ids=["no work", "belt stands", "neither"],
)
def test_a_simulation_in_which_no_work_comes_ends_with_a_fault_at_g1060(
    risen: tuple[float, ...], belt: str
) -> None:
    made = machine(", latch = 4, after = 120.0", inputs=eye(*risen))
    text = f"G1010\n{belt}T1 G0 X460 Y-120 Z400 A0 B0 C0\nG1060\nG1061\nM2"
    found = simulate(text, made, kinematics=build_kinematics(made))
    waits = 1 + text.split("\n").index("G1060")
    faults = [each for each in found.report["diagnostics"] if each["severity"] == "error"]
    assert [(each["code"], each["line"]) for each in faults] == [("MC333", waits)]
    assert found.exit_code == 1


def test_a_simulation_waits_for_a_work_that_comes_late() -> None:
    made = machine(", latch = 4, after = 120.0", inputs=eye(18.0))
    text = f"{begun()}G1061\nM2"
    found = simulate(text, made, kinematics=build_kinematics(made))
    assert found.exit_code == 0
    assert found.report["duration_s"] > 18.0


def test_what_comes_behind_g1061_is_in_the_frame_that_stands() -> None:
    cell = Worker(MACHINE, f"{begun()}G04 P0.5\nG1061\nG1 X480 Y-100 Z380\nM2").play()
    assert cell.faults == []
    assert cell.broken() == []
    assert cell.tip(cell.rows)[0][-1] == pytest.approx(np.array([480.0, -100.0, 380.0]) * MM, abs=1e-6)


def test_joints_may_be_moved_by_their_own_words_too() -> None:
    cell = Worker(MACHINE, f"{begun()}G1050\nG0 C30\nG1 C0 F6000\nG1020 C10\nG04 P0.3\nG1061\nM2").play()
    assert cell.faults == []
    assert cell.broken() == []
    part = cell.following
    assert np.abs(cell.on_piece(part.start + 100, part.stop)).max() < 0.005 * MM


def test_a_cell_that_is_singular_in_its_window_is_not_coupled() -> None:
    made = machine(**{"[0.0, 1.0, 0.0]": "[1.0, 0.0, 0.0]", "-150.0, 250.0": "-460.0, 50.0"})
    cell = Worker(made, begun(y=-10.0) + "M2").play()
    assert cell.faults == [FaultCode.TOOL_BEYOND]
    assert (np.array(cell.rows)[:, :6] == np.array(cell.ordered)).all()


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("G1 Y50", None),
        ("G1 X20 Y-20", "MC304"),
        ("G1 Y500", "MC302"),
        ("G0 X0", "MC305"),
        ("G1050\nG1030 A6", "MC345"),
        ("G1050\nG1020 C30", None),
        ("G1050\nG1020 Y130", "MC305"),
        ("G1050\nG1 B0 F6000", "MC304"),
        ("G1060", "MC346"),
        ("G1050\nG1060", "MC118"),
        ("G1001 P3\nG1060", None),
    ],
)
def test_lines_on_a_belt_are_checked(line: str, code: str | None) -> None:
    text = f"G1010\nT1 G0 X460 Y-120 Z400 A0 B0 C0\nF600\nG1060\n{line}\nG1061\nM2"
    found = check_program(text, MACHINE, kinematics=build_kinematics(MACHINE))
    assert [each.code for each in found] == ([] if code is None else [code])


def test_another_tool_on_the_same_joints_works_on_the_piece_too() -> None:
    other = SECOND + "offset_mm = [30.0, 0.0, 50.0]\n"
    cell = Worker(machine(inputs=other), f"{begun()}T2 G1 X480 Y-110\nG1061\nM2").play()
    assert cell.faults == []
    assert cell.broken() == []
    part = cell.following
    assert np.ptp(np.array(cell.ordered)[part, 0]) > 0.0
    assert np.abs(cell.on_piece(part.start + 100, part.stop)).max() < 0.005 * MM


def test_a_pause_leaves_the_tip_on_the_piece() -> None:
    cell = Worker(MACHINE, f"{begun(300.0)}G1 X480\nM0\nG1 X460\nG1061\nM2")
    cell.step(1500)
    (paused,) = cell.of(EventKind.PAUSED)
    assert not paused.token & 0x3F
    assert np.abs(cell.on_piece(1300)).max() < 1e-6 * MM
    assert np.ptp(cell.belt[1300:]) > 5.0 * MM


def test_a_tool_without_follow_is_not_coupled() -> None:
    made = parse_machine(ARM)
    found = check_program("G1010\nT1 G1060\nM2", made, kinematics=build_kinematics(made))
    assert [each.code for each in found] == ["MC346"]
    assert "[tool.follow]" in found[0].message


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ({"[0.0, 1.0, 0.0]": "[0.0, 0.0, 0.0]"}, "direction is 0 0 0"),
        ({"[0.0, 1.0, 0.0]": "[0.0, nan, 0.0]"}, "not a finite number"),
        ({"leader = 9": "leader = 3"}, "follows another one itself"),
        ({"leader = 9": "leader = 33"}, "is not there"),
        ({"-150.0": "10.0"}, "a window with 0 in it"),
        ({"tolerance = 0.1": "tolerance = 0.1, latch = 7"}, "no digital input 7"),
        ({"tolerance = 0.1": "tolerance = 0.1, after = 7.0"}, "no latch"),
        ({"tolerance = 0.1": "tolerance = 0.1, ratio = 7.0"}, "is no key here"),
    ],
)
def test_a_section_that_cannot_be_is_refused(words: dict[str, str], what: str) -> None:
    with pytest.raises(MachineFileRejected, match=what):
        machine(**words)


def test_of_tools_that_share_joints_one_follows() -> None:
    both = f"{SECOND}{FOLLOW.replace('MORE', '')}"
    with pytest.raises(MachineFileRejected, match="another tool with follow has one of its joints"):
        machine(inputs=both)
    assert machine(inputs=SECOND).tools[1].follow is None
    with pytest.raises(MachineFileRejected, match="it keeps no orientation"):
        parse_machine(
            ARM.replace("orientation = true", f"orientation = false\n{FOLLOW.replace('MORE', '')}")
            + axes_text((9,))
            + SECOND
        )


@pytest.mark.parametrize("section", ["[clearance]", '[[zone]]\nname = "a"\nshape = "box"'])
def test_a_machine_whose_clearance_is_judged_has_no_such_tool(section: str) -> None:
    with pytest.raises(MachineFileRejected, match="clearance is judged"):
        machine(inputs=section)


def test_an_arm_with_joints_to_spare_is_refused() -> None:
    made = parse_machine(
        ARM.replace("orientation = true", f"orientation = false\n{FOLLOW.replace('MORE', '')}")
        + axes_text((9,))
    )
    with pytest.raises(ConfigurationError, match="joints to spare"):
        build_kinematics(made)


@pytest.mark.parametrize(
    ("line", "direction", "code"),
    [
        # the reach, a singular position above the base, and the travel of the wrist
        ("G1 X560 Y0", "[0.0, 1.0, 0.0]", FaultCode.OUT_OF_STEP),
        ("G1 X150 Y0", "[-1.0, 0.0, 0.0]", FaultCode.OUT_OF_STEP),
        ("G1 Z480", "[0.0, 0.0, 1.0]", FaultCode.TOOL_BEYOND),
    ],
)
def test_what_a_look_beforehand_misses_ends_the_program_within_the_limits(
    line: str, direction: str, code: FaultCode, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mcserver.gcode.semantics.block_interpreter.check_window", lambda *_: None)
    made = machine(**{"[0.0, 1.0, 0.0]": direction, "-150.0, 250.0": "-50.0, 80.0"})
    follow = made.tools[0].follow
    assert follow is not None
    assert follow.superimposed is not None
    wide = msgspec.structs.replace(follow.superimposed, high=1.0)
    tool = msgspec.structs.replace(made.tools[0], follow=msgspec.structs.replace(follow, superimposed=wide))
    text = f"{begun(1200.0, -10.0)}{line}\nG04 P10\nG1061\nM2"
    monkeypatch.setattr(
        "mcserver.executor.tool_coupling.places_beside",
        lambda model, joints, direction, _: places_beside(model, joints, direction, (-0.05, 0.08)),
    )
    cell = Worker(msgspec.structs.replace(made, tools=(tool,)), text).play()
    assert cell.faults == [code]
    assert cell.broken() == []
    assert cell.engaged == ()
    travel = np.array([(axis.min_position, axis.max_position) for axis in cell.machine.axes[:6]]).T
    joints = np.array(cell.rows)[:, :6]
    assert ((joints >= travel[0]) & (joints <= travel[1])).all()
    assert not np.diff(joints[-2:], axis=0).any()


def test_naming_one_joint_lets_the_tool_go() -> None:
    cell = Worker(MACHINE, f"{begun()}G04 P0.3\nG1061 P3\nG04 P0.3\nG1001 P2\nM2").play()
    assert cell.faults == []
    assert cell.broken() == []
    assert not np.diff(np.array(cell.rows)[-300:, :6], axis=0).any()
    cell = Worker(MACHINE, f"{begun()}G04 P0.3\nG1001 P2\nG04 P0.3\nM2").play()
    assert cell.faults == []
    assert not np.diff(np.array(cell.rows)[-300:, [0, 1, 3, 4, 5]], axis=0).any()


def test_an_approved_program_does_not_couple_a_tool() -> None:
    count = len(MACHINE.axes)
    envelope = Envelope((-10.0,) * count, (10.0,) * count, (100.0,) * count, 60.0, 0)
    text = "G1010\nT1 G0 X460 Y-120 Z400 A0 B0 C0\nG1060\nM2"
    cell = Worker(MACHINE, text, envelope=envelope).play()
    assert cell.faults == [FaultCode.ENVELOPE_COMMAND]


SCARA = """<robot name="scara"><link name="base"/><link name="a"/><link name="b"/><link name="c"/>
<link name="tip"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0 0.4"/>
<axis xyz="0 0 1"/><limit lower="-2.6" upper="2.6" effort="100" velocity="10"/></joint>
<joint name="j2" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.35 0 0"/>
<axis xyz="0 0 1"/><limit lower="-2.5" upper="2.5" effort="100" velocity="10"/></joint>
<joint name="j3" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0.3 0 0"/>
<axis xyz="0 0 -1"/><limit lower="0" upper="0.3" effort="100" velocity="10"/></joint>
<joint name="j4" type="revolute"><parent link="c"/><child link="tip"/>
<axis xyz="0 0 1"/><limit lower="-6.2" upper="6.2" effort="100" velocity="10"/></joint>
</robot>"""


def test_a_scara_keeps_its_orientation_on_the_belt(tmp_path: Path) -> None:
    (tmp_path / "scara.urdf").write_text(SCARA, "utf-8")
    head = f'[machine]\nname = "scara"\n[kinematics]\nurdf = "{tmp_path / "scara.urdf"}"\n'
    tool = '[[tool]]\nnumber = 1\nframe = "tip"\naxes = [0, 1, 2, 3]\norientation = true\n'
    turning = axes_text((0, 3), rotary=True, velocity=400.0, acceleration=4000.0, keys="max_jerk = 80000.0")
    elbow = axes_text(
        (1,),
        rotary=True,
        velocity=400.0,
        acceleration=4000.0,
        keys="max_jerk = 80000.0",
        drive_keys="initial_position = 60.0",
    )
    sliding = axes_text((2,), velocity=500.0, acceleration=5000.0, keys="max_jerk = 100000.0")
    follow = FOLLOW.replace("MORE", "").replace("-150.0", "-50.0")
    made = parse_machine(f"{head}{tool}{follow}{turning}{elbow}{sliding}{BELT}")
    start = "T1 G0 X400 Y-100 Z300 C0\nF12000\nG1060\n"
    text = f"G1010\nG1030 [9]600\nG04 P0.4\n{start}G1 X440 Y-80 Z250\nX440 Y-40 C30\nG0 X400 Y-100\nG1061\nM2"
    cell = Worker(made, text).play()
    assert cell.faults == []
    assert cell.broken() == []
    part = cell.following
    assert np.abs(cell.on_piece(part.start + 100, part.stop)).max() < 0.005 * MM
    turned = cell.tip(cell.rows)[1][part] - cell.tip(cell.ordered)[1][part]
    assert np.abs(turned).max() < 1e-5
