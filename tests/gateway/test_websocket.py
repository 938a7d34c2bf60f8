"""The WebSocket of the gateway, as a client of another make sees it."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
import websockets
from websockets.asyncio.client import ClientConnection, connect

from tests.gateway.conftest import GatewayProcess

Tokens = tuple[Path, dict[str, str]]
LIMIT_S = 60.0


class Client:
    """Frames by hand."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.messages: list[dict[str, Any]] = []
        self._numbers = itertools.count(1)

    async def receive(self) -> dict[str, Any]:
        frame = await asyncio.wait_for(self.socket.recv(), LIMIT_S)
        assert isinstance(frame, bytes)
        unpacked: dict[str, Any] = msgpack.unpackb(frame)
        return unpacked

    async def ask(self, op: str, **fields: Any) -> dict[str, Any]:
        """The reply to a frame; messages that come meanwhile are kept."""
        number = next(self._numbers)
        await self.socket.send(msgpack.packb({"op": op, "id": number, **fields}))
        while True:
            frame = await self.receive()
            if frame["op"] == "reply" and frame["id"] == number:
                return frame
            self.messages.append(frame)

    async def call(self, method: str, **params: Any) -> Any:
        reply = await self.ask("call", machine="cell", method=method, params=params)
        assert reply["ok"], reply["error"]
        return reply["value"]

    async def put_targets(self, program: str, message: Any) -> None:
        """A frame without an answer."""
        frame = {"op": "targets", "machine": "cell", "program": program, "message": message}
        await self.socket.send(msgpack.packb(frame))

    async def message(self, wanted: Any) -> Any:
        """The first message of a subscription that fits."""
        while True:
            for frame in self.messages:
                if frame["op"] == "message" and wanted(frame["message"]):
                    self.messages.remove(frame)
                    return frame["message"]
            self.messages.append(await self.receive())


def opening(gateway: GatewayProcess, token: str, query: str = "", **options: Any) -> connect:
    return connect(
        gateway.ws + query,
        subprotocols=["mc.v1", f"mc.token.{token}"],
        max_size=None,
        **options,  # type: ignore[list-item]
    )


@pytest.fixture
async def client(gateway: GatewayProcess, tokens: Tokens) -> AsyncIterator[Client]:
    async with opening(gateway, tokens[1]["operator"]) as socket:
        made = Client(socket)
        hello = await made.receive()
        assert (hello["op"], hello["role"], hello["resumed"]) == ("hello", "operator", False)
        yield made


async def test_machines_are_listed_and_methods_called(client: Client) -> None:
    assert (await client.ask("machines"))["value"] == ["cell"]
    info = await client.call("info")
    assert [axis["unit"] for axis in info["axes"]] == ["mm"] * 3


async def test_a_program_runs_and_its_acknowledgements_come(client: Client) -> None:
    program = (await client.call("open"))["program"]
    await client.ask("subscribe", machine="cell", topic=f"ack/{program}")
    lines = ["G1010", "G01 X20 F6000", "G01 X0"]
    assert (await client.call("submit", program=program, first=1, lines=lines))["accepted"] == 3
    assert (await client.call("submit", program=program, first=1, lines=lines))["accepted"] == 3
    await client.call("close", program=program, last=3)
    ended = await client.message(lambda ack: ack["state"] == "finished")
    assert ended["done"] == 3


async def test_telemetry_comes_as_it_is_on_the_key_space(client: Client) -> None:
    await client.ask("subscribe", machine="cell", topic="state")
    state = await client.message(lambda message: isinstance(message, dict) and "axes" in message)
    assert state["axes"]["index"] == [0, 1, 2]
    await client.ask("subscribe", machine="cell", topic="samples")
    seq, _, rows = await client.message(lambda message: isinstance(message, list))
    assert seq >= 0
    assert len(rows) % (4 * 3 * 4) == 0


