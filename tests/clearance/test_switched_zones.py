"""Zones that an input switches on: a hold in its cycle, before them where there is room."""

from __future__ import annotations

import asyncio
import random

import pytest

from mcserver.clearance.scene import Scene
from mcserver.errors import Refused
from mcserver.machine.machine_file import Machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.service.program import Program
from mcserver.simulation.simulation import simulate_lines
from tests.clearance.cells import Start, fault_of, place
from tests.clearance.machines import mill
from tests.machine_text import axes_text
from tests.service.virtual_cell import VirtualCell

# free up to X79: the zone begins at X85, the tool has a radius of 5 mm, the margin is 1 mm
CURTAIN = """
[[input]]
number = 3
name = "curtain"
initial = true
[[zone]]
name = "loading"
input = 3
active = "low"
size_mm = [100.0, 400.0, 400.0]
at_mm = [135.0, 0.0, 100.0]
"""


async def switch(cell: VirtualCell, *, on: bool) -> None:
    """Interrupt the curtain, or let it be free."""
    cell.service.channels.set_input("curtain", not on)
    await cell.until(lambda: bool(cell.executor.feedback.inputs[0]) is not on)


async def rests(cell: VirtualCell) -> None:
    await cell.until(lambda: not any(cell.executor.feedback.velocity))


@pytest.mark.parametrize(
    "lines",
    [
        ("G1 X120 F6000", "G1 X0"),
        ("G0 X120", "G0 X0"),
        ("G1020 X120", "G1 Y50 F1200", "G0 X0"),
    ],
)
async def test_a_program_is_held_before_a_zone_that_is_switched_on_and_goes_on_by_resume(
    start: Start, lines: tuple[str, ...]
) -> None:
    cell = start(mill(CURTAIN), turn_s=0.002)
    program = await cell.begin("G1010", *lines)
    await cell.until(lambda: place(cell, 0) > 20.0)
    await switch(cell, on=True)
    await cell.until(lambda: program.state == "held")
    await rests(cell)
    assert 20.0 < place(cell, 0) < 79.0
    held = [event for event in cell.events if event.kind == "program.held"]
    assert [(each.reason, '"curtain"' in each.message) for each in held] == [("MC449", True)]
    with pytest.raises(Refused, match="MC443: "):
        cell.service.resume(program.program)
    await switch(cell, on=False)
    await rests(cell)
    assert place(cell, 0) < 79.0
    cell.service.resume(program.program)
    assert (await cell.ended(program)).state == "finished"
    assert place(cell, 0) == pytest.approx(0.0, abs=0.01)


async def test_a_program_that_stays_out_of_the_zone_goes_on(start: Start) -> None:
    cell = start(mill(CURTAIN), turn_s=0.002)
    program = await cell.begin("G1010", "G1 X70 F6000", "G0 X0 Y50", "G1 Y0")
    await cell.until(lambda: place(cell, 0) > 20.0)
    await switch(cell, on=True)
    assert (await cell.ended(program)).state == "finished"
    assert not [event for event in cell.events if event.kind == "program.held"]


async def test_what_begins_after_a_start_with_the_zone_on_is_held_before_it(start: Start) -> None:
    cell = start(mill(CURTAIN.replace("initial = true", "initial = false")), turn_s=0.002)
    program = await cell.begin("G1010", "G1 X120 F6000", "G1 X200")
    await cell.until(lambda: program.state == "held")
    await rests(cell)
    assert 0.0 < place(cell, 0) < 79.0
    await switch(cell, on=False)
    cell.service.resume(program.program)
    assert (await cell.ended(program)).state == "finished"


