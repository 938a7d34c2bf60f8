"""From a machine file to nodes on buses, and the loop that serves them."""

from __future__ import annotations

import contextlib
import itertools
import json
import struct
from collections.abc import Iterator

import pytest

from mcserver.can.cob import SYNC, Function, NmtCommand
from mcserver.can.open import open_port
from mcserver.can.port import CanPort
from mcserver.drive_sim.cia402_node import Cia402Node
from mcserver.drive_sim.control import MAX_LINE, Control
from mcserver.drive_sim.fault_injection import BadRequest
from mcserver.drive_sim.from_machine import Choice, build_buses, hardware_of, start_turns
from mcserver.drive_sim.simulation import DriveSimulation, SimulatedBusSegment
from mcserver.errors import RuntimeFault
from mcserver.machine.machine_file import Machine, parse_machine
from tests.can.hubs import address_of, receive, running_hub, wait_until
from tests.drive_sim.in_a_thread import simulated
from tests.machine_text import axes_text


def machine_of(left: str = "can0", right: str = "can1") -> Machine:
    """A linear axis on one bus, two rotary ones on another, and one without."""
    buses = "".join(
        f'[[bus]]\nname = "{name}"\naddress = "{address}"\n'
        for name, address in (("left", left), ("right", right))
    )
    drives = (
        (
            "cia402",
            'bus = "left"\nnode = 1\ncounts_per_motor_rev = 4096\ninitial_position = 25.0\ninvert = true',
        ),
        (
            "cia402",
            'bus = "right"\nnode = 1\nencoder = [20000, 1]\ngear = [10, 1]\nfeed = [360.0, 1]\n'
            "initial_position = 36.0\nvendor_id = 0x1234\nproduct_code = 0x5678",
        ),
        ("servosila", 'bus = "right"\nnode = 2\ncounts_per_motor_rev = 4096\ncodes = { off = 2 }'),
        ("simulated", ""),
    )
    linear = "units_per_motor_rev = 10.0\nmin_position = -200.0\nmax_position = 200.0"
    axes = "".join(
        axes_text(
            [index],
            rotary=index > 0,
            velocity=500.0,
            acceleration=5000.0,
            keys="" if index else linear,
            drive=kind,
            drive_keys=keys,
        )
        for index, (kind, keys) in enumerate(drives)
    )
    return parse_machine(f'[machine]\nname = "bench"\ncycle_hz = 100\n{buses}{axes}')


class Silence:
    """A port on a bus where nothing happens."""

    def __init__(self, opened: list[str], address: str) -> None:
        opened.append(address)
        self.closed = False

    def close(self) -> None:
        self.closed = True


# ---------------------------------------------------------------------- from the machine file


def test_every_drive_on_a_bus_becomes_a_node_of_that_bus() -> None:
    opened: list[str] = []
    buses = build_buses(machine_of(), Choice(), opener=lambda address: Silence(opened, address))  # type: ignore[arg-type,return-value]
    assert opened == ["can0", "can1"]
    assert [(bus.name, [node.node for node in bus.nodes]) for bus in buses] == [
        ("left", [1]),
        ("right", [1, 2]),
    ]


@pytest.mark.parametrize(
    ("choice", "found"),
    [
        (Choice(buses=["right"]), {"right": [1, 2]}),
        (Choice(buses=["can0"]), {"left": [1]}),
        (Choice(nodes=[2]), {"right": [2]}),
    ],
)
def test_buses_and_nodes_can_be_chosen(choice: Choice, found: dict[str, list[int]]) -> None:
    buses = build_buses(machine_of(), choice, opener=lambda address: Silence([], address))  # type: ignore[arg-type,return-value]
    assert {bus.name: [node.node for node in bus.nodes] for bus in buses} == found


def test_a_bus_that_cannot_be_opened_gives_the_others_back() -> None:
    ports: list[Silence] = []

    def opener(address: str) -> CanPort:
        if address == "can1":
            raise RuntimeFault("MC424", "no such bus")
        ports.append(Silence([], address))
        return ports[-1]  # type: ignore[return-value]

    with pytest.raises(RuntimeFault):
        build_buses(machine_of(), Choice(), opener=opener)
    assert [port.closed for port in ports] == [True]


def test_the_motor_starts_where_the_machine_file_says_in_the_drives_own_sense() -> None:
    axes = machine_of().axes
    assert start_turns(axes[0]) == pytest.approx(-2.5)
    assert start_turns(axes[1]) == pytest.approx(1.0)
    assert hardware_of(axes[1]).increments_per_turn == 20000


# ---------------------------------------------------------------------- the loop


Running = tuple[str, str, Control, DriveSimulation]


@pytest.fixture
def running() -> Iterator[Running]:
    with running_hub() as hub:
        left, right = address_of(hub, "can0"), address_of(hub, "can1")
        with (
            simulated(machine_of(left, right)) as (simulation, server),
            Control("127.0.0.1", server.port) as control,
        ):
            yield left, right, control, simulation