async def test_an_emergency_stop_is_confirmed(client: Client) -> None:
    assert (await client.ask("estop", machine="cell", reason="test"))["ok"]
    assert (await client.call("status"))["state"] == "estop"
    await client.call("reset")


async def test_a_connection_that_breaks_is_taken_up_with_its_program(
    gateway: GatewayProcess, tokens: Tokens
) -> None:
    async with opening(gateway, tokens[1]["operator"]) as socket:
        first = Client(socket)
        hello = await first.receive()
        program = (await first.call("open"))["program"]
        await first.call("submit", program=program, first=1, lines=["G1010", "G04 P0.1"])
        socket.transport.abort()
    async with opening(gateway, tokens[1]["operator"], f"?session={hello['session']}") as socket:
        again = Client(socket)
        second = await again.receive()
        assert (second["resumed"], second["client"]) == (True, hello["client"])
        reply = await again.call("submit", program=program, first=2, lines=["G04 P0.1", "G04 P0.1"])
        assert reply["accepted"] == 3
        await again.call("abort", program=program)


async def test_a_session_is_not_taken_up_with_another_token(gateway: GatewayProcess, tokens: Tokens) -> None:
    async with opening(gateway, tokens[1]["operator"]) as socket:
        hello = await Client(socket).receive()
        async with opening(gateway, tokens[1]["engineer"], f"?session={hello['session']}") as other:
            second = await Client(other).receive()
            assert not second["resumed"]
            assert second["client"] != hello["client"]


@pytest.mark.parametrize("token", ["", "wrong"])
async def test_without_a_token_there_is_no_connection(gateway: GatewayProcess, token: str) -> None:
    with pytest.raises(websockets.InvalidStatus):
        async with opening(gateway, token):
            pass


async def test_a_page_of_another_origin_is_refused_and_one_that_is_named_is_not(
    gateway: GatewayProcess, tokens: Tokens
) -> None:
    with pytest.raises(websockets.InvalidStatus):
        async with opening(gateway, tokens[1]["operator"], origin="https://evil.example"):
            pass
    async with opening(gateway, tokens[1]["operator"], origin="https://panel.example") as socket:
        assert (await Client(socket).receive())["op"] == "hello"


@pytest.mark.parametrize(
    "frame",
    [b"\xc1", b"\x81\xa2op\xa2\xff\xfe", b"\x81\xa1a" * 3000 + b"\xc0", msgpack.packb({"op": "fly"}), "text"],
)
async def test_what_is_no_frame_ends_its_own_connection_alone(
    gateway: GatewayProcess, tokens: Tokens, client: Client, frame: bytes | str
) -> None:
    async with opening(gateway, tokens[1]["operator"]) as socket:
        await socket.recv()
        await socket.send(frame)
        with pytest.raises(websockets.ConnectionClosed) as closed:
            await asyncio.wait_for(socket.recv(), LIMIT_S)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 4000
    assert (await client.ask("machines"))["ok"]


async def test_a_flood_of_calls_is_refused_and_delays_nobody_else(
    gateway: GatewayProcess, tokens: Tokens, client: Client
) -> None:
    async with opening(gateway, tokens[1]["operator"]) as socket:
        await socket.recv()
        codes = set()

        async def read() -> None:
            for _ in range(2000):
                reply = msgpack.unpackb(await asyncio.wait_for(socket.recv(), LIMIT_S))
                codes.add("ok" if reply["ok"] else reply["error"]["code"])

        reading = asyncio.ensure_future(read())
        for number in range(2000):
            frame = {"op": "call", "id": number, "machine": "cell", "method": "status"}
            await socket.send(msgpack.packb(frame))
        await reading
        assert codes == {"ok", "MC071"}
    assert (await client.ask("machines"))["ok"]


