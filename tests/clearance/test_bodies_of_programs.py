"""Bodies that a program brings: judged as those of the machine file are, and gone at its end."""

from __future__ import annotations

import pytest

from mcserver.gcode.program_check import check_program
from mcserver.machine.clearance_section import MOST_GIVEN
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.simulation import Simulation, simulate
from tests.clearance.cells import Start, fault_of, place
from tests.clearance.machines import MILL, TOOL, VISE, block, mill
from tests.cli.command import EXAMPLES

# of VISE, as a program brings it
BROUGHT = "(BODY, vise, box, 100 60 40, 150 0 20)"
FAR = block("table", (0.0, 0.0, -500.0), 10.0)
CNC = '[dialect]\nprofile = "cnc"\n'
# a table that moves along X, and the tool along Y and Z
TABLE = (
    TOOL.replace("[0, 1, 2]", "[1, 2]")
    + '[[body]]\nname = "slide"\nshape = "box"\nsize_mm = [400.0, 60.0, 10.0]\nat_mm = [150.0, 0.0, -5.0]\n'
    + "carried_by = [0]\nopposite = true\n"
)


def run(machine: Machine, *lines: str, stops: bool = False) -> Simulation:
    return simulate("\n".join(("G1010", *lines)), machine, kinematics=build_kinematics(machine), stops=stops)


def faults(found: Simulation) -> list[tuple[str, int]]:
    """Codes and lines, counted behind G1010."""
    return [(each["code"], each["line"] - 1) for each in found.report["diagnostics"]]


@pytest.mark.parametrize("stops", [False, True])
@pytest.mark.parametrize("lines", [("G1 Z20 F6000", "G1 X150"), ("G1 Z50 F6000", "G1 X300", "G1 X0")])
def test_a_body_of_the_program_counts_as_one_of_the_machine_file(lines: tuple[str, ...], stops: bool) -> None:
    of_file, of_program = (
        run(mill(VISE), "", *lines, stops=stops),
        run(mill(FAR), BROUGHT, *lines, stops=stops),
    )
    assert faults(of_program) == faults(of_file)
    least = [each.report["clearance"]["least_mm"] for each in (of_program, of_file)]
    assert least[0] == pytest.approx(least[1], abs=0.1)
    assert of_program.report["ok"] is (len(lines) == 3)


@pytest.mark.parametrize(
    ("shape", "lowest"),
    [
        ("box, 100 60 40, 150 0 20", 41.0),
        ("cylinder, 50 40, 150 0 20", 41.0),
        ("capsule, 20 40, 150 0 0", 41.0),
        ("sphere, 20, 150 0 20", 41.0),
        ("box, 100 40 60, 150 0 20, turned 90 0 0", 41.0),
    ],
)
def test_each_shape_is_where_it_is_said_to_be(shape: str, lowest: float) -> None:
    for height, expected in ((lowest + 0.05, []), (lowest - 0.05, [("MC320", 3)])):
        down = (f"(BODY, part, {shape})", "G1 X150 F6000", f"G1 Z{height}")
        assert faults(run(mill(FAR), *down)) == expected


def test_it_counts_from_its_line_to_the_end_of_the_program() -> None:
    machine = mill(FAR)
    down = ("G1 Z20 F6000", "G1 X150", "G1 X0")
    assert faults(run(machine, *down, BROUGHT, "G1 X150")) == [("MC320", 5)]
    assert not faults(run(machine, *down, BROUGHT, "M2", "G1 X150"))


def test_bodies_of_one_program_may_be_many_and_each_counts() -> None:
    machine = mill(FAR)
    posts = [f"(BODY, post {at}, box, 2 2 40, {at} 0 20)" for at in (100, 200, 250)]
    assert faults(run(machine, *posts, "G1 Z20 F6000", "G1 X92")) == []
    found = run(machine, *posts, "G1 Z60 F6000", "G1 X225", "G1 Z20", "G1 X300").report["diagnostics"]
    assert [each["message"].split("'")[3] for each in found] == ["post 250"]


def test_the_work_system_in_force_places_it() -> None:
    machine = parse_machine("\n".join((MILL, CNC, TOOL, FAR)))
    zero = ("G10 L2 P2 X150 Z20", "G55", "(BODY, vise, box, 100 60 40, 0 0 0, work)", "G54")
    assert faults(run(machine, *zero, "G1 Z20 F6000", "G1 X150")) == [("MC320", 6)]
    assert faults(run(machine, *zero, "G1 Z41.1 F6000", "G1 X150")) == []
    turned = ("G10 L2 P2 X150 R30", "G55", "(BODY, vise, box, 100 60 40, 0 0 0, work)")
    assert faults(run(machine, *turned)) == [("MC204", 3)]


