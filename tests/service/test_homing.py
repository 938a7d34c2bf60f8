"""Homing, references and jogs of unhomed axes through the service, on a virtual executor."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.service.program_options import ProgramOptions
from tests.machine_text import axes_text
from tests.service.virtual_cell import VirtualCell, refused

MM = 1e-3
SWITCH = 'method = "switch"\nvelocity = 50.0\nlatch_velocity = 5.0\n'


def machine(initial: float = 20.0) -> Machine:
    homings = [
        f"{SWITCH}position = -1.0\nthen_move_to = 5.0\norder = 1",
        SWITCH,
        'method = "manual"',
        'method = "absolute"',
        "",
    ]
    text = '[machine]\nname = "cell"\n'
    for index, homing in enumerate(homings):
        keys = "min_position = -50.0\nmax_position = 50.0\nmax_following_error = 1.0\n"
        keys += f"[axis.homing]\n{homing}" if homing else ""
        switch = f"initial_position = {initial}\nhome_switch = [-1000.0, -10.0]"
        text += axes_text([index], keys=keys, drive="simulated", drive_keys=switch)
    return parse_machine(text)


async def test_home_finds_every_axis_that_can_the_lowest_order_first(cell: VirtualCell) -> None:
    assert cell.homed() == [False, False, False, False, True]
    program = await cell.ended(await cell.homing.home("test", None))
    assert program.state == "finished"
    assert program.axes == (0, 1)
    assert cell.homed() == [True, True, False, False, True]
    assert [event.axis for event in cell.events if event.kind == "axis.homed"] == [1, 0]
    assert cell.position(0) == pytest.approx(5 * MM, abs=1e-6)


async def test_a_program_is_refused_until_the_axis_is_homed_and_runs_then(cell: VirtualCell) -> None:
    line = ["G1010 P1", "G01 Y30 F6000"]
    before = await cell.run(*line, axes=[1])
    assert before.state == "faulted"
    assert before.fault is not None
    assert before.fault.code == "MC450"
    assert "mcctl home" in before.fault.hint
    assert cell.position(1) == pytest.approx(20 * MM, abs=1e-9)
    cell.service.reset(None)
    await cell.ended(await cell.homing.home("test", [1]))
    assert (await cell.run(*line, axes=[1])).state == "finished"
    assert cell.position(1) == pytest.approx(30 * MM, abs=1e-5)


async def test_limits_count_from_the_reference_on(cell: VirtualCell) -> None:
    await cell.ended(await cell.homing.home("test", [1]))
    beyond = await cell.run("G1010 P1", "G01 Y60 F6000", axes=[1])
    assert beyond.state == "rejected"
    assert [each.code for each in beyond.diagnostics] == ["MC201"]


async def test_an_unhomed_axis_is_jogged_slowly_and_past_its_limits(cell: VirtualCell) -> None:
    program = await cell.jog(1, 200.0, 200.0)
    fastest = 0.0

    def done() -> bool:
        nonlocal fastest
        fastest = max(fastest, abs(float(cell.service.port.snapshot().velocity[1])))
        return program.ended

    await cell.until(done)
    assert program.state == "finished"
    assert cell.position(1) == pytest.approx(220 * MM, abs=1e-5)
    assert fastest == pytest.approx(50 * MM, rel=0.02)


async def test_a_homed_axis_is_jogged_within_its_limits(cell: VirtualCell) -> None:
    await cell.ended(await cell.homing.home("test", [1]))
    await cell.ended(await cell.jog(1, None))
    assert cell.position(1) == pytest.approx(50 * MM, abs=1e-5)


async def test_a_reference_says_where_an_axis_is(cell: VirtualCell) -> None:
    program = await cell.homing.reference("test", {2: -7.5 * MM, 3: 1.0 * MM})
    assert program.state == "finished"
    assert cell.position(2) == pytest.approx(-7.5 * MM)
    assert cell.homed() == [False, False, True, True, True]
    moved = await cell.run("G1010 P2", "G01 Z0 F6000", axes=[2])
    assert moved.state == "finished"
    assert cell.position(2) == pytest.approx(0.0, abs=1e-6)


async def test_a_program_sees_a_reference_given_before_it(cell: VirtualCell) -> None:
    await cell.homing.reference("test", {2: 0.0})
    await cell.run("G1010 P2", "G91 G01 Z10 F6000", axes=[2])
    assert cell.position(2) == pytest.approx(10 * MM, abs=1e-6)


async def test_what_cannot_be_homed_or_referred_is_refused(cell: VirtualCell) -> None:
    assert await refused(cell, lambda each: each.homing.home("test", [2])) == "MC455"
    assert await refused(cell, lambda each: each.homing.home("test", [4])) == "MC455"
    assert await refused(cell, lambda each: each.homing.home("test", [9])) == "MC507"
    assert await refused(cell, lambda each: each.homing.reference("test", {4: 0.0})) == "MC455"
    assert await refused(cell, lambda each: each.homing.reference("test", {2: 0.0, 1: 0.0})) == "MC596"
    assert cell.homed() == [False, False, False, False, True]
    assert await refused(cell, lambda each: each.homing.reference("test", {9: 0.0})) == "MC507"
    assert await refused(cell, lambda each: each.homing.reference("test", {})) == "MC511"
    assert await refused(cell, lambda each: each.homing.reference("test", {2: float("nan")})) == "MC511"


async def test_an_axis_in_use_is_neither_homed_nor_referred(cell: VirtualCell) -> None:
    await cell.service.open("other", ProgramOptions(axes=[1, 2]))
    assert await refused(cell, lambda each: each.homing.home("test", [1])) == "MC512"
    assert await refused(cell, lambda each: each.homing.reference("test", {2: 0.0})) == "MC512"


async def test_a_client_that_is_gone_stops_its_homing(cell: VirtualCell) -> None:
    program = await cell.homing.home("test", [1])
    await cell.until(lambda: any(event.kind == "axis.homing" for event in cell.events))
    cell.service.absences.gone("test")
    await cell.ended(program)
    assert program.state == "aborted"
    assert cell.homed()[1] is False


async def test_references_survive_a_restart(tmp_path: Path) -> None:
    first = VirtualCell(machine(initial=20.0), tmp_path)
    await first.homing.reference("test", {2: 5 * MM, 3: 6 * MM})
    await first.ended(await first.homing.home("test", [1]))
    await first.stop()
    # the drives have not moved, and count as before
    second = VirtualCell(machine(initial=20.0), tmp_path)
    assert second.homed() == [False, False, True, True, True]
    assert second.position(2) == pytest.approx(5 * MM)
    await second.stop()
    # they count from another place: that of the absolute encoder is true, the other one is not known
    third = VirtualCell(machine(initial=0.0), tmp_path)
    assert third.homed() == [False, False, False, True, True]
    assert third.position(3) == pytest.approx(-14 * MM)
    (warning,) = [event for event in third.events if event.kind == "warning"]
    assert (warning.reason, warning.axis) == ("MC459", 2)
    assert "does not read what it did" in warning.message
    await third.stop()


async def test_after_a_kill_only_absolute_encoders_are_homed(tmp_path: Path) -> None:
    first = VirtualCell(machine(), tmp_path)
    await first.homing.reference("test", {2: 5 * MM, 3: 6 * MM})
    await first.run("G1010 P2", "G01 Z6 F6000", axes=[2])
    first.kill()
    second = VirtualCell(machine(), tmp_path)
    assert second.homed() == [False, False, False, True, True]
    (warning,) = [event for event in second.events if event.kind == "warning"]
    assert "ended without noting where it stands" in warning.message
    await second.stop()


async def test_a_damaged_file_is_said_and_its_axes_are_not_homed(tmp_path: Path) -> None:
    first = VirtualCell(machine(), tmp_path)
    await first.homing.reference("test", {3: 6 * MM})
    await first.stop()
    (tmp_path / "journal.db.references.json").write_bytes(b"\x00\xff")
    second = VirtualCell(machine(), tmp_path)
    assert second.homed()[3] is False
    assert [event.reason for event in second.events if event.kind == "warning"] == ["MC459"]
    await second.stop()
