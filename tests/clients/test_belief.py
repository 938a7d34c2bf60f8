"""Only the server is believed: whatever another session publishes or answers changes nothing."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import pytest
import zenoh
from fake_server import FakeServer
from mcclient import Machine
from mcclient.presence import Presence
from mcclient.transport import Arrived

from tests.zenoh_sessions import opened


@pytest.fixture
def stranger(server: FakeServer) -> Iterator[zenoh.Session]:
    ends = {"mode": "client", "connect/endpoints": [server.endpoint]}
    session = opened({**ends, "timestamping/enabled": True})
    yield session
    session.close()  # type: ignore[no-untyped-call]


async def test_a_forged_acknowledgement_ends_no_program(server: FakeServer, stranger: zenoh.Session) -> None:
    server.runs_by_itself = False
    async with Machine.connect(connect=server.endpoint) as machine:
        program = await machine.program("job")
        line = await program.send("G01 X1")
        forged = {"program": program.id, "accepted": 1, "done": 1, "credit": 9, "state": "finished"}
        for _ in range(3):
            stranger.put(f"mc/@v1/cell/ack/{program.id}", msgspec.msgpack.encode(forged))
        # a message of the server's that is behind the forged ones
        server.publish_event("warning", message="after")
        assert (await machine.status()).state == "ready"
        assert (program.state, program.done_through) == ("running", 0)
        server.run_lines(program.id)
        await line.done()
        await program.abort()


async def test_a_second_queryable_answers_for_nobody(server: FakeServer, stranger: zenoh.Session) -> None:
    def lie(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, msgspec.msgpack.encode({"programs": [], "state": "lie"}))

    stranger.declare_queryable(
        "mc/@v1/cell/@rpc/*/*", zenoh.handlers.Callback(lie, indirect=False), complete=True
    )
    async with Machine.connect(connect=server.endpoint) as machine:
        for _ in range(5):
            assert (await machine.status()).state == "ready"


async def test_forged_states_are_not_shown(server: FakeServer, stranger: zenoh.Session) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        feed = machine.telemetry()
        await machine.status()
        forged = {"t": 1.0, "wall": 1.0, "instance": server.instance, "state": "estop", "axes": {}}
        stranger.put("mc/@v1/cell/tele/state", msgspec.msgpack.encode(forged))
        await machine.status()
        server.publish_state()
        assert (await anext(feed)).state == "ready"


def token(session: str, *, gone: bool = False) -> Arrived:
    return Arrived(f"mc/@v1/cell/live/start-of-{session}.{session}", b"", gone)


def test_the_server_that_was_there_first_is_believed_until_it_goes() -> None:
    presence = Presence("cell")
    returned: list[str] = []
    presence.on_return(returned.append)
    assert not presence.is_server("a")
    presence.on_token(token("a"))
    presence.on_token(token("b"))
    assert presence.is_server("a")
    assert not presence.is_server("b")
    assert not presence.is_server(None)
    presence.on_token(token("a", gone=True))
    assert presence.is_server("b")
    assert returned == ["start-of-a", "start-of-b"]
