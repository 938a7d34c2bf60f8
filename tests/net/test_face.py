"""A server's keys, as a client in any language sees them."""

from __future__ import annotations

import asyncio

import msgspec
import numpy as np
import pytest

from mcserver.net.method_table import METHODS
from mcserver.net.stop_copies import LEAST_NUMBER
from mcserver.service.stop_latch import CONFIRM_PERIOD_S
from tests.net.client import ErrorAnswer, WireClient
from tests.net.conftest import Rig
from tests.service.fakes import executed_lines
from tests.service.journal_rows import commands_in


async def test_info_describes_the_machine_in_its_edge_units(client: WireClient) -> None:
    (info,) = await client.ask("info")
    assert info["machine"] == "bench"
    assert info["protocol"] == [1]
    assert [axis["unit"] for axis in info["axes"]] == ["mm", "mm", "deg"]
    assert info["axes"][0]["max_velocity"] == pytest.approx(100.0)
    assert info["axes"][0]["min_position"] == pytest.approx(-500.0)
    assert "submit" in info["methods"]


async def test_a_program_is_opened_filled_and_closed_by_calls(rig: Rig, client: WireClient) -> None:
    program = (await client.call("open", name="demo"))["program"]
    acks = client.subscribe(f"ack/{program}")
    reply = await client.call("submit", program=program, first=1, lines=["G90", "move"])
    assert reply["accepted"] == 2
    await client.call("close", program=program, last=2)
    ended = await acks.first(lambda ack: ack["state"] == "finished")
    assert (ended["accepted"], ended["done"]) == (2, 2)
    assert executed_lines(rig.pipelines, program) == [1, 2]


async def test_streamed_lines_are_acknowledged_cumulatively(rig: Rig, client: WireClient) -> None:
    program = (await client.call("open"))["program"]
    acks = client.subscribe(f"ack/{program}")
    await client.call("status")
    for first in range(1, 501, 50):
        client.put(client.lines_key(program), [first, ["move"] * 50])
    await acks.first(lambda ack: ack["done"] == 500)
    assert executed_lines(rig.pipelines, program) == list(range(1, 501))


async def test_the_same_request_is_carried_out_once_and_answered_twice(rig: Rig, client: WireClient) -> None:
    first = await client.call("open", request=7)
    assert await client.call("open", request=7) == first
    assert len(rig.service.current()) == 1


async def test_an_error_is_remembered_like_an_answer(client: WireClient) -> None:
    program = (await client.call("open"))["program"]
    with pytest.raises(ErrorAnswer) as gap:
        await client.call("submit", request=50, program=program, first=2, lines=["move"])
    await client.call("submit", program=program, first=1, lines=["move"])
    with pytest.raises(ErrorAnswer) as again:
        await client.call("submit", request=50, program=program, first=2, lines=["move"])
    assert gap.value.body == again.value.body
    assert gap.value.body["details"]["expected"] == 1


async def test_a_wildcard_never_changes_a_machine(rig: Rig, client: WireClient) -> None:
    await client.call("open")
    for key in (
        "mc/@v1/*/@rpc/t/abort",
        "mc/@v1/bench/@rpc/t/*",
        "mc/@v1/bench/@rpc/*/abort",
        "mc/@v1/bench/@rpc/**",
        "mc/@v1/ben$*/@rpc/t/open",
        "mc/@v1/**/@rpc/anyone/reset",
        *(f"mc/@v1/*/@rpc/anyone/{method.name}" for method in METHODS if method.changes),
    ):
        with pytest.raises(ErrorAnswer, match="MC502: "):
            await client.ask(key, {"request": 900})
        assert [program.state for program in rig.service.current()] == ["running"]


async def test_a_wildcard_may_ask_for_the_status_of_all_machines(client: WireClient) -> None:
    (status,) = await client.ask("mc/@v1/*/@rpc/anyone/status")
    assert status["state"] == "ready"
    assert status["axes"]["position"] == pytest.approx([2.0, 2.0, np.degrees(0.002)])


async def test_an_unknown_method_is_refused_with_those_there_are(client: WireClient) -> None:
    with pytest.raises(ErrorAnswer) as refused:
        await client.ask(client.method("fly"))
    assert refused.value.code == "MC501"
    assert "submit" in refused.value.body["details"]["methods"]