async def test_a_body_that_is_inside_as_the_zone_is_switched_on_is_a_fault_and_a_jog_leads_out(
    start: Start,
) -> None:
    cell = start(mill(CURTAIN), turn_s=0.002)
    program = await cell.begin("G1010", "G1 X120 F6000", "G1 Y100 F1200", "G1 X200")
    await cell.until(lambda: place(cell, 1) > 20.0)
    await switch(cell, on=True)
    assert fault_of(await cell.ended(program)) == ("MC324", 3)
    assert place(cell, 1) < 60.0
    # no line leads out, whichever way it goes
    at = place(cell, 0), place(cell, 1)

    async def is_held(program: Program) -> None:
        await cell.until(lambda: program.state == "held")
        await rests(cell)
        cell.service.abort(program.program)
        await cell.ended(program)

    await is_held(await cell.begin("G1 X0 F6000"))

    await is_held(await cell.jog(0, 5.0, 50.0))
    assert (place(cell, 0), place(cell, 1)) == pytest.approx(at, abs=0.01)
    assert (await cell.ended(await cell.jog(0, -60.0, 50.0))).state == "finished"
    assert place(cell, 0) == pytest.approx(60.0, abs=0.1)
    await is_held(await cell.jog(0, 40.0, 50.0))
    assert place(cell, 0) < 79.0


async def test_who_stands_in_the_zone_is_held_once_it_would_move(start: Start) -> None:
    cell = start(mill(CURTAIN), turn_s=0.002)
    program = await cell.begin("G1010", "G1 X120 F6000", "M0", "G1 X0")
    await cell.until(lambda: program.state == "paused")
    await switch(cell, on=True)
    await rests(cell)
    # a tool is changed by hand behind the curtain, say
    assert program.state == "paused"
    await switch(cell, on=False)
    cell.service.resume(program.program)
    assert (await cell.ended(program)).state == "finished"


async def test_who_waits_in_the_zone_is_held_there_and_is_no_fault(start: Start) -> None:
    button = '[[input]]\nnumber = 4\nname = "button"\n'
    cell = start(mill(CURTAIN, button), turn_s=0.002)
    program = await cell.begin("G1010", "G1 X120 F6000", "M66 P4 L3 Q60", "G1 X0")
    await cell.until(lambda: place(cell, 0) > 119.9)
    await rests(cell)
    await switch(cell, on=True)
    cell.service.channels.set_input("button", True)
    await cell.until(lambda: program.state == "held")
    await rests(cell)
    assert place(cell, 0) == pytest.approx(120.0, abs=0.01)
    await switch(cell, on=False)
    cell.service.resume(None)
    assert (await cell.ended(program)).state == "finished"


async def test_axes_that_another_program_brings_together_are_held_with_it(start: Start) -> None:
    # only X beyond 79 and Z below 60 are in the zone
    low = CURTAIN.replace("400.0, 400.0]", "400.0, 60.0]").replace("0.0, 100.0]", "0.0, 30.0]")
    cell = start(mill(low), turn_s=0.002)
    one = await cell.begin("G1010 P0", "G1 X120 F3000", axes=[0])
    await cell.until(lambda: place(cell, 0) > 5.0)
    other = await cell.begin("G1010 P2", "G1 Z20 F12000", axes=[2])
    await cell.until(lambda: place(cell, 0) > 60.0)
    await switch(cell, on=True)
    await cell.until(lambda: one.state == "held")
    await rests(cell)
    assert other.state == "finished"
    assert place(cell, 0) < 79.0


async def test_motion_without_a_program_ends_before_the_zone(start: Start) -> None:
    cell = start(mill(CURTAIN), turn_s=0.002)
    assert (await cell.run("G1010", "G1020 X120")).state == "finished"
    await switch(cell, on=True)
    await rests(cell)
    assert place(cell, 0) < 79.0
    await switch(cell, on=False)
    await rests(cell)
    assert place(cell, 0) < 79.0


@pytest.mark.parametrize("debounce", ["", "debounce_ms = 5\n"])
async def test_an_input_that_flickers_every_cycle_holds_unless_it_is_debounced(
    start: Start, debounce: str
) -> None:
    changes = ", ".join(
        f"{{ at_s = {0.2 + 0.001 * n:.3f}, value = {str(n % 2 == 1).lower()} }}" for n in range(4000)
    )
    cell = start(
        mill(CURTAIN.replace("initial = true\n", f"initial = true\nsimulated = [{changes}]\n{debounce}"))
    )
    program = await cell.begin("G1010", "G1 X120 F6000")
    await cell.until(lambda: program.state in ("held", "finished"))
    assert program.state == ("finished" if debounce else "held")
    await rests(cell)
    if not debounce:
        assert place(cell, 0) < 79.0
        await cell.until(lambda: cell.executor.time > 4.5)
        cell.service.resume(program.program)
        assert (await cell.ended(program)).state == "finished"


