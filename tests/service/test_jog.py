"""Jogs through the service, on a virtual executor: their coordinates, their order, and who has the axis."""

from __future__ import annotations

import pytest

from mcserver.errors import Refused
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.service.program_options import ProgramOptions
from tests.machine_text import axes_text
from tests.service.virtual_cell import VirtualCell

MM = 1e-3


def machine() -> Machine:
    axes = axes_text(range(3), keys="min_position = -10.0\nmax_position = 500.0\nmax_following_error = 1.0")
    cutter = "[[cutter]]\nnumber = 1\nlength_mm = 80.0\n"
    return parse_machine(f'[machine]\nname = "mill"\n{axes}[dialect]\nprofile = "cnc"\n{cutter}')


async def jog(
    cell: VirtualCell,
    axis: int,
    distance: float | None = None,
    *,
    velocity: float = 200.0,
    client: str = "page",
    by: str = "",
) -> str:
    hold_s = 10.0 if distance is None else None
    return await cell.jogging.jog(
        client, axis, by=by, distance=distance, velocity=velocity, hold_s=hold_s, program_id=None
    )


@pytest.mark.parametrize(("velocity", "end"), [(200.0, 500.0), (-200.0, -10.0)])
async def test_a_held_jog_goes_to_the_axis_s_own_limit_with_a_work_zero_set(
    cell: VirtualCell, velocity: float, end: float
) -> None:
    assert (await cell.run("G10 L2 P1 X15", axes=[0])).state == "finished"
    program = await cell.ended(cell.service.program(await jog(cell, 0, velocity=velocity)))
    assert (program.state, program.diagnostics) == ("finished", [])
    assert cell.position(0) == pytest.approx(end * MM, abs=1e-6)


async def test_a_jog_leaves_work_zeros_and_units_as_they_are(cell: VirtualCell) -> None:
    await cell.run("G20 G10 L2 P1 X1", axes=[0])
    await cell.ended(cell.service.program(await jog(cell, 0, 20.0)))
    assert cell.position(0) == pytest.approx(20 * MM, abs=1e-6)
    assert cell.service.work_tables.systems == {1: {0: pytest.approx(25.4 * MM)}}


async def test_steps_of_one_person_follow_each_other(cell: VirtualCell) -> None:
    names = [await jog(cell, 0, 10.0) for _ in range(3)]
    for name in names:
        assert (await cell.ended(cell.service.program(name))).state == "finished"
    assert cell.position(0) == pytest.approx(30 * MM, abs=1e-6)


async def test_steps_that_wait_are_bounded(cell: VirtualCell) -> None:
    # held, it is still under way however long the journal takes
    cell.service.hold(await jog(cell, 0, 50.0, velocity=0.1))
    for _ in range(7):
        await jog(cell, 0, 1.0, velocity=0.1)
    with pytest.raises(Refused, match="MC508"):
        await jog(cell, 0, 1.0, velocity=0.1)
    cell.service.abort(None)


async def test_steps_behind_one_that_was_stopped_do_not_run(cell: VirtualCell) -> None:
    first, second = await jog(cell, 0, 100.0, velocity=10.0), await jog(cell, 0, 1.0)
    await cell.until(lambda: cell.position(0) > 0.0)
    cell.service.abort(first)
    await cell.ended(cell.service.program(first))
    stopped = cell.service.program(second)
    assert (stopped.state, stopped.reason) == ("aborted", "the step before it was broken off")


async def test_another_person_is_told_who_jogs_the_axis(cell: VirtualCell) -> None:
    await jog(cell, 0, 100.0, velocity=10.0, by="ada")
    for distance in (1.0, None):
        with pytest.raises(Refused) as refused:
            await jog(cell, 0, distance, by="bob")
        assert refused.value.code == "MC512"
        assert "jog axis 0 by ada (running) of page" in refused.value.message
    await jog(cell, 1, 1.0, by="bob")


async def test_a_jog_of_an_axis_that_a_program_moves_names_the_program(cell: VirtualCell) -> None:
    program = await cell.service.open("cam", ProgramOptions(name="part.nc", axes=[0]))
    with pytest.raises(Refused) as refused:
        await jog(cell, 0, 1.0)
    assert "part.nc (running) of cam" in refused.value.message
    assert refused.value.details == {"program": program.program, "client": "cam", "name": "part.nc"}


async def test_a_jog_has_its_own_speed_whatever_the_override_is(cell: VirtualCell) -> None:
    cell.service.set_override(2.0, None)
    name = await jog(cell, 0, 20.0, velocity=20.0)
    program, fastest = cell.service.program(name), 0.0
    cell.service.set_override(0.5, None)

    def done() -> bool:
        nonlocal fastest
        fastest = max(fastest, abs(cell.service.port.snapshot().velocity[0]))
        return program.ended

    await cell.until(done)
    assert fastest == pytest.approx(20 * MM, rel=0.01)
    assert cell.service.override == 0.5


async def test_an_override_ends_with_the_last_program_that_it_was_set_for(cell: VirtualCell) -> None:
    first = await cell.service.open("cam", ProgramOptions(axes=[0]))
    second = await cell.service.open("cam", ProgramOptions(axes=[1]))
    cell.service.set_override(2.0, None)
    for program, move in ((first, "G1 X1 F6000"), (second, "G1 Y1 F6000")):
        assert cell.service.override == 2.0
        cell.service.lines.submit("cam", program.program, 1, [move])
        cell.service.lines.close("cam", program.program)
        await cell.ended(program)
    assert cell.service.override == 1.0
    (event,) = [each for each in cell.events if each.kind == "override" and each.message]
    assert (event.percent, event.message) == (100.0, "it ends with the program")


async def test_an_override_ends_with_an_emergency_stop_and_a_reset(cell: VirtualCell) -> None:
    cell.service.set_override(2.0, None)
    cell.service.latch.emergency_stop("ada", "")
    cell.service.reset(None)
    assert cell.service.override == 1.0


async def test_an_override_set_ahead_is_kept_until_something_has_moved(cell: VirtualCell) -> None:
    cell.service.set_override(0.25, None)
    await cell.run("G10 L2 P1 X15", axes=[0])
    assert cell.service.override == 0.25


async def test_two_programs_that_set_zeros_side_by_side_keep_both(cell: VirtualCell) -> None:
    service = cell.service
    programs = []
    for axis, word in enumerate("XY"):
        program = await service.open("test", ProgramOptions(axes=[axis]))
        lines = [f"G10 L2 P1 {word}{number}" for number in range(1, 6)]
        await service.lines.submit("test", program.program, 1, lines, judge=False)
        programs.append(program)
    for program in programs:
        service.lines.close("test", program.program)
        assert (await cell.ended(program)).state == "finished"
    assert service.work_tables.systems == {1: {0: pytest.approx(0.005), 1: pytest.approx(0.005)}}