async def test_a_payload_that_does_not_fit_is_refused_with_its_field(client: WireClient) -> None:
    with pytest.raises(ErrorAnswer) as refused:
        await client.call("submit", program="x", first="one", lines=["move"])
    assert refused.value.code == "MC500"
    assert refused.value.body["message"].endswith(" in first")
    with pytest.raises(ErrorAnswer) as refused:
        await client.call("submit", program="x", first=0, lines=["move"])
    assert refused.value.code == "MC511"
    assert refused.value.body["message"].endswith(" >= 1 in first")


async def test_a_faulty_line_is_answered_with_its_diagnostic(client: WireClient) -> None:
    program = (await client.call("open"))["program"]
    with pytest.raises(ErrorAnswer) as rejected:
        await client.call("submit", program=program, first=1, lines=["move", "bad"])
    assert rejected.value.code == "MC101"
    assert rejected.value.body["diagnostics"][0]["line"] == 2
    assert rejected.value.body["details"]["expected"] == 2


async def test_an_emergency_stop_is_confirmed_by_an_event(rig: Rig, client: WireClient) -> None:
    events = client.subscribe("event")
    await client.call("status")
    client.session.put(f"{client.root}/estop", b"")
    await events.first(lambda event: event["kind"] == "estop")
    assert ("emergency_stop",) in rig.port.calls
    assert (await client.call("status"))["state"] == "estop"
    await client.call("reset")
    assert (await client.call("status"))["state"] == "ready"


async def test_a_client_whose_token_goes_loses_its_programs(rig: Rig, client: WireClient) -> None:
    other = WireClient(rig.endpoint, "bench", "fragile")
    token = other.session.liveliness().declare_token(f"{other.root}/client/fragile")
    program = (await other.call("open", grace_s=0.0))["program"]
    acks = client.subscribe(f"ack/{program}")
    events = client.subscribe("event")
    await client.call("status")
    await other.close()
    await acks.first(lambda ack: ack["state"] == "aborted")
    assert (await events.first(lambda event: event["kind"] == "client.gone"))["client"] == "fragile"
    del token


async def test_telemetry_batches_hold_every_cycle_of_every_axis(client: WireClient) -> None:
    batches = client.subscribe("tele/batch")
    seq, t, rows = await batches.first()
    values = np.frombuffer(rows, "<f4").reshape(-1, 3, 4)
    assert values.shape[0] == 10
    assert t == pytest.approx(seq * 0.001)
    assert values[:, 0, 0] == pytest.approx(np.arange(seq, seq + 10), abs=1e-3)
    following = await batches.first(lambda batch: batch[0] > seq)
    assert following[0] == seq + 10


async def test_no_cycle_is_read_while_nobody_listens(rig: Rig, client: WireClient) -> None:
    await client.ask("info")
    await asyncio.sleep(0.1)
    assert rig.port.cycle == 0
    await client.subscribe("tele/batch").first()
    assert rig.port.cycle > 0
    await client.close()
    async with asyncio.timeout(5.0):
        before = -1
        while rig.port.cycle != before:
            before = rig.port.cycle
            await asyncio.sleep(0.1)


async def test_one_axis_is_published_alone(client: WireClient) -> None:
    blocks = client.subscribe("tele/axis/2")
    _, _, rows = await blocks.first()
    assert len(rows) == 10 * 4 * 4


async def test_the_state_of_the_whole_machine_is_published(client: WireClient) -> None:
    states = client.subscribe("tele/state")
    await client.call("open", name="demo")
    state = await states.first(lambda message: bool(message["programs"]))
    assert state["programs"][0]["name"] == "demo"
    assert state["axes"]["state"] == ["standstill"] * 3


async def test_the_server_is_found_by_its_liveliness_token(rig: Rig, client: WireClient) -> None:
    (reply,) = client.session.liveliness().get("mc/@v1/*/live/*", timeout=2.0)
    (answer,) = await asyncio.to_thread(lambda: list(client.session.get("mc/@v1/bench/info")))
    speaks = str(answer.replier_id.zid)
    # the instance, which everybody sees, is no session's id
    assert str(reply.ok.key_expr) == f"mc/@v1/bench/live/{rig.service.options.instance}.{speaks}"
    assert speaks != rig.service.options.instance


