"""The MTConnect agent: devices, observations in order, paths, streams, refusals."""

from __future__ import annotations

import asyncio
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from typing import Any

import pytest
from mcclient.types import (
    AxesStatus,
    AxisInfo,
    AxisKind,
    AxisUnit,
    Fault,
    Info,
    MachineState,
    MachineStatus,
    ProgramState,
    ProgramStatus,
)
from starlette.testclient import TestClient

from mcserver.mtconnect.agent import Agent
from mcserver.mtconnect.site import build_app, look, multipart
from tests.wire_values import wire_value

WALL = 1_800_000_000.0
LOST_DRIVE = Fault("MC407", "axis 1 does not answer", axis=1)


def info(machine: str = "cell-1", instance: str = "one") -> Info:
    axes = (
        wire_value(AxisInfo, 0, AxisKind.LINEAR, AxisUnit.MM),
        wire_value(AxisInfo, 1, AxisKind.ROTARY, AxisUnit.DEG),
    )
    return wire_value(Info, machine, "0.1.0", instance=instance, axes=axes)


def state(x: float = 0.0, *faults: Fault, **fields: Any) -> MachineStatus:
    axes = wire_value(AxesStatus, (0, 1), (x, 0.0), (x, 0.0), (0.0, 0.0))
    return wire_value(MachineStatus, wall=WALL, instance="one", axes=axes, faults=faults, **fields)


@pytest.fixture
def agent() -> Agent:
    agent = Agent("here", lambda: WALL, size=100)
    agent.add(info())
    agent.see("cell-1", state())
    return agent


@pytest.fixture
def client(agent: Agent) -> Iterator[TestClient]:
    with TestClient(build_app(agent), base_url="http://localhost") as client:
        yield client


class Fleet:
    """A link to machines that answer, and whose descriptions have been asked for."""

    def __init__(self, *names: str) -> None:
        self.names = names
        self.asked: list[str] = []

    async def states(self, **_: object) -> dict[str, MachineStatus]:
        return dict.fromkeys(self.names, state())

    async def info(self, name: str) -> Info:
        self.asked.append(name)
        return info(name)


def test_what_rounds_to_nothing_has_no_sign_and_is_no_news(agent: Agent) -> None:
    before = agent.buffer.next
    agent.see("cell-1", state(-0.00001))
    assert agent.buffer.next == before


