"""Messages that are anything: each is refused by itself, and nobody else notices."""

from __future__ import annotations

import asyncio
import logging

import msgspec
import pytest
import zenoh

from mcserver.errors import ServiceError
from mcserver.net.arming_messages import ArmRequest
from mcserver.net.decoding import MessageDecoder
from mcserver.net.defects import DefectLog
from mcserver.net.inbox import Inbox
from mcserver.net.messages import (
    CheckRequest,
    JogRequest,
    OverrideRequest,
)
from mcserver.net.recovery_messages import ContinueRequest
from tests.net.client import ErrorAnswer, WireClient
from tests.net.conftest import Rig

INVALID_UTF8 = b"\x83\xa4name\xa2\xff\xfe\xa6reason\xa2\xff\xfe\xa7program\xa2\xff\xfe"
NESTED = b"\x81\xa1a" * 3000 + b"\xc0"
HUGE = b"\xdd\xff\xff\xff\xff"
GARBAGE = [INVALID_UTF8, NESTED, HUGE, b"\xc1", b"\xdb\xff\xff\xff\xff", b"\xa3abc", b"\xff" * 4096]


def test_a_refused_message_names_the_field_and_no_file() -> None:
    with pytest.raises(ServiceError) as refused:
        MessageDecoder(OverrideRequest)(msgspec.msgpack.encode({"percent": "all"}))
    assert "no OverrideRequest" in refused.value.message
    assert refused.value.message.endswith(" in percent")
    assert "schemas" not in str(refused.value)


@pytest.mark.parametrize("number", [float("nan"), float("inf"), float("-inf")])
def test_numbers_that_pass_every_bound_are_refused(number: float) -> None:
    for kind, body in (
        (JogRequest, {"axis": 0, "distance": number}),
        (OverrideRequest, {"percent": number}),
        (CheckRequest, {"text": "G90", "positions": {"0": number}}),
    ):
        with pytest.raises(ServiceError, match="MC511"):
            MessageDecoder(kind)(msgspec.msgpack.encode(body))


@pytest.mark.parametrize(
    ("kind", "body", "message", "hint"),
    [
        (OverrideRequest, {"percent": 300}, "<= 200.0 in percent", "OverrideRequest of docs/wire"),
        (ArmRequest, {"sha256": "part.gcode"}, "sha256 is beyond", "at least its first 8 (mcctl arm)"),
        (ContinueRequest, {"program": "a", "outputs": "st"}, "outputs is beyond", "'leave' or 'set'"),
    ],
)
def test_a_value_beyond_its_bounds_is_refused_with_what_it_may_be(
    kind: type[msgspec.Struct], body: dict[str, object], message: str, hint: str
) -> None:
    with pytest.raises(ServiceError, match="MC511: ") as refused:
        MessageDecoder(kind)(msgspec.msgpack.encode(body))
    assert message in refused.value.message
    assert hint in refused.value.hint


@pytest.mark.parametrize("payload", GARBAGE)
async def test_a_call_with_garbage_is_answered_with_mc500(client: WireClient, payload: bytes) -> None:
    with pytest.raises(ErrorAnswer, match="MC500: "):
        await client.ask_raw(client.method("programs"), payload)


async def test_garbage_by_the_hundred_delays_no_call(rig: Rig, client: WireClient) -> None:
    stranger = WireClient(rig.endpoint, "bench", "stranger")
    program = (await client.call("open"))["program"]
    for _ in range(100):
        for payload in (INVALID_UTF8, NESTED):
            stranger.session.get(
                f"{stranger.root}/{stranger.method('programs')}", lambda _: None, payload=payload
            )
            stranger.session.put(f"{stranger.root}/{stranger.lines_key(program)}", payload)
    assert (await client.call("hold", program=program))["programs"] == [program]
    assert (await client.call("submit", program=program, first=1, lines=["G90"]))["accepted"] == 1
    await client.call("abort", program=program)
    await stranger.close()


async def test_unreadable_lines_give_one_warning_and_not_one_each(client: WireClient) -> None:
    program = (await client.call("open"))["program"]
    for _ in range(20):
        client.session.put(f"{client.root}/{client.lines_key(program)}", INVALID_UTF8)
    client.put(client.lines_key(program), [1, ["G90"]])
    async with asyncio.timeout(5.0):
        while (await client.call("programs", program=program))["programs"][0]["accepted"] < 1:
            await asyncio.sleep(0)
    events = (await client.call("events"))["events"]
    assert [event["reason"] for event in events if event["kind"] == "warning"] == ["MC500"]


