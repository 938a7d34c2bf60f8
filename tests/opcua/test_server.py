"""The OPC UA server: what a client of another make sees, who is let in, and what nobody may do."""

from __future__ import annotations

import asyncio
import contextlib
import math
import struct
from pathlib import Path

import pytest
from asyncua import Client, ua

from mcserver.doors.listening import Address
from mcserver.errors import ConfigurationError
from mcserver.opcua import door
from mcserver.opcua.site import OpcUaOptions, serving
from tests.opcua.machines import LOST_DRIVE, ODD, SECRET, Files, Served, channel, program, state
from tests.peers import Peer, opcua_client
from tests.sdks.languages import ToolMissing

pytestmark = pytest.mark.asyncio(loop_scope="package")
USER = ("mes", SECRET)


@pytest.fixture(scope="module")
def go_client() -> Peer:
    try:
        return Peer(opcua_client())
    except ToolMissing as missing:
        pytest.skip(str(missing))


async def connected(served: Served, files: Files) -> Client:
    client = await channel(served, files.client, *USER)
    await client.connect()
    return client


async def test_a_client_of_another_make_sees_changes_and_alerts_and_a_server_that_goes_and_comes(
    served: Served, files: Files, go_client: Peer
) -> None:
    await served.look({"cell-1": state(), ODD: state()}, 1, 3)
    await go_client.start(served.url, *files.client, *USER)
    try:
        said = await go_client.says("state 2 true")
        assert {"machine cell-1", f"machine {ODD}"} <= set(said)
        assert any("StatusBadNotWritable" in each for each in said)
        running = program("running")
        await served.look({"cell-1": state(LOST_DRIVE, programs=(running,))})
        await go_client.says("state 0 true", "alert cell-1 MC407 true axis 1 does not answer")
        await served.look({"cell-1": state(programs=(running,))})
        await go_client.says("alert cell-1 MC407 false")
        await served.look({})
        await go_client.says("state <nil> false")
        await served.look({"cell-1": state(programs=(program("held"),)), ODD: state()}, 1, 3)
        await go_client.says("state 1 true")
    finally:
        await go_client.stop()


@pytest.mark.parametrize(
    ("certificate", "user", "refusal"),
    [
        ("client", ("mes", "wrong"), "StatusBadUserAccessDenied"),
        ("client", ("nobody", SECRET), "StatusBadUserAccessDenied"),
        ("other", USER, "StatusBadCertificateUntrusted"),
        ("client", None, "StatusBadIdentityTokenRejected"),
        (None, None, "no matching endpoint"),
    ],
)
async def test_who_is_not_known_is_not_let_in(
    served: Served,
    files: Files,
    go_client: Peer,
    certificate: str | None,
    user: tuple[str, str] | None,
    refusal: str,
) -> None:
    pair = getattr(files, certificate) if certificate else ()
    await go_client.start(served.url, *pair, *(user or ()))
    try:
        (said,) = await go_client.says("refused")
        assert refusal in said
    finally:
        await go_client.stop()


async def test_a_session_cannot_be_taken_over_from_another_channel(served: Served, files: Files) -> None:
    victim = await connected(served, files)
    thief = await channel(served, files.other, *USER)
    await thief.connect_socket()
    try:
        await thief.send_hello()
        await thief.open_secure_channel()
        thief.uaclient.protocol.authentication_token = victim.uaclient.protocol.authentication_token
        with pytest.raises(ua.UaError):
            await thief.activate_session()
        with pytest.raises(ua.UaError):
            await thief.get_node(ua.ObjectIds.Server_NamespaceArray).read_value()
        assert await victim.get_namespace_array()
    finally:
        thief.disconnect_socket()
        await victim.disconnect()