def test_a_machine_for_which_there_is_no_room_is_not_asked_at_every_look(
    agent: Agent, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mcserver.mtconnect.agent.MOST_DEVICES", 2)
    fleet: Any = Fleet("cell-1", "cell-2", "cell-3")
    for _ in range(3):
        asyncio.run(look(agent, fleet, dict.fromkeys(fleet.names, state())))
    assert fleet.asked == ["cell-2"]
    assert set(agent.devices) == {"cell-1", "cell-2"}


def read(client: TestClient, address: str, status: int = 200) -> ElementTree.Element:
    answer = client.get(address)
    assert (answer.status_code, answer.headers["content-type"]) == (status, "text/xml; charset=utf-8")
    document = ElementTree.fromstring(answer.text)
    # without the namespace: `{urn:…}Header`
    for element in document.iter():
        element.tag = element.tag.rpartition("}")[2]
    return document


def values(document: ElementTree.Element, name: str) -> list[str | None]:
    return [each.text for each in document.iter(name)]


def error_of(document: ElementTree.Element) -> str:
    (error,) = document.iter("Error")
    return error.attrib["errorCode"]


def test_a_machine_is_a_device_with_its_axes(client: TestClient) -> None:
    document = read(client, "/probe")
    (device,) = document.iter("Device")
    assert device.attrib["name"] == "cell-1"
    assert [each.attrib["name"] for kind in ("Linear", "Rotary") for each in device.iter(kind)] == ["X", "Y"]
    ids = [each.attrib["id"] for each in device.iter() if "id" in each.attrib]
    assert len(ids) == len(set(ids))
    assert read(client, "/cell-1/probe").find("Devices/Device") is not None
    assert read(client, f"/{device.attrib['uuid']}").find("Devices/Device") is not None


def test_what_changes_is_observed_in_order(agent: Agent, client: TestClient) -> None:
    before = int(read(client, "/current").find("Header").attrib["nextSequence"])  # type: ignore[union-attr]
    agent.see("cell-1", state(1.5))
    agent.see("cell-1", state(1.5))
    agent.see("cell-1", state(2.5))
    document = read(
        client, f"/sample?from={before}&path=//Linear//DataItem[@subType='ACTUAL' and @type='POSITION']"
    )
    assert values(document, "Position") == ["1.5000", "2.5000"]
    assert values(read(client, "/current?path=//Linear"), "Position") == ["2.5000", "2.5000"]
    assert values(read(client, f"/current?at={before}&path=//Linear"), "Position")[0] == "1.5000"


def test_samples_come_in_pages(client: TestClient) -> None:
    seen, following = [], 1
    while True:
        document = read(client, f"/sample?from={following}&count=4")
        page = [int(each.attrib["sequence"]) for each in document.iter() if "sequence" in each.attrib]
        if not page:
            break
        seen += page
        following = int(document.find("Header").attrib["nextSequence"])  # type: ignore[union-attr]
    assert sorted(seen) == list(range(1, following))


def test_no_document_is_larger_than_one_may_be_whatever_is_asked_for(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mcserver.mtconnect.agent.MOST_OBSERVATIONS", 5)
    document = read(client, "/sample?from=1&count=100")
    assert len([each for each in document.iter() if "sequence" in each.attrib]) == 5
    assert document.find("Header").attrib["nextSequence"] == "6"  # type: ignore[union-attr]


def test_what_has_left_the_buffer_is_out_of_range_and_still_current(agent: Agent, client: TestClient) -> None:
    for step in range(200):
        agent.see("cell-1", state(float(step + 1)))
    assert error_of(read(client, "/sample?from=1", 400)) == "OUT_OF_RANGE"
    assert values(read(client, "/current"), "Availability") == ["AVAILABLE"]
    first = agent.buffer.first
    kept = values(read(client, f"/current?at={first}"), "Availability")
    assert kept == ["AVAILABLE"]
    assert agent.buffer.next - first == 100


def test_faults_are_conditions_that_end(agent: Agent, client: TestClient) -> None:
    other = Fault("MC401", "axis 1 is off", axis=1)
    agent.see("cell-1", state(0.0, LOST_DRIVE, other))
    document = read(client, "/current?path=//Rotary")
    assert [each.attrib["nativeCode"] for each in document.iter("Fault")] == ["MC407", "MC401"]
    agent.see("cell-1", state(0.0, other))
    assert [each.text for each in read(client, "/current").iter("Fault")] == ["axis 1 is off"]
    agent.see("cell-1", state())
    assert not list(read(client, "/current").iter("Fault"))


@pytest.mark.parametrize(
    ("machine", "program", "execution"),
    [
        ("ready", None, "READY"),
        ("ready", "running", "ACTIVE"),
        ("ready", "held", "FEED_HOLD"),
        ("ready", "paused", "PROGRAM_STOPPED"),
        ("ready", "finished", "PROGRAM_COMPLETED"),
        ("ready", "aborted", "STOPPED"),
        ("estop", "running", "STOPPED"),
    ],
)
def test_the_execution_is_that_of_the_program(
    agent: Agent, client: TestClient, machine: str, program: str | None, execution: str
) -> None:
    programs = () if program is None else (wire_value(ProgramStatus, "p-1", ProgramState(program)),)
    agent.see("cell-1", state(state=MachineState(machine), programs=programs))
    document = read(client, "/current")
    assert values(document, "Execution") == [execution]
    assert values(document, "EmergencyStop") == ["TRIGGERED" if machine == "estop" else "ARMED"]


def test_a_machine_that_does_not_answer_is_unavailable(agent: Agent, client: TestClient) -> None:
    agent.see("cell-1", None)
    document = read(client, "/current")
    for name in ("Position", "Execution", "Availability"):
        assert set(values(document, name)) == {"UNAVAILABLE"}
    assert not list(document.iter("Normal"))


def test_names_of_programs_are_text_and_nothing_else(agent: Agent, client: TestClient) -> None:
    program = wire_value(ProgramStatus, "p-1", ProgramState("running"), name="\x1b[2J<&>\ufffe\u202e")
    agent.see("cell-1", state(programs=(program,)))
    assert values(read(client, "/current"), "Program") == [r"\x1b[2J<&>�<U+202E>"]


@pytest.mark.parametrize(
    ("address", "status", "code"),
    [
        ("/nobody/current", 404, "NO_DEVICE"),
        ("/current?path=//Linear[", 400, "INVALID_XPATH"),
        ("/current?path=Linear", 400, "INVALID_XPATH"),
        ("/current?path=//*" + "/../*" * 100, 400, "INVALID_XPATH"),
        ("/current?path=" + "/" * 1001, 400, "INVALID_XPATH"),
        ("/current?at=0", 400, "OUT_OF_RANGE"),
        ("/current?at=x", 400, "INVALID_REQUEST"),
        ("/current?at=1&interval=100", 400, "INVALID_REQUEST"),
        ("/sample?count=0", 400, "OUT_OF_RANGE"),
        ("/sample?count=101", 400, "OUT_OF_RANGE"),
        ("/sample?from=100000", 400, "OUT_OF_RANGE"),
        ("/sample?interval=-1", 400, "OUT_OF_RANGE"),
        ("/asset/T1", 404, "ASSET_NOT_FOUND"),
        ("/cell-1/nothing", 404, "INVALID_URI"),
    ],
)
def test_what_cannot_be_answered_is_an_error_document(
    client: TestClient, address: str, status: int, code: str
) -> None:
    assert error_of(read(client, address, status)) == code


def test_only_reading_is_supported(client: TestClient) -> None:
    assert client.put("/cell-1/probe").status_code == 405
    assert client.get("/assets").status_code == 200


def test_another_host_name_gets_nothing(agent: Agent) -> None:
    with TestClient(build_app(agent), base_url="http://elsewhere.example") as client:
        assert client.get("/probe").status_code == 400


async def test_a_stream_has_what_is_new_and_a_heartbeat(agent: Agent) -> None:
    following = agent.buffer.next
    documents = agent.stream("sample", None, {"from": str(following), "heartbeat": "1"}, 0)
    parts = multipart(documents, "edge")
    assert b"Position" not in await anext(parts)
    waiting = asyncio.ensure_future(anext(parts))
    await asyncio.sleep(0)
    agent.see("cell-1", state(7.0))
    # a heartbeat may have come first
    part = await waiting
    while b">7.0000<" not in part:
        part = await anext(parts)
    head, _, body = part.partition(b"\r\n\r\n")
    assert head.startswith(b"--edge\r\nContent-type: text/xml\r\nContent-length: ")
    assert int(head.rpartition(b" ")[2]) == len(body) - len(b"\r\n")


async def test_a_stream_that_falls_behind_the_buffer_is_told_so(agent: Agent) -> None:
    documents = agent.stream("sample", None, {"from": "1", "count": "1"}, 0)
    await anext(documents)
    for step in range(300):
        agent.see("cell-1", state(float(step)))
    assert b"OUT_OF_RANGE" in await anext(documents)
    assert [each async for each in documents] == []