def read(port: CanPort, node: int, index: int, subindex: int) -> bytes:
    port.send(Function.SDO_REQUEST + node, struct.pack("<BHB4x", 0x40, index, subindex))
    while True:
        for identifier, payload in receive(port, 1):
            if identifier == Function.SDO_RESPONSE + node:
                return payload[4:]


def test_nodes_answer_on_their_own_bus(running: Running) -> None:
    left, right, _, _ = running
    one, other = open_port(left), open_port(right)
    assert read(one, 1, 0x1018, 1) == bytes(4)
    assert struct.unpack("<I", read(other, 1, 0x1018, 1))[0] == 0x1234
    assert struct.unpack("<I", read(other, 1, 0x1018, 2))[0] == 0x5678
    one.close()
    other.close()


def test_a_tpdo_answers_each_sync(running: Running) -> None:
    left, _, _, _ = running
    port = open_port(left)
    port.send(0x600 + 1, struct.pack("<BHBB3x", 0x2F, 0x1800, 2, 1))
    receive(port, 1)
    port.send(0, b"\x01\x01")
    for _ in range(20):
        port.send(SYNC, b"")
        assert receive(port, 1)[0][0] == 0x181
    port.close()


def test_faults_are_asked_for_by_node_and_bus(running: Running) -> None:
    _, _, control, _ = running
    control.fault(2, "mute")
    assert control.state(2)["faults"] == ["mute"]
    with pytest.raises(BadRequest, match='give "bus"'):
        control.fault(1, "mute")
    control.fault(1, "stuck", bus="right")
    states = {(state["bus"], state["node"]): state["faults"] for state in control.states()}
    assert states == {("left", 1): [], ("right", 1): ["stuck"], ("right", 2): ["mute"]}
    control.clear()
    assert [state["faults"] for state in control.states()] == [[], [], []]


@pytest.mark.parametrize(
    ("request_line", "why"),
    [
        (b"nonsense", "no JSON"),
        (b"[1]", "is a JSON object"),
        (b"{}", "fault"),
        (b'{"fault": "mute"}', "needs"),
        (b'{"node": 99, "fault": "mute"}', "there is no node 99"),
        (b'{"node": 2, "fault": "explode"}', "no fault"),
    ],
)
def test_a_bad_request_is_answered_and_the_next_one_counts(
    running: Running, request_line: bytes, why: str
) -> None:
    control = running[2]
    control._socket.sendall(request_line + b"\n")
    answer = json.loads(control._reader.readline())
    assert answer["ok"] is False
    assert why in answer["error"]
    assert control.state(2)["kind"] == "servosila"


def test_a_line_without_an_end_hangs_up(running: Running) -> None:
    control = running[2]
    control._socket.sendall(b"x" * (MAX_LINE + 1))
    assert control._reader.readline() == b""


def test_a_bus_that_goes_and_comes_is_used_again() -> None:
    with contextlib.ExitStack() as stack:
        with running_hub() as hub:
            number, left, right = hub.port, address_of(hub, "can0"), address_of(hub, "can1")
            simulation, _ = stack.enter_context(simulated(machine_of(left, right)))
        counters = [bus.port.counters for bus in simulation.buses]
        wait_until(lambda: all(each.down for each in counters), "both buses are seen to be away")
        with running_hub(port=number):
            wait_until(lambda: not any(each.down for each in counters), "both buses are there again")
            with contextlib.closing(open_port(left)) as other:
                assert read(other, 1, 0x1000, 0) == struct.pack("<I", 0x00020192)


class Backlog:
    """A port whose sends are noted with the time of a clock that each frame moves on."""

    def __init__(self) -> None:
        self.now = 0.0
        self.sent: list[tuple[float, int]] = []

    def send(self, identifier: int, _payload: bytes) -> bool:
        self.sent.append((self.now, identifier))
        return True


class Busy(Cia402Node):
    """A drive on a loaded computer: each frame takes it a millisecond."""

    port: Backlog

    def receive(self, identifier: int, payload: bytes, now: float) -> None:
        super().receive(identifier, payload, now)
        self.port.now += 1e-3


def test_heartbeats_are_sent_in_the_midst_of_a_backlog() -> None:
    port = Backlog()
    segment = SimulatedBusSegment("can0", port, lambda: port.now)  # type: ignore[arg-type]
    node = Busy(1, segment.transmit)
    node.port = port
    segment.nodes.append(node)
    node.switch_on(0.0)
    port.now = 1.0
    segment.serve([])
    node.store.entry(0x1017).value = 100
    segment.serve([(0x000, bytes((NmtCommand.START, 1)))])
    node.nmt._restart_heartbeat(100)
    port.sent.clear()
    segment.serve([(SYNC, b"")] * 1000)
    beats = [at for at, identifier in port.sent if identifier == Function.HEARTBEAT + 1]
    assert len(beats) >= 9
    assert max(later - earlier for earlier, later in itertools.pairwise(beats)) < 0.15