def test_it_goes_along_with_the_table_that_it_stands_on() -> None:
    machine = parse_machine("\n".join((MILL, TABLE, FAR)))
    under = ("G1 Z20 F6000", "G1 X150")
    # the table brings it under the tool
    on = "(BODY, vise, box, 100 60 40, 150 0 20, on slide, touches slide)"
    assert faults(run(machine, on, *under)) == [("MC320", 3)]
    # what stands beside the machine is not moved, and the table runs into it
    assert faults(run(machine, "(BODY, post, box, 10 10 10, -60 0 0)", *under)) == [("MC320", 3)]
    assert faults(run(machine, BROUGHT, "G1 Z60 F6000"))[0] == ("MC320", 1)


def test_what_is_cut_may_touch_its_cutter_and_nothing_else_may() -> None:
    machine = mill(FAR, TOOL.replace('"tool"', '"holder"').replace("30.0]", "95.0]"))
    part = "(BODY, part, box, 100 60 40, 150 0 20, touches tool)"
    into = ("G1 X150 F6000", "G1 Z30")
    assert faults(run(machine, part, *into)) == []
    assert faults(run(machine, part, *into, "G1 Z-30")) == [("MC320", 4)]


GARBAGE = [
    ("(BODY,)", "MC204", 1),
    ("(BODY, a)", "MC204", 1),
    ("(BODY, a, box)", "MC204", 1),
    ("(BODY, a, box, 1 1 1)", "MC204", 1),
    ("(BODY, , box, 1 1 1, 0 0 0)", "MC204", 8),
    ("(BODY, tool, box, 1 1 1, 0 0 0)", "MC204", 8),
    ("(BODY, a, bx, 1 1 1, 0 0 0)", "MC204", 11),
    ("(BODY, a, box, 1 1, 0 0 0)", "MC204", 16),
    ("(BODY, a, box, 1 nan 1, 0 0 0)", "MC204", 16),
    ("(BODY, a, box, 1 1e3 1, 0 0 0)", "MC204", 16),
    ("(BODY, a, box, 1 0 1, 0 0 0)", "MC204", 16),
    ("(BODY, a, box, 1 -1 1, 0 0 0)", "MC204", 16),
    ("(BODY, a, box, 1 1 9999999, 0 0 0)", "MC204", 16),
    ("(BODY, a, box, 1 1 1, 0 0 #1)", "MC204", 23),
    ("(BODY, a, box, 1 1 1, 0 0 0, spinning)", "MC204", 30),
    ("(BODY, a, box, 1 1 1, 0 0 0, work)", "MC204", 30),
    ("(BODY, a, box, 1 1 1, 0 0 0, on tabel)", "MC204", 30),
    ("(BODY, a, box, 1 1 1, 0 0 0, touches nothing)", "MC204", 30),
    ("(BODY, a, box, 1 1 1, 0 0 0, turned 1 2)", "MC204", 30),
    ("(BODY, a, box, 1 1 1, 0 0 0, turned 1 2 3, turned 1 2 3)", "MC204", 44),
    ("(BODY, a, stl, /etc/passwd, 0 0 0)", "MC206", 11),
    ("(BODY, a, mesh, vise.stl, 0 0 0)", "MC206", 11),
    ("G1 X1 F100 (BODY a, box, 1 1 1, 0 0 0)", "MC204", 12),
    ("(BODY, a, box, 1 1 1, 0 0 0)(BODY, a, box, 2 2 2, 0 0 0)", "MC204", 29),
    ("G1 X1 F100 ( body , a, box, 1)", "MC204", 12),
]


@pytest.mark.parametrize(("text", "code", "column"), GARBAGE)
def test_garbage_is_refused_where_it_stands(text: str, code: str, column: int) -> None:
    (found,) = check_program(text, mill(FAR))
    assert (found.code, found.line, found.column) == (code, 1, column)
    assert found.hint
    assert run(mill(FAR), text).report["duration_s"] == 0.0


