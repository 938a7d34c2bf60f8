"""Drives on CAN buses from the client's side."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest
from fake_server import FakeServer
from mcclient import Machine, RequestRefused
from mcclient.cli.drives import parse_object
from mcclient.sync import Machine as SyncMachine

Run = Callable[..., tuple[int, str, str]]


async def test_drives_are_values(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        (drive,) = await machine.drives()
    assert (drive.axis, drive.node, drive.status, drive.emergency_code) == (2, 5, "operation enabled", 0x8611)
    assert drive.product_code is None


async def test_objects_are_read_and_written(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        found = await machine.sdo_read(0x6041, axis=2)
        assert (found.value, found.raw, found.type) == (0x1637, b"\x37\x16", "u16")
        by_node = await machine.sdo_read(0x1018, 1, node=7, bus="can1", type="u32")
        assert (by_node.node, by_node.bus, by_node.subindex, by_node.type) == (7, "can1", 1, "u32")
        assert (await machine.sdo_write(0x2000, "text", axis=2, type="str")).value == "text"
        assert (await machine.sdo_write(0x2000, 1.5, axis=2, type="f32")).value == 1.5


async def test_an_abort_of_the_drive_is_a_refusal_with_its_code(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        with pytest.raises(RequestRefused) as found:
            await machine.sdo_read(0x2345, axis=2)
    assert found.value.code == "MC553"
    assert found.value.details["abort_code"] == 0x0602_0000


def test_all_of_it_is_there_without_async(server: FakeServer) -> None:
    with SyncMachine.connect(connect=server.endpoint) as machine:
        assert machine.drives()[0].bus == "can0"
        assert machine.sdo_read(0x6041, axis=2).value == 0x1637
        assert machine.sdo_write(0x6065, 7, axis=2).value == 7


def test_mcctl_drives_shows_node_status_and_emergency(mcctl: Run) -> None:
    code, out, err = mcctl("drives")
    assert (code, err) == (0, "")
    assert "1637h operation enabled" in out
    assert "0x00001234" in out
    assert "axis 2: emergency 8611h following error (2.5 s ago)" in out
    assert json.loads(mcctl("drives", "--json")[1])[0]["node"] == 5


def test_mcctl_drives_watch_looks_again_and_again(mcctl: Run) -> None:
    code, out, err = mcctl("drives", "watch", "--count", "2", "--interval", "0.05")
    assert (code, err) == (0, "")
    assert "operation enabled" in out


def test_mcctl_sdo_reads_and_writes(mcctl: Run) -> None:
    assert mcctl("sdo", "read", "2", "6041")[1] == "axis 2 (node 5 on can0)  6041h:00  u16  5687 (0x1637)\n"
    assert mcctl("sdo", "write", "2", "2000:3", "-5", "--type", "i16")[1].startswith(
        "axis 2 (node 5 on can0)  2000h:03  i16  -5"
    )
    assert mcctl("sdo", "read", "3", "6041")[1].startswith("axis 3 (position 5 on can0)  6041h:00")
    shown = json.loads(mcctl("sdo", "read", "2", "0x6041", "--json")[1])
    assert (shown["ok"], shown["value"], shown["raw"]) == (True, 0x1637, "3716")


def test_mcctl_sdo_tells_the_abort_and_leaves_with_1(mcctl: Run) -> None:
    code, out, err = mcctl("sdo", "read", "2", "2345")
    assert (code, out) == (1, "")
    assert "error[MC553]" in err
    assert "object does not exist" in err


@pytest.mark.parametrize(
    "arguments",
    [
        ("read", "2", "xyz"),
        ("read", "2", "6041:123"),
        ("read", "2", "6041", "-t", "u7"),
        ("write", "2", "6041"),
    ],
)
def test_words_that_name_no_object_are_exit_code_2(mcctl: Run, arguments: tuple[str, ...]) -> None:
    assert mcctl("sdo", *arguments)[0] == 2


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("6041", (0x6041, 0)),
        ("0x6041", (0x6041, 0)),
        ("6041h", (0x6041, 0)),
        ("1018:1", (0x1018, 1)),
        ("1018h:0A", (0x1018, 10)),
        ("1a00:0x10", (0x1A00, 16)),
    ],
)
def test_an_object_may_be_written_as_documents_write_it(text: str, place: tuple[int, int]) -> None:
    assert parse_object(text) == place