@pytest.mark.parametrize("payload", GARBAGE)
async def test_an_emergency_stop_with_garbage_is_a_whole_emergency_stop(
    client: WireClient, payload: bytes
) -> None:
    events = client.subscribe("event")
    await client.call("status")
    client.session.put(f"{client.root}/estop", payload, priority=zenoh.Priority.REAL_TIME)
    await events.first(lambda event: event["kind"] == "estop")
    assert (await client.call("status"))["state"] == "estop"


@pytest.mark.parametrize("body", [{}, {"request": None}, {"client": "tester"}])
async def test_a_change_without_a_number_is_refused(client: WireClient, body: dict[str, object]) -> None:
    with pytest.raises(ErrorAnswer, match="MC506: "):
        await client.ask(client.method("abort"), body)


async def test_what_a_handler_raises_costs_its_own_item_alone() -> None:
    handled: list[int] = []

    def deliver(item: int) -> None:
        if item % 2:
            raise RecursionError(item)
        handled.append(item)

    inbox: Inbox[int] = Inbox(asyncio.get_running_loop(), deliver, limit=1000)
    for item in range(600):
        inbox.push(item)
    async with asyncio.timeout(5.0):
        while len(handled) < 300:
            await asyncio.sleep(0)
    assert handled == list(range(0, 600, 2))
    assert inbox.failed.count == 300


def test_a_flood_of_defects_is_logged_once_a_period(caplog: pytest.LogCaptureFixture) -> None:
    now = 0.0
    defects = DefectLog(logging.getLogger("flood"), clock=lambda: now)
    with caplog.at_level(logging.WARNING):
        for _ in range(100):
            defects.add("bad")
        now = 6.0
        defects.add("bad")
    assert [record.message for record in caplog.records] == ["bad", "bad (and 99 more since the last report)"]
    assert defects.count == 101


async def test_nobody_puts_lines_into_a_program_of_another_client(rig: Rig, client: WireClient) -> None:
    program = (await client.call("open"))["program"]
    stranger = WireClient(rig.endpoint, "bench", "stranger")
    events = client.subscribe("event")
    await client.call("status")
    stranger.put(f"in/stranger/{program}", [1, ["G01 X666"]])
    refused = await events.first(lambda event: event["kind"] == "warning")
    assert refused["reason"] == "MC504"
    assert (await client.call("submit", program=program, first=1, lines=["G90"]))["accepted"] == 1
    assert rig.pipelines.made[program].executed == [(1, "G90")]
    await stranger.close()


@pytest.mark.parametrize("key", ["mc/@v1/**", "mc/@v1/*/**", "mc/@v1/bench/*", "mc/@v1/bench/in/**"])
async def test_a_put_by_a_wildcard_moves_and_stops_nothing(rig: Rig, client: WireClient, key: str) -> None:
    program = (await client.call("open"))["program"]
    events = client.subscribe("event")
    await client.call("status")
    client.session.put(key, msgspec.msgpack.encode([1, ["G01 X666"]]))
    refused = await events.first(lambda event: event["kind"] == "warning")
    assert refused["reason"] == "MC502"
    assert ("emergency_stop",) not in rig.port.calls
    assert (await client.call("programs", program=program))["programs"][0]["accepted"] == 0


async def test_a_stop_of_every_machine_by_its_name_stops_this_one(client: WireClient) -> None:
    events = client.subscribe("event")
    await client.call("status")
    client.session.put("mc/@v1/*/estop", msgspec.msgpack.encode({"client": "panel", "reason": "fire"}))
    stop = await events.first(lambda event: event["kind"] == "estop")
    assert (stop["client"], stop["reason"]) == ("panel", "fire")


async def test_who_gave_a_command_is_in_the_events(client: WireClient) -> None:
    events = client.subscribe("event")
    program = (await client.call("open"))["program"]
    await client.call("hold", program=program)
    await client.call("override", percent=50.0)
    command = await events.first(lambda event: event.get("reason") == "override")
    assert (command["kind"], command["client"], command["message"]) == ("command", "tester", "50 %")
    held = await events.first(lambda event: event.get("reason") == "hold")
    assert held["program"] == program


async def test_another_client_s_numbers_cannot_be_used_up(rig: Rig, client: WireClient) -> None:
    stranger = WireClient(rig.endpoint, "bench", "stranger")
    for number in range(1, 20):
        await stranger.ask(
            "@rpc/stranger/override", {"request": number, "percent": 100.0, "client": "tester"}
        )
    assert (await client.call("open", request=5))["program"]
    await stranger.close()
