"""Bodies that come with a tool count where it is mounted, and where nobody knows that it is not."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.clearance.mounted import SPINDLE, Mounted
from mcserver.clearance.scene import Scene
from mcserver.machine.dialect_section import Cutter
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.net.status import EdgeUnits, machine_status
from mcserver.service.program import Program
from mcserver.service.program_options import ProgramOptions
from mcserver.service.reports import MountedTool
from mcserver.simulation.simulation import Simulation, simulate
from mcserver.units import DEGREE, MM
from tests.clearance.cells import Start, fault_of, place
from tests.clearance.machines import MILL, VISE, arm, block, middle_of
from tests.service.virtual_cell import VirtualCell

# T1 is short, T2 long, T3 thick: below the nose of the spindle at Z100 they reach down to Z70, Z20 and Z70
CUTTERS = """
[dialect]
profile = "cnc"
[[cutter]]
number = 1
length_mm = 30.0
diameter_mm = 10.0
[[cutter]]
number = 2
length_mm = 80.0
diameter_mm = 10.0
[[cutter]]
number = 3
length_mm = 30.0
diameter_mm = 60.0
"""
CUTTER = '[[body]]\nname = "cutter"\nshape = "cutter"\ncarried_by = [0, 1, 2]\n'
# a second place whose tools have bodies of their own
DRILL = """
[[body]]
name = "drill"
shape = "cylinder"
radius_mm = 5.0
length_mm = 80.0
at_mm = [0.0, 0.0, -40.0]
carried_by = [0, 1, 2]
tool = 2
"""


def spindle(*more: str, dialect: str = CUTTERS) -> Machine:
    return parse_machine("\n".join((MILL, dialect, *(more or (CUTTER, VISE)))))


def run(machine: Machine, *lines: str, stops: bool = False) -> Simulation:
    return simulate("\n".join(lines), machine, kinematics=build_kinematics(machine), stops=stops)


def faults(found: Simulation) -> list[tuple[str, int]]:
    return [
        (each["code"], each["line"]) for each in found.report["diagnostics"] if each["severity"] == "error"
    ]


def test_a_cutter_on_a_link_that_turns_moves_by_no_more_than_its_levers_say() -> None:
    on_the_flange = '[[body]]\nname = "cutter"\nshape = "cutter"\nlink = "flange"\n'
    scene = Scene(arm("[clearance]\n", CUTTERS, on_the_flange, block("post", (2000.0, 0.0, 500.0), 50.0)))
    pair = next(number for number, each in enumerate(scene.pairs) if set(each.names) == {"cutter", "post"})
    levers = {}
    for length in (0.03, 0.8):
        scene.mount(Mounted({SPINDLE: frozenset((1,))}, {1: Cutter(length, 0.01)}))
        levers[length] = scene.levers[:, pair].copy()
        draw, step = np.random.default_rng(1), 1e-4
        for _ in range(50):
            at = draw.uniform(-1.5, 1.5, len(levers[length]))
            for axis, lever in enumerate(levers[length]):
                distances = []
                for moved in (-step, step):
                    scene.place(at + moved * np.eye(len(at))[axis])
                    distances.append(scene.distance(pair))
                assert abs(distances[1] - distances[0]) <= 2.0 * step * lever + 1e-9
    assert (levers[0.8] > levers[0.03] + 0.5).all()


# the vise is X100 to X200, its top at Z40: over it the long one touches, the others are 30 mm above
@pytest.mark.parametrize("stops", [False, True])
@pytest.mark.parametrize("bodies", [(CUTTER, VISE), (DRILL, VISE)])
@pytest.mark.parametrize(("tool", "found"), [(1, []), (2, [("MC320", 2)]), (3, []), (0, [])])
def test_the_tool_that_is_fitted_counts(
    tool: int, found: list[tuple[str, int]], bodies: tuple[str, ...], stops: bool
) -> None:
    assert faults(run(spindle(*bodies), f"T{tool} M6", "G1 X150 F6000", "G1 X300", stops=stops)) == found


def test_a_thick_tool_hits_what_a_thin_one_passes_by() -> None:
    beside = ("G1 Z50 F6000", "G1 X80", "G1 X0")
    assert not faults(run(spindle(), "T1 M6", *beside))
    assert faults(run(spindle(), "T3 M6", *beside)) == [("MC320", 3)]


@pytest.mark.parametrize("stops", [False, True])
@pytest.mark.parametrize("bodies", [(CUTTER, VISE), (DRILL, VISE)])
def test_a_change_in_the_program_counts_from_its_line_on(bodies: tuple[str, ...], stops: bool) -> None:
    machine = spindle(*bodies)
    lines = ["T1 M6", "G1 X300 F6000", "G1 X0", "T2 M6", "G1 X300"]
    assert faults(run(machine, *lines, stops=stops)) == [("MC320", 5)]
    back = ["T1 M6", "G1 X150 F6000", "G1 X0", "T2 M6", "T3 M6", "G1 X150"]
    assert not faults(run(machine, *back, stops=stops))


@pytest.mark.parametrize("stops", [False, True])
def test_before_it_is_said_which_tool_is_fitted_the_longest_and_thickest_counts(stops: bool) -> None:
    machine = spindle()
    lines = ["G1 X150 F6000", "G1 X0", "T1 M6", "G1 X150"]
    (fault,) = [
        each
        for each in run(machine, *lines, stops=stops).report["diagnostics"]
        if each["severity"] == "error"
    ]
    assert (fault["code"], fault["line"]) == ("MC320", 1)
    assert "not known" in fault["hint"]
    # where no tool reaches there is none
    assert not faults(run(machine, "G1 Z130 F6000", "G1 X150", stops=stops))


def test_a_tool_that_only_may_be_there_does_not_touch_before_something_moves() -> None:
    under = block("lump", (0.0, 0.0, 40.0), 20.0)
    assert not faults(run(spindle(CUTTER, under), "T1 M6", "G1 X150 F6000"))
    assert faults(run(spindle(CUTTER, under), "G1 X150 F6000", "T1 M6"))


def test_a_tool_that_reaches_into_something_where_it_is_fitted_is_named_at_that_line() -> None:
    under = block("lump", (0.0, 0.0, 40.0), 20.0)
    assert faults(run(spindle(CUTTER, under), "T1 M6", "T2 M6", "G1 X150 F6000")) == [("MC320", 2)]


def test_the_length_that_g10_sets_counts() -> None:
    machine = spindle()
    assert not faults(run(machine, "G10 L1 P2 Z40", "T2 M6", "G1 X150 F6000"))
    assert faults(run(machine, "T1 M6", "G10 L1 P1 Z70", "G1 X150 F6000")) == [("MC320", 3)]
    assert faults(run(machine, "T1 M6", "G10 L1 P1 Z0", "G1 X150 F6000")) == [("MC143", 2)]
    # of a tool that is not in nothing counts
    assert not faults(run(machine, "T1 M6", "G10 L1 P3 Z75", "G1 X150 F6000"))


def test_a_long_program_is_read_in_columns_with_the_tool_that_is_in() -> None:
    machine = spindle()
    zigzag = [f"G1 X{10 + each % 2} Y{each % 7} F6000" for each in range(200)]
    assert faults(run(machine, "T1 M6", *zigzag, "G1 X150", "G1 X10", "T2 M6", *zigzag, "G1 X150")) == [
        ("MC320", 405)
    ]


GRIPPER = """
[[tool]]
number = 2
frame = "tip"
axes = [0, 1, 2, 3, 4, 5]
orientation = true
[[body]]
name = "gripper"
shape = "sphere"
radius_mm = 60.0
link = "tip"
tool = 2
"""


def beside_the_tip() -> str:
    """A lump that the gripper meets half-way on a turn of axis 2, and the bare arm passes by."""
    machine = arm("[clearance]\n", GRIPPER)
    scene = Scene(machine)
    half = np.array([axis.initial_position for axis in machine.axes])
    half[2] -= 60.0 * DEGREE
    at = middle_of(scene, "gripper", half) + np.array([0.0, 0.06, 0.0])
    return block("lump", tuple((at / MM).tolist()), 10.0)


@pytest.mark.parametrize("stops", [False, True])
@pytest.mark.parametrize(
    ("lines", "found"),
    [
        (("T1", "G1050", "G1 Z-120 F6000"), []),
        (("T2", "G1050", "G1 Z-120 F6000"), [("MC320", 4)]),
        (("T2", "T1", "G1050", "G1 Z-120 F6000"), []),
        (("G1 Z-120 F6000",), [("MC320", 2)]),
    ],
)
def test_a_body_of_a_robots_tool_counts_from_t_on(
    lines: tuple[str, ...], found: list[tuple[str, int]], stops: bool
) -> None:
    machine = arm("[clearance]\n", GRIPPER, beside_the_tip())
    assert faults(run(machine, "G1010", *lines, stops=stops)) == found


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        (CUTTERS + CUTTER.replace('cutter"\nshape', 'a"\nshape') + CUTTER, "more than one is the cutter"),
        ('[dialect]\nprofile = "cnc"\n' + CUTTER, "the cutter has no size"),
        (CUTTER, "no program of this machine fits a cutter"),
        (CUTTERS.replace("diameter_mm = 60.0", "") + CUTTER, "cutter[2].diameter_mm: 0 is not above 0"),
        (CUTTERS.replace("length_mm = 80.0", "length_mm = -1.0") + CUTTER, "cutter[1].length_mm: -1 is not"),
        (CUTTERS.replace("length_mm = 80.0", "length_mm = inf") + CUTTER, "cutter[1].length_mm"),
        (CUTTERS + DRILL.replace("tool = 2", "tool = 7"), "the machine has no tool 7"),
        (DRILL, "the machine has no tool 2"),
        (CUTTERS + DRILL.replace("tool = 2", "tool = 0"), "tool"),
        (CUTTERS + CUTTER + "tool = 2\n", "the cutter is that of any tool"),
    ],
)
def test_a_mistake_is_named_with_its_place(sections: str, message: str) -> None:
    with pytest.raises(MachineFileRejected) as refused:
        parse_machine("\n".join((MILL, sections, VISE)))
    assert message in str(refused.value)


# ---------------------------------------------------------------- on a server


async def jog(cell: VirtualCell, axis: int, distance: float) -> Program:
    return await cell.ended(await cell.jog(axis, distance))


@pytest.mark.parametrize("bodies", [(CUTTER, VISE), (DRILL, VISE)])
async def test_a_program_stops_before_what_its_tool_would_hit(start: Start, bodies: tuple[str, ...]) -> None:
    cell = start(spindle(*bodies))
    program = await cell.run("T1 M6", "G1 X300 F6000", "G1 X0")
    assert (program.state, program.fault) == ("finished", None)
    program = await cell.run("T2 M6", "G1 X300 F6000")
    assert fault_of(program) == ("MC320", 2)
    assert place(cell, 0) == pytest.approx(94.0, abs=0.3)


async def test_a_jog_and_a_later_program_have_the_tool_that_is_in(start: Start) -> None:
    cell = start(spindle())

    def mounted() -> list[MountedTool]:
        return machine_status(cell.service, EdgeUnits(cell.service.machine)).mounted

    # nobody has said what is in
    assert mounted() == []
    assert fault_of(await jog(cell, 0, 150.0))[0] == "MC320"
    assert (await jog(cell, 0, -place(cell, 0))).state == "finished"
    assert (await cell.run("T1 M6")).state == "finished"
    assert [(each.number, each.spindle) for each in mounted()] == [(1, True)]
    assert (mounted()[0].length, mounted()[0].diameter) == pytest.approx((30.0, 10.0))
    assert (await jog(cell, 0, 150.0)).state == "finished"
    assert (await cell.run("G1 X0 F6000", "G1 X300", "G1 X0")).state == "finished"
    assert (await cell.run("T2 M6")).state == "finished"
    assert fault_of(await jog(cell, 0, 150.0))[0] == "MC320"
    assert place(cell, 0) == pytest.approx(94.0, abs=0.3)


async def test_a_change_that_is_broken_off_leaves_both_tools_possible(start: Start) -> None:
    cell = start(spindle())
    program = await cell.begin("T1 M6", "G1 X1 F6000", "T2 M6", "G1 X0")
    await cell.until(lambda: program.state == "paused")
    cell.service.abort(program.program)
    await cell.ended(program)
    assert fault_of(await jog(cell, 0, 150.0))[0] == "MC320"
    assert (await cell.run("T1 M6", "G1 X300 F6000")).state == "finished"


# the spindle stands at X100 and its nose at Z100; a sledge 30 mm high passes below it
SLEDGE = """
[[body]]
name = "cutter"
shape = "cutter"
at_mm = [100.0, 0.0, 0.0]
carried_by = [2]
[[body]]
name = "sledge"
shape = "box"
size_mm = [20.0, 20.0, 30.0]
at_mm = [0.0, 0.0, 15.0]
carried_by = [0]
"""


async def test_a_tool_is_not_fitted_where_another_program_passes_by(start: Start) -> None:
    cell = start(spindle(SLEDGE, dialect=CUTTERS.replace('"cnc"', '"cnc"\ntool_change = "ignore"')))
    assert (await cell.run("T1 M6", axes=[2])).state == "finished"
    other = await cell.begin("G1 X85 F12000", "G1 X115 F600", "G1 X300 F12000", axes=[0])
    await cell.until(lambda: place(cell, 0) > 86.0)
    program = await cell.run("T2 M6", axes=[2])
    assert fault_of(program) == ("MC320", 1)
    assert program.fault is not None
    assert other.program in program.fault.message


async def test_another_program_stops_before_the_tool_that_is_in(start: Start) -> None:
    cell = start(spindle(SLEDGE))
    for tool, state in ((1, "finished"), (2, "faulted")):
        assert (await cell.run(f"T{tool} M6", axes=[2])).state == "finished"
        assert (await cell.run("G1 X200 F6000", "G1 X0", axes=[0])).state == state
    assert place(cell, 0) == pytest.approx(84.0, abs=0.3)


async def test_a_length_that_a_program_beside_has_measured_counts(start: Start) -> None:
    # T1 of 30 mm passes over the sledge, with 80 mm it does not
    cell = start(spindle(SLEDGE))
    assert (await cell.run("T1 M6", axes=[2])).state == "finished"
    sledge = await cell.service.open("test", ProgramOptions(axes=[0]))
    await cell.service.lines.submit("test", sledge.program, 1, ["G1 X10 F6000"])
    await cell.until(lambda: sledge.done == 1)
    assert (await cell.run("G10 L1 P1 Z80", axes=[1])).state == "finished"
    await cell.service.lines.submit("test", sledge.program, 2, ["G1 X200"])
    assert fault_of(await cell.ended(sledge)) == ("MC320", 2)
    assert place(cell, 0) == pytest.approx(84.0, abs=0.3)


def test_the_larger_size_counts_while_programs_run() -> None:
    begins = Mounted(cutters={1: Cutter(0.03, 0.01), 2: Cutter(0.08, 0.01)})
    mounted = Mounted({SPINDLE: frozenset((1,))}, {1: Cutter(0.05, 0.006)})
    assert mounted.at_begin(begins, beside_others=True).cutter() == Cutter(0.05, 0.01)
    assert mounted.at_begin(begins, beside_others=False).cutter() == Cutter(0.03, 0.01)