def test_more_bodies_than_a_program_may_bring_are_refused() -> None:
    lines = [f"(BODY, b{each}, box, 1 1 1, 0 0 {-90 - 2 * each})" for each in range(MOST_GIVEN + 1)]
    found = check_program("\n".join(lines), mill(FAR))
    assert [(each.code, each.line) for each in found] == [("MC207", MOST_GIVEN + 1)]


def test_a_machine_that_judges_no_bodies_refuses_them() -> None:
    (found,) = check_program(BROUGHT, parse_machine(MILL))
    assert found.code == "MC205"


@pytest.mark.parametrize(
    "text", ["(BODY)", "(BODY WORK IS FINE)", "; (BODY, a", "(a body, there)", "(MSG, BODY, a)"]
)
def test_other_comments_bring_nothing(text: str) -> None:
    assert check_program(f"{text}\nG1 X1 F100", mill(FAR)) == []


def test_a_line_that_is_read_again_brings_the_same_body() -> None:
    machine = parse_machine("\n".join((MILL, CNC, TOOL, FAR)))
    loop = ("o1 repeat [3]", BROUGHT, "G1 Z60 F6000", "o1 endrepeat", "G1 X150", "G1 Z20")
    assert faults(run(machine, *loop)) == [("MC320", 6)]
    # lines that are alike are read together, and the body stands before the right ones
    many = [f"G1 X{each / 10} F6000" for each in range(50)]
    assert faults(run(machine, *many, BROUGHT, *many, "G1 X150", "G1 Z20")) == [("MC320", 103)]


def test_an_arm_s_program_brings_the_post_that_another_one_s_machine_file_has() -> None:
    text = (EXAMPLES / "post-and-door.toml").read_text()
    post = text[text.index('[[body]]\nname = "post"') : text.index('[[body]]\nname = "pen"')]
    program = (EXAMPLES / "clearance.gcode").read_text().splitlines()[2:]
    found = run(parse_machine(text.replace(post, "")), "(BODY, post, cylinder, 25 300, 500 60 350)", *program)
    assert faults(found) == [("MC320", 6)]
    assert "'flange' comes too near to 'post'" in found.report["diagnostics"][0]["message"]


def test_a_drive_that_is_lost_beside_it_is_found() -> None:
    lines = ("G1 Z20 F6000", "G1 X93.5 F12000", "G1 X0")
    found = run(mill(FAR), BROUGHT, *lines, stops=True)
    assert faults(found) == [("MC325", 3)]
    assert found.report["clearance"]["lost_drives"]["pairs"][0]["bodies"] == ["tool", "vise"]


async def test_a_server_stops_before_it_and_forgets_it_with_the_program(start: Start) -> None:
    cell = start(mill(FAR))
    program = await cell.run(BROUGHT, "G1010", "G1 Z20 F6000", "G1 X150")
    assert (program.state, fault_of(program)) == ("faulted", ("MC320", 4))
    assert 93.7 <= place(cell, 0) <= 94.02
    # nothing of it is left, whoever comes
    assert (await cell.run("G1 X150 F6000")).state == "finished"
    assert (await cell.run("G1 X0 F6000", BROUGHT, "M2")).state == "finished"
    assert (await cell.run("G1 X150 F6000")).state == "finished"


async def test_another_program_that_runs_beside_sees_it_and_waits_until_it_goes(start: Start) -> None:
    cell = start(mill(FAR))
    await cell.run("G1010", "G1 Z20 F6000")
    bringing = await cell.begin(BROUGHT, "G4 P600", axes=[1])
    await cell.until(lambda: bringing.done >= 1)
    beside = await cell.begin("G1 X150 F6000", axes=[0])
    await cell.until(lambda: place(cell, 0) > 90.0 and not any(cell.executor.feedback.velocity))
    assert 93.7 <= place(cell, 0) <= 94.02
    cell.service.abort(bringing.program)
    assert (await cell.ended(beside)).state == "finished"


async def test_a_body_that_another_program_is_about_to_pass_is_not_taken(start: Start) -> None:
    cell = start(mill(FAR))
    await cell.run("G1010", "G1 Z20 F6000")
    under_way = await cell.begin("G0 X300", axes=[0])
    await cell.until(lambda: place(cell, 0) > 20.0)
    # it is still about to, however long the other one takes to come
    cell.service.hold(under_way.program)
    bringing = await cell.run(BROUGHT, "G4 P1", axes=[1])
    assert (bringing.state, fault_of(bringing)) == ("faulted", ("MC320", 1))
    cell.service.resume(under_way.program)
    await cell.ended(under_way)
    assert under_way.state == "finished"