async def test_a_slow_zone_that_is_switched_on_holds_what_is_too_fast(start: Start) -> None:
    slow = CURTAIN.replace('active = "low"', 'active = "low"\nkind = "slow"\nmax_speed_mm_s = 50.0')
    cell = start(mill(slow), turn_s=0.002)
    program = await cell.begin("G1010", "G1 X120 F3000", "G1 X0", "G1 X120 F6000")
    await switch(cell, on=True)
    await cell.until(lambda: program.state == "held")
    await rests(cell)
    assert (program.done, 0.0 < place(cell, 0) < 80.0) == (3, True)
    await switch(cell, on=False)
    cell.service.resume(program.program)
    assert (await cell.ended(program)).state == "finished"


@pytest.mark.parametrize("seed", range(2))
async def test_while_the_zone_is_on_no_body_that_was_outside_comes_in(start: Start, seed: int) -> None:
    draw = random.Random(seed)
    machine = mill(CURTAIN)
    cell = start(machine, turn_s=0.02)
    lines = ["G1010"]
    for _ in range(8):
        word = draw.choice(("G0", "G1 F9000", "G1 F3000"))
        lines.append(f"{word} X{draw.uniform(0.0, 130.0):.1f} Y{draw.uniform(-50.0, 50.0):.1f}")
    program = await cell.begin(*lines)
    scene = Scene(machine)
    while not program.ended:
        for _ in range(draw.randint(5, 30)):
            await asyncio.sleep(0)
        before = place(cell, 0)
        await switch(cell, on=True)
        await rests(cell)
        if before < 70.0:
            scene.place(cell.executor.feedback.setpoint)
            assert min(scene.distance(pair) for pair in range(len(scene.pairs))) >= 0.98e-3
        await switch(cell, on=False)
        if program.state == "held":
            cell.service.resume(program.program)
    assert program.state == "finished" or fault_of(program)[0] == "MC324"


def faults(lines: list[str], machine: Machine, **more: bool) -> list[tuple[str, str, int]]:
    found = simulate_lines(lambda: iter(["G1010", *lines]), machine, **more)  # type: ignore[arg-type]
    assert found.report["ok"]
    assert found.report["clearance"]["assumed_on"] == ["loading"]
    told = [(each["code"], each["severity"], each["line"]) for each in found.report["diagnostics"]]
    # an axis without its drive may run on into the zone as well
    return [each for each in told if each[0] != "MC325"]


@pytest.mark.parametrize("stops", [False, True])
def test_dry_runs_take_the_zone_to_be_on_and_say_where_the_program_would_be_held(stops: bool) -> None:
    machine = mill(CURTAIN)
    assert faults(["G1 X70 F6000"], machine, stops=stops) == []
    assert faults(["G1 X70 F6000", "G1 X120", "G1 X0"], machine, stops=stops) == [("MC321", "warning", 3)]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("input = 3", "input = 7", "zone[0].input: the machine has no digital input 7"),
        ('active = "low"\n', "", "zone[0].active: is missing"),
        ("input = 3\n", "", "zone[0].active: is not for a zone without input"),
        ('"low"', '"off"', "zone[0].active"),
        ("number = 3", 'number = 3\nkind = "analog"', "no digital input 3"),
    ],
)
def test_a_mistake_is_named_with_its_place(old: str, new: str, message: str) -> None:
    with pytest.raises(MachineFileRejected) as refused:
        mill(CURTAIN.replace(old, new, 1))
    assert message in str(refused.value)


async def test_a_thread_into_a_zone_that_an_input_switches_is_refused(start: Start) -> None:
    spindle = axes_text((3,), rotary=True, velocity=20000.0, acceleration=40000.0)
    cell = start(mill('[dialect]\nprofile = "cnc"\nspindle_axis = 3', spindle, CURTAIN), turn_s=0.002)
    program = await cell.begin("S600 M3", "G33 X70 K5", "G33 X120 K5")
    assert fault_of(await cell.ended(program)) == ("MC321", 3)
    assert place(cell, 0) == pytest.approx(70.0, abs=0.01)