async def test_a_reader_that_stalls_costs_itself_alone(
    gateway: GatewayProcess, tokens: Tokens, client: Client
) -> None:
    async with opening(gateway, tokens[1]["observer"], max_queue=1) as socket:
        await socket.recv()
        for number, topic in enumerate(("samples", "state", "events")):
            await socket.send(
                msgpack.packb({"op": "subscribe", "id": number, "machine": "cell", "topic": topic})
            )
        for _ in range(50):
            assert (await client.call("status"))["state"] == "ready"


async def test_targets_are_streamed_at_100_hz_and_followed(client: Client) -> None:
    opened = await client.call("open_servo", axes=[0, 2])
    program = opened["program"]
    await client.ask("subscribe", machine="cell", topic=f"ack/{program}")
    # a link that is full drops targets, which is counted with the next one that comes
    seq, taken, lost = 0, 0, 0
    async with asyncio.timeout(60.0):
        while taken < 40 or taken + lost < seq:
            seq += 1
            step = min(seq, 40)
            now = asyncio.get_running_loop().time()
            message = [seq, now, 5.0, [[0.1 * step, -0.05 * step]], None, None]
            await client.put_targets(program, message)
            await asyncio.sleep(0.01)
            if step == 40:
                (found,) = (await client.call("programs", program=program))["programs"]
                taken, lost = found["servo"]["taken"], found["servo"]["lost"]
    assert taken + lost == seq
    await client.call("close", program=program)
    await client.message(lambda ack: ack["state"] == "finished")
    axes = (await client.call("status"))["axes"]
    assert [axes["setpoint"][index] for index in (0, 2)] == pytest.approx([4.0, -2.0])


async def test_targets_that_are_none_or_of_no_program_move_nothing(
    client: Client,
) -> None:
    opened = await client.call("open_servo", axes=[1])
    before = (await client.call("status"))["axes"]["setpoint"][1]
    for program, message in (
        (opened["program"], {"no": "targets"}),
        (opened["program"], [1, 0.0, 1.0, [[50.0, 50.0]], None, None]),
        ("no-such-program", [1, 0.0, 1.0, [[50.0]], None, None]),
        ("*", [1, 0.0, 1.0, [[50.0]], None, None]),
    ):
        await client.put_targets(program, message)
    await client.socket.send(
        msgpack.packb({"op": "targets", "machine": "nowhere", "program": "p", "message": [1]})
    )
    await client.ask("subscribe", machine="cell", topic=f"ack/{opened['program']}")
    await client.call("close", program=opened["program"])
    # the axis is free for the next one
    await client.message(lambda ack: ack["state"] == "finished")
    assert (await client.call("status"))["axes"]["setpoint"][1] == before


async def test_a_flood_of_targets_keeps_no_call_out(client: Client) -> None:
    opened = await client.call("open_servo", axes=[1])
    program = opened["program"]
    for seq in range(1, 10_001):
        await client.put_targets(program, [seq, seq * 1e-3, 1.0, [[0.0]], None, None])
    (found,) = (await client.call("programs", program=program))["programs"]
    assert 0 < found["servo"]["taken"] < 10_000
    await client.ask("subscribe", machine="cell", topic=f"ack/{program}")
    await client.call("abort", program=program)
    # the axis is free for the next one
    await client.message(lambda ack: ack["state"] == "aborted")


async def test_a_connection_that_breaks_stops_the_axes_whatever_the_grace(
    client: Client, gateway: GatewayProcess, tokens: Tokens
) -> None:
    async with opening(gateway, tokens[1]["operator"]) as socket:
        cut = Client(socket)
        await cut.receive()
        program = (await cut.call("open_servo", axes=[1]))["program"]
        await cut.put_targets(program, [1, 0.0, 10.0, [[400.0]], None, None])
        await client.ask("subscribe", machine="cell", topic=f"ack/{program}")
        socket.transport.abort()
        await client.message(lambda ack: ack["state"] == "aborted")
    assert (await client.call("status"))["axes"]["setpoint"][1] < 400.0
