"""Finding machines, operating them, and what they tell."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import numpy as np
import pytest
from fake_server import FakeServer
from mcclient import (
    ConfigurationError,
    Machine,
    NoAnswerInTime,
    NobodyAnswers,
    SeveralMachines,
    emergency_stop,
    list_machines,
)

MakeServer = Callable[..., FakeServer]


async def test_the_only_machine_is_found_without_a_name(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        assert machine.name == "cell"
        assert machine.online
        assert [axis.unit for axis in machine.info.axes] == ["mm", "mm", "mm"]


async def test_several_machines_are_distinguished_by_name(make_server: MakeServer) -> None:
    server = make_server("one")
    server.declare_another("two")
    with pytest.raises(SeveralMachines) as caught:
        await Machine.connect(connect=server.endpoint)
    assert caught.value.details["machines"] == ["one", "two"]
    assert caught.value.exit_code == 2
    async with Machine.connect("one", server.endpoint) as machine:
        assert machine.name == "one"


async def test_of_many_machines_none_is_overlooked(make_server: MakeServer) -> None:
    server = make_server("m000")
    names = [f"m{number:03d}" for number in range(300)]
    for name in names[1:]:
        server.declare_another(name)
    for _ in range(3):
        with pytest.raises(SeveralMachines) as caught:
            await Machine.connect(connect=server.endpoint)
        assert caught.value.details["machines"] == names


async def test_all_machines_are_listed_those_that_do_not_answer_too(make_server: MakeServer) -> None:
    server = make_server("one")
    server.declare_another("two")
    found = dict(await list_machines(server.endpoint, timeout_s=0.3))
    assert found["one"].machine == "one"  # type: ignore[union-attr]
    assert isinstance(found["two"], NobodyAnswers)


async def test_no_server_is_reported_with_the_endpoint_and_a_remedy() -> None:
    with pytest.raises(NobodyAnswers, match=r"tcp/127\.0\.0\.1:9") as caught:
        await Machine.connect(connect="tcp/127.0.0.1:9", timeout_s=0.2)
    assert "mcserver run" in caught.value.hint


async def test_a_wrong_name_is_reported_with_those_that_are_there(server: FakeServer) -> None:
    with pytest.raises(NobodyAnswers, match="those that are: cell"):
        await Machine.connect("cel", server.endpoint, timeout_s=0.2)


async def test_what_cannot_be_an_endpoint_or_a_name_is_a_configuration_error() -> None:
    with pytest.raises(ConfigurationError):
        await Machine.connect(connect="nonsense")
    with pytest.raises(ConfigurationError):
        await Machine.connect("a/b")


async def test_endpoint_and_name_come_from_the_environment(
    server: FakeServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MC_CONNECT", server.endpoint)
    monkeypatch.setenv("MC_MACHINE", "cell")
    async with Machine.connect() as machine:
        assert machine.name == "cell"


async def test_the_operators_calls_reach_the_server(server: FakeServer) -> None:
    server.runs_by_itself = False
    async with Machine.connect(connect=server.endpoint) as machine:
        program = await machine.program()
        await program.send("G01 X1")
        assert await machine.hold() == (program.id,)
        assert server.programs[program.id].state == "held"
        await program.resume()
        assert server.programs[program.id].state == "running"
        assert (await machine.override(50.0)).percent == 50.0
        assert await machine.jog(1, 5.0, velocity=2.0) == "j2"
        await machine.reset()
        assert [one.program for one in await machine.programs()] == [program.id]
        assert (await machine.check("G01 X1", positions={0: 1.0})).ok
        assert (await machine.simulate("G01 X1")).duration_s == 1.0
        assert (await machine.status()).axes.position == (1.5, 1.5, 1.5)
        await program.abort()


async def test_telemetry_gives_states_as_they_come(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        feed = machine.telemetry()
        await machine.status()
        server.publish_state()
        server.publish_state()
        first, second = await anext(feed), await anext(feed)
        assert second.instance == first.instance == server.instance
        assert first.axes.velocity == (0.0, 0.0, 0.0)


async def test_samples_are_arrays_of_time_setpoint_and_encoder(server: FakeServer) -> None:
    rows = np.arange(2 * 3 * 4, dtype="<f4").reshape(2, 3, 4)
    async with Machine.connect(connect=server.endpoint) as machine:
        feed = machine.samples()
        await machine.status()
        server.publish_samples(rows.tobytes(), 2)
        server.publish_samples(b"not a whole row", 0)
        server.publish_samples(rows.tobytes(), 2)
        first, second = await anext(feed), await anext(feed)
    assert (first.seq, second.seq) == (0, 2)
    np.testing.assert_allclose(second.time_s, [0.002, 0.003])
    np.testing.assert_array_equal(first.setpoint, rows[:, :, 0])
    np.testing.assert_array_equal(first.actual, rows[:, :, 1])
    np.testing.assert_array_equal(first.velocity, rows[:, :, 2])
    np.testing.assert_array_equal(first.torque, rows[:, :, 3])


async def test_events_that_the_network_lost_are_asked_for_again(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        events = machine.events()
        await machine.status()
        server.publish_event("warning", message="0")
        server.lose["event"] = 3
        for number in range(1, 6):
            server.publish_event("warning", message=str(number))
        seen = [(await anext(events)).message for _ in range(6)]
    assert seen == ["0", "1", "2", "3", "4", "5"]
    assert events.missed == 0


async def test_events_begin_with_those_that_the_server_still_has(server: FakeServer) -> None:
    server.publish_event("warning", message="before")
    async with Machine.connect(connect=server.endpoint) as machine:
        events = machine.events(history=True)
        assert (await anext(events)).message == "before"
        server.publish_event("warning", message="after")
        assert (await anext(events)).message == "after"


async def test_events_go_on_with_the_beginning_of_a_new_start_of_the_server(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        events = machine.events()
        await machine.status()
        server.publish_event("warning", message="old")
        assert (await anext(events)).message == "old"
        await asyncio.to_thread(server.go_away)
        await asyncio.to_thread(server.come_back)
        server.publish_event("warning", message="new 0")
        await machine.status()
        server.publish_event("warning", message="new 1")
        assert [(await anext(events)).message for _ in range(2)] == ["new 0", "new 1"]


async def test_a_feed_ends_when_the_machine_is_closed(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        feed = machine.telemetry()
        reading = asyncio.create_task(_count(feed))
    assert await reading == 0


async def _count(feed: object) -> int:
    return len([item async for item in feed])  # type: ignore[attr-defined]


async def test_the_emergency_stop_is_repeated_until_it_is_confirmed(server: FakeServer) -> None:
    assert await emergency_stop(connect=(server.endpoint,), reason="a hand") == "cell"
    assert server.estops >= 2
    assert server.state == "estop"


async def test_an_emergency_stop_without_confirmation_is_an_error(server: FakeServer) -> None:
    server.confirm_estop = False
    async with Machine.connect(connect=server.endpoint) as machine:
        with pytest.raises(NoAnswerInTime, match="has not confirmed"):
            await machine.estop(timeout_s=1.0)
    assert server.estops > 1
