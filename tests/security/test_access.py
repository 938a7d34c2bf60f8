"""Access through a real router: each role's rights, and a server and its clients behind it."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import pytest
import zenoh

from mcserver.machine.machine_file import Machine as MachineFile
from mcserver.net.configuration import NetworkOptions
from mcserver.net.method_pages import roles_table
from mcserver.security.proof import passed_methods, prove
from mcserver.server import ServerOptions, running
from mcserver.service.service import MachineService
from tests.security.conftest import MACHINE, RunningSite
from tests.service.fakes import FakePipelines, FakePort, three_axes

LIMIT_S = 20.0


@asynccontextmanager
async def served(
    site: RunningSite, identity: str, folder: Path, name: str = MACHINE
) -> AsyncIterator[MachineService]:
    """A server with this identity's configuration, connected through the router."""
    machine: MachineFile = msgspec.structs.replace(three_axes(), name=name)
    port = FakePort(machine)
    options = ServerOptions(
        network=NetworkOptions(config_file=site.path(identity)), journal=folder / f"{name}.db"
    )
    async with running(machine, options, port, FakePipelines(port)) as (service, _):
        yield service


def test_every_identity_may_what_its_role_says_and_nothing_else(site: RunningSite) -> None:
    findings = list(prove(site.folder, site.site))
    assert [each for each in findings if not each.holds] == []
    # all roles have been tried, in both directions, and who has no certificate
    assert {each.who for each in findings if each.allowed} == {"alice", "bob", "eve", "bot"}
    assert {each.who for each in findings if not each.allowed} >= {
        "alice",
        "bob",
        "bot",
        "machine.bench",
        "anybody",
    }
    # what passed at the router, method by method, is the page's table
    assert roles_table(passed_methods(findings, site.site)) == roles_table()


async def test_a_program_runs_through_the_router_and_says_who_ran_it(
    site: RunningSite, tmp_path: Path
) -> None:
    from mcclient import Machine

    async with (
        asyncio.timeout(LIMIT_S),
        served(site, "machine.bench", tmp_path),
        Machine.connect(MACHINE, config_file=site.path("alice")) as machine,
    ):
        assert machine.client.startswith("alice.")
        events = machine.events(history=True)
        async with machine.program("demo") as program:
            assert await program.send_lines(["G90", "move", "move"]) == 3
        await machine.override(50.0)
        seen = []
        async for event in events:
            seen.append(event)
            if event.kind == "command":
                break
        assert seen[-1].client == machine.client
        opened = next(event for event in seen if event.kind == "program.opened")
        assert opened.client == machine.client


async def test_an_observer_cannot_make_a_client_believe_that_its_program_has_ended(
    site: RunningSite, tmp_path: Path
) -> None:
    from mcclient import Machine

    bob = site.session("bob")
    async with (
        asyncio.timeout(LIMIT_S),
        served(site, "machine.bench", tmp_path),
        Machine.connect(MACHINE, config_file=site.path("alice")) as machine,
    ):
        program = await machine.program("demo")
        forged = {"program": program.id, "accepted": 0, "done": 0, "credit": 0, "state": "finished"}
        bob.put(f"mc/@v1/{MACHINE}/ack/{program.id}", msgspec.msgpack.encode(forged))
        bob.liveliness().declare_token(f"mc/@v1/{MACHINE}/live/6740b2f8000001")
        await program.send("G90")
        assert program.state == "running"
        await program.abort()
        await program.leave()


async def test_an_observer_is_refused_what_would_move(site: RunningSite, tmp_path: Path) -> None:
    from mcclient import Machine, NobodyAnswers

    async with (
        asyncio.timeout(LIMIT_S),
        served(site, "machine.bench", tmp_path) as service,
        Machine.connect(MACHINE, config_file=site.path("bob")) as machine,
    ):
        assert (await machine.status()).state == "ready"
        with pytest.raises(NobodyAnswers) as refused:
            await machine._caller.call("abort", deadline_s=0.5)
        assert refused.value.code == "MC532"
        assert "access rules" in refused.value.hint
        await machine.estop("seen from afar")
        assert service.latch.state == "estop"


async def test_a_copied_machine_certificate_is_no_other_machine(site: RunningSite, tmp_path: Path) -> None:
    from mcclient import Machine, NobodyAnswers

    async with asyncio.timeout(LIMIT_S), served(site, "machine.bench", tmp_path, name="other"):
        with pytest.raises(NobodyAnswers):
            await Machine.connect("other", config_file=site.path("eve"), timeout_s=1.0)


def test_a_certificate_with_another_s_password_is_not_let_in(tmp_path: Path) -> None:
    site = RunningSite(tmp_path, passwords=True)
    try:
        alice = site.session("alice")
        assert list(alice.info.routers_zid())
        wrong = json.dumps({"user": "alice", "password": "guessed"})
        with pytest.raises(zenoh.ZError):
            site.session("alice", **{"transport/auth/usrpwd": wrong, "connect/timeout_ms": "1000"})
    finally:
        site.close()