async def test_tools_come_and_go_with_the_tool_table_and_a_selection_of_anything_fails_nobody(
    served: Served, files: Files
) -> None:
    client = await connected(served, files)
    try:
        own = await client.get_namespace_index("urn:mcserver:machines")
        tools = client.get_node(ua.NodeId(f"{ODD}:.Equipment.Tools", own))
        assert [(await each.read_browse_name()).Name for each in await tools.get_children()] == ["T1", "T3"]
        subscription = await client.create_subscription(100, _Deaf())
        clause = ua.SimpleAttributeOperand(
            ua.NodeId(ua.ObjectIds.BaseEventType), [ua.QualifiedName("data_types")], ua.AttributeIds.Value
        )
        await subscription.subscribe_events(evfilter=ua.EventFilter([clause], ua.ContentFilter()))
        await served.look({"cell-1": state(LOST_DRIVE), ODD: state()}, 3, 7)
        assert [(await each.read_browse_name()).Name for each in await tools.get_children()] == ["T3", "T7"]
    finally:
        await client.disconnect()


class _Deaf:
    """Takes what a subscription says."""

    def event_notification(self, _: object) -> None:
        pass


async def test_who_does_not_read_is_not_read_and_who_announces_too_much_is_cut(served: Served) -> None:
    reader, writer = await asyncio.open_connection("127.0.0.1", served.port)
    writer.write(struct.pack("<3scI", b"MSG", b"F", 2**31) + bytes(door.MOST_MESSAGE))
    async with asyncio.timeout(60.0):
        with contextlib.suppress(ConnectionError):
            assert await reader.read() == b""
        writer.close()
        with contextlib.suppress(ConnectionError):
            await writer.wait_closed()
    connection = door.Connection(served.machines.server.iserver, [], [], [], served.machines.server.limits)
    transport = _Transport()
    connection.connection_made(transport)
    connection.pause_writing()
    handling = asyncio.ensure_future(connection._process_one_msg(None, None))
    await asyncio.sleep(0)
    assert not handling.done()
    handling.cancel()
    # a whole message is kept by itself, and no more is read until it has been answered
    connection.data_received(struct.pack("<3scI", b"HEL", b"F", 20) + bytes(12) + b"MSGF")
    assert transport.is_paused
    (_, kept) = connection.messages.get_nowait()
    assert len(kept) == 12
    assert not transport.is_closing()
    # one that is shorter than its own head
    connection.data_received(struct.pack("<I", 9) + b"x")
    assert transport.is_closing()
    connection.connection_lost(None)


class _Transport(asyncio.Transport):
    """Of a connection whose other end does not read."""

    def __init__(self) -> None:
        super().__init__()
        self.is_paused = False
        self._closed = False

    def pause_reading(self) -> None:
        self.is_paused = True

    def is_closing(self) -> bool:
        return self._closed

    def abort(self) -> None:
        self._closed = True

    def close(self) -> None:
        pass


@pytest.mark.parametrize("asked", [0.0, 1.0, 0.0001, math.nan, -5.0, math.inf])
async def test_a_subscription_is_not_looked_at_as_often_as_its_client_says(
    served: Served, files: Files, asked: float
) -> None:
    client = await connected(served, files)
    try:
        wanted = ua.CreateSubscriptionParameters(RequestedPublishingInterval=asked)
        made = await client.uaclient.create_subscription(wanted, lambda _: None)
        assert door.SHORTEST_MS <= made.RevisedPublishingInterval <= door.LONGEST_MS
    finally:
        await client.disconnect()


async def test_what_others_reach_needs_a_certificate_of_opc_ua_and_secrets(
    files: Files, tmp_path: Path
) -> None:
    authority_alone = Address("127.0.0.1", 0, files.authority, files.server[1])
    empty = tmp_path / "empty.pem"
    empty.write_text("nothing")
    for options in (
        OpcUaOptions(Address("0.0.0.0", 0, *files.server)),
        OpcUaOptions(Address("0.0.0.0", 0), files.users),
        OpcUaOptions(authority_alone),
        OpcUaOptions(Address("127.0.0.1", 0), trust=empty),
    ):
        with pytest.raises(ConfigurationError, match="MC085: "):
            async with serving(options):
                pass
