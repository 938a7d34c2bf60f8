"""Bodies in a slow zone keep its speed, in simulations and on a server."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from mcserver.machine.machine_file import Machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.simulation.simulation import simulate_lines
from mcserver.units import MM
from tests.clearance.cells import Start
from tests.clearance.machines import arm, mill, shaped_mill

# from X50 on; the tool has a radius of 5 mm
DESK = """
[[zone]]
name = "desk"
kind = "slow"
max_speed_mm_s = 50.0
size_mm = [100.0, 400.0, 400.0]
at_mm = [100.0, 0.0, 100.0]
"""


def faults(lines: Sequence[str], machine: Machine, *, stops: bool = False) -> list[tuple[str, int]]:
    found = simulate_lines(lambda: iter(["G1010", *lines]), machine, stops=stops)
    return [(each["code"], each["line"]) for each in found.report["diagnostics"]]


@pytest.mark.parametrize("stops", [False, True])
@pytest.mark.parametrize(
    ("lines", "found"),
    [
        # 50 mm/s is F3000; two axes together make one speed
        (["G1 X100 F3000"], []),
        (["G1 X100 Y100 F3000"], []),
        (["G1 X100 F3050"], [("MC322", 2)]),
        (["G1 X40 F12000", "G1 X100 F3000", "G1 X40", "G1 X0 F12000"], []),
        (["G1 X100 F3000", "G1 Y100 F6000"], [("MC322", 3)]),
        (["G1 Y100 F12000"], []),
        (["G0 X100"], [("MC322", 2)]),
        (["G0 X40", "G0 Y100"], []),
        # past it and out again within a line
        (["G1 Y-250 F12000", "G1 X300"], []),
        (["G1 X300 F12000"], [("MC322", 2)]),
    ],
)
def test_a_line_that_is_too_fast_in_the_zone_is_named(
    lines: list[str], found: list[tuple[str, int]], stops: bool
) -> None:
    assert faults(lines, mill(DESK), stops=stops) == found


@pytest.mark.parametrize(
    ("lines", "found"),
    [
        # in flight it slows down just at the border, where drives have yet to play what came before
        (["G64 P0.6", "G1 X44.9 F12000", "G1 X100 F3000"], [("MC322", 3)]),
        # and it may not be fast as soon as it has left
        (["G64 P0.6", "G1 X45.1 F3000", "G1 X100", "G1 X44.9", "G1 X0 F12000"], [("MC322", 6)]),
        (["G64 P0.6", "G1 X30 F12000", "G1 X100 F3000", "G1 X40", "G1 X0 F12000"], []),
        # an exact stop ends what was before
        (["G1 X40 F12000", "G1 X100 F3000", "G1 Y100", "G1 X44.5", "G0 X0"], []),
        (["G64 P0.6", "G1 X100 Y50 F3000", "G1 Y100", "G1 X80"], []),
    ],
)
def test_shaped_setpoints_of_what_is_ordered_are_slow_in_the_zone(
    lines: list[str], found: list[tuple[str, int]]
) -> None:
    assert faults(lines, shaped_mill(DESK), stops=True) == found
    if not found:
        # what drives get, cycle by cycle
        assert not faults(lines, shaped_mill(DESK))


def test_a_rapid_that_is_slow_there_by_itself_is_refused_by_the_server_alone() -> None:
    # too short to be fast
    lines = ["G1 X100 F3000", "G0 X101"]
    assert not faults(lines, mill(DESK))
    assert faults(lines, mill(DESK), stops=True) == [("MC322", 3)]


def test_the_fastest_point_of_a_body_counts_where_it_turns() -> None:
    pen = '[[body]]\nname = "pen"\nshape = "sphere"\nradius_mm = 10.0\nlink = "tip"\n'
    zone = """
[[zone]]
name = "desk"
kind = "slow"
max_speed_mm_s = {}
size_mm = [3000.0, 3000.0, 3000.0]
bodies = ["pen"]
"""
    # axis 0 at 10 deg/s turns the pen about 460 mm away, and its far side 470
    lines = ["G1 X40 F600"]
    for limit, found in ((81.0, [("MC322", 2)]), (84.0, [])):
        assert faults(lines, arm("[clearance]\n", pen, zone.format(limit))) == found


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("max_speed_mm_s = 50.0\n", "", "zone[0].max_speed_mm_s: is missing"),
        ("50.0", "0.0", "max_speed_mm_s"),
        ("50.0", "inf", "max_speed_mm_s"),
        ('"slow"', '"keep_in"', "max_speed_mm_s: is not for keep_in"),
    ],
)
def test_a_mistake_is_named_with_its_place(old: str, new: str, message: str) -> None:
    with pytest.raises(MachineFileRejected) as refused:
        mill(DESK.replace(old, new))
    assert message in str(refused.value)


async def test_a_program_stops_before_it_is_too_fast_and_a_slower_one_goes_on(start: Start) -> None:
    cell = start(mill(DESK))
    program = await cell.run("G1010", "G1 X200 F12000")
    assert (program.state, program.done) == ("faulted", 1)
    assert program.fault is not None
    assert (program.fault.code, program.fault.line) == ("MC322", 2)
    assert "200 mm/s in the slow zone 'desk', 50 are allowed" in program.fault.message
    assert cell.position(0) / MM <= 45.01
    assert (await cell.run("G1 X200 F3000", "G0 X300")).state == "finished"


async def test_a_jog_goes_slowly_there(start: Start) -> None:
    cell = start(mill(DESK))
    for velocity, state in ((100.0, "faulted"), (40.0, "finished")):
        program = await cell.jog(0, 80.0, velocity)
        assert (await cell.ended(program)).state == state
