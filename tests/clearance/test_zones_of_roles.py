"""Zones that bind a role: in simulations for it, and in its runs."""

from __future__ import annotations

from typing import Any

import pytest

from mcserver.machine.section_reader import MachineFileRejected
from mcserver.planning.start_state import StartState
from mcserver.simulation.preview import preview
from mcserver.simulation.simulation import simulate_lines
from tests.clearance.cells import Start, fault_of, place
from tests.clearance.machines import VISE, mill
from tests.house.test_layers import imports, package_at, sources
from tests.service.virtual_cell import VirtualCell

# the zone begins at X85, the tool has a radius of 5 mm, the margin is 1 mm
GLASS = """
[[zone]]
name = "glass"
roles = ["agent"]
size_mm = [100.0, 400.0, 400.0]
at_mm = [135.0, 0.0, 100.0]
"""
SLOW = GLASS.replace("size_mm", 'kind = "slow"\nmax_speed_mm_s = 50.0\nsize_mm')
INTO = ["G1010", "G1 X120 F6000", "G0 X0"]


def codes(zone: str, role: str | None, *, stops: bool = False) -> list[tuple[str, int]]:
    found = simulate_lines(lambda: iter(INTO), mill(zone), role=role, stops=stops)
    return [(each["code"], each["line"]) for each in found.report["diagnostics"]]


@pytest.mark.parametrize("stops", [False, True])
@pytest.mark.parametrize(("zone", "code"), [(GLASS, "MC321"), (SLOW, "MC322")])
def test_a_simulation_counts_the_zones_of_its_role(zone: str, code: str, stops: bool) -> None:
    assert codes(zone, "operator", stops=stops) == []
    assert codes(zone, "agent", stops=stops) == [(code, 2)]
    # of whom nothing is said may be an agent's
    assert codes(zone, None, stops=stops) == [(code, 2)]
    others = zone.replace('"agent"', '"operator"')
    assert codes(others, "operator", stops=stops) == [(code, 2)]
    assert codes(others, "agent", stops=stops) == []


def test_what_a_person_is_to_approve_is_simulated_as_an_agents() -> None:
    machine = mill(GLASS)
    seen = preview("\n".join(INTO), machine, StartState.of(machine), (0,))
    assert [each["code"] for each in seen.report["diagnostics"]] == ["MC321"]
    assert seen.envelope is None


# what the doors take of the service: words, hashes and types, and nothing that moves an axis
WORDS = {"reports", "arming", "approval_basis"}
DOORS = ("web", "gateway", "opcua", "mqtt", "mtconnect", "ros", "language", "foxglove", "doors")


def test_every_door_moves_axes_by_the_methods_of_the_wire_which_know_one_role_of_a_run() -> None:
    # a run is an agent's where it was armed, whichever door it was asked for at (`ProgramTable`)
    asked = {
        (file.name, module)
        for file in sources()
        if package_at(file) in DOORS
        for _, module in imports(file)
        if module.startswith(("mcserver.service", "mcserver.executor.client", "mcserver.planning.process"))
    }
    assert {module for _, module in asked} <= {f"mcserver.service.{word}" for word in WORDS}
    telling = [
        file.name
        for file in sources()
        if "AGENT if" in file.read_text("utf-8") or "else AGENT" in file.read_text("utf-8")
    ]
    assert telling == ["program_table.py"]


AGENT = "planner.mcp-1"


def within(cell: VirtualCell) -> Any:
    """An envelope of a run that stays out of the zone."""
    machine = cell.service.machine
    seen = preview("G1010\nG1 X200 F6000\nG0 X0\n", mill(VISE), StartState.of(machine), (0, 1, 2))
    return seen.envelope


async def test_the_zone_of_agents_binds_a_run_that_was_approved_and_no_other(start: Start) -> None:
    cell = start(mill(GLASS))
    program = await cell.run(*INTO, client=AGENT, envelope=within(cell))
    assert fault_of(program) == ("MC321", 2)
    assert place(cell, 0) == pytest.approx(79.0, abs=0.3)

    async def jog(distance: float) -> str:
        return (await cell.ended(await cell.jog(0, distance))).state

    assert await jog(-place(cell, 0)) == "finished"
    # who goes on with it has the same envelope, and so the same zones
    again = await cell.service.continue_program("alice.page", program.program, 2)
    assert fault_of(await cell.ended(again)) == ("MC321", 2)
    assert (await cell.run(*INTO, client=AGENT)).state == "finished"
    assert await jog(100.0) == "finished"


async def test_the_zone_of_operators_binds_jogs_and_no_approved_run(start: Start) -> None:
    cell = start(mill(GLASS.replace("agent", "operator")))
    assert (await cell.run(*INTO, client=AGENT, envelope=within(cell))).state == "finished"
    assert fault_of(await cell.ended(await cell.jog(0, 100.0)))[0] == "MC321"


@pytest.mark.parametrize(
    ("role", "message"),
    [
        ("agents", "zone[0].roles: there is no role 'agents' to bind (did you mean 'agent'?)"),
        ("engineer", "cannot tell engineers from operators"),
        ("root", 'take "agent"'),
    ],
)
def test_a_role_that_is_not_there_is_refused(role: str, message: str) -> None:
    with pytest.raises(MachineFileRejected) as refused:
        mill(GLASS.replace("agent", role))
    assert message in str(refused.value)


ONE = GLASS.replace('"agent"', '"agent:planner"')


@pytest.mark.parametrize(
    ("client", "bound"),
    [
        ("planner.mcp-1", True),
        # whatever stands behind the dot is the user's own to choose
        ("planner.another-name", True),
        ("planner2.mcp-1", False),
        ("Planner.mcp-1", False),
        # whoever has no user may be any of them
        ("planner", True),
        ("gw-planner-0a1b2c", True),
        ("mcp-1", True),
    ],
)
async def test_the_zone_of_one_agent_binds_the_runs_that_it_asks_for(
    start: Start, client: str, bound: bool
) -> None:
    cell = start(mill(ONE))
    program = await cell.run(*INTO, client=client, envelope=within(cell))
    assert program.state == ("faulted" if bound else "finished")
    if bound:
        assert fault_of(program) == ("MC321", 2)


async def test_who_goes_on_with_an_agents_run_is_bound_as_any_agent(start: Start) -> None:
    cell = start(mill(ONE))
    program = await cell.run(*INTO, client=AGENT, envelope=within(cell))
    assert (await cell.ended(await cell.jog(0, -place(cell, 0)))).state == "finished"
    again = await cell.service.continue_program("alice.page", program.program, 2)
    assert fault_of(await cell.ended(again)) == ("MC321", 2)
    assert (await cell.run(*INTO, client=AGENT)).state == "finished"


def test_a_simulation_counts_the_zones_of_all_agents_it_may_be_for() -> None:
    assert codes(ONE, "operator") == []
    assert codes(ONE, "agent:other") == []
    for role in ("agent", "agent:planner", None):
        assert codes(ONE, role) == [("MC321", 2)]


@pytest.mark.parametrize("role", ["agent:", "agent:planner.mcp", "agent:*", "operator:alice", ":planner"])
def test_a_name_that_no_user_can_have_is_refused(role: str) -> None:
    with pytest.raises(MachineFileRejected, match="there is no role"):
        mill(GLASS.replace("agent", role))