async def test_missed_events_are_given_again(client: WireClient) -> None:
    await client.call("open")
    reply = await client.call("events", since=1)
    assert [event["kind"] for event in reply["events"]][:2] == ["server.started", "program.opened"]
    assert reply["newest"] == reply["events"][-1]["seq"]


async def test_programs_are_listed_newest_first(client: WireClient) -> None:
    first = (await client.call("open", name="first"))["program"]
    second = (await client.call("open", name="second"))["program"]
    listed = (await client.call("programs"))["programs"]
    assert [program["program"] for program in listed] == [second, first]


async def test_an_unknown_program_is_refused(client: WireClient) -> None:
    with pytest.raises(ErrorAnswer, match="MC503: "):
        await client.call("programs", program="nobody")


async def test_a_jog_is_a_program_on_its_axis_alone(rig: Rig, client: WireClient) -> None:
    program = (await client.call("jog", axis=1, distance=5.0, velocity=10.0))["program"]
    made = rig.pipelines.made[program]
    assert made.request.axes == frozenset({1})
    assert made.executed == [(1, "G1010 P1"), (2, "G94 F600.000000 G91 G01 [1]5.000000")]


async def test_a_jog_on_a_leased_axis_is_refused(client: WireClient) -> None:
    await client.call("open", axes=[1])
    with pytest.raises(ErrorAnswer, match="MC512: "):
        await client.call("jog", axis=1, distance=5.0)


def press(client: WireClient, **fields: object) -> None:
    client.session.put(f"{client.root}/estop", msgspec.msgpack.encode({"client": "panel", **fields}))


async def test_a_late_copy_of_an_emergency_stop_confirms_and_does_not_stop_what_was_reset(
    rig: Rig, client: WireClient
) -> None:
    events = client.subscribe("event")
    await client.call("status")
    press(client, request=LEAST_NUMBER + 5)
    first = await events.first(lambda event: event["kind"] == "estop")
    await client.call("reset")
    stopped = rig.port.calls.count(("emergency_stop",))
    await asyncio.sleep(CONFIRM_PERIOD_S)
    press(client, request=LEAST_NUMBER + 5)
    again = await events.first(lambda event: event["kind"] == "estop" and rig.service.latch.stops == 2)
    assert again["seq"] == first["seq"]
    assert rig.service.latch.state == "ready"
    assert rig.port.calls.count(("emergency_stop",)) == stopped


@pytest.mark.parametrize("second", [{"request": LEAST_NUMBER + 6}, {"request": 5}, {}])
async def test_a_stop_of_its_own_latches_after_a_reset(
    rig: Rig, client: WireClient, second: dict[str, object]
) -> None:
    for fields in ({"request": LEAST_NUMBER + 5}, {"request": 5}):
        press(client, **fields)
        while rig.service.latch.state != "estop":
            await asyncio.sleep(0.001)
        await client.call("reset")
    press(client, **second)
    while rig.service.latch.state != "estop":
        await asyncio.sleep(0.001)


async def test_who_ordered_what_is_in_the_journal(rig: Rig, client: WireClient) -> None:
    program = (await client.call("open"))["program"]
    other = WireClient(rig.endpoint, "bench", "anna.mcctl-1")
    await client.call("hold", program=program)
    await other.call("override", percent=50.0)
    await other.call("abort")
    while not rig.service.program(program).ended:
        await asyncio.sleep(0.001)
    client.session.put(f"{client.root}/estop", msgspec.msgpack.encode({"client": "panel", "reason": "fire"}))
    while rig.service.latch.state != "estop":
        await asyncio.sleep(0.001)
    for _ in range(3):
        await other.call("estop")
    await other.call("reset")
    await other.close()
    await rig.service.stop()
    kept = [each[:4] for each in commands_in(rig.service.options.journal)]
    assert kept == [
        ("anna.mcctl-1", "reset", None, ""),
        ("panel", "estop", None, "fire"),
        ("anna.mcctl-1", "abort", None, ""),
        ("anna.mcctl-1", "override", None, "50 %"),
        ("tester", "hold", program, ""),
    ]
