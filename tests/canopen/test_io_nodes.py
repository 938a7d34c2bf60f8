"""Inputs and outputs on CiA 401 nodes: python-canopen's own slave, booted, and in the executor's cycle."""

from __future__ import annotations

import select
import struct
from collections.abc import Callable, Iterator

import pytest

from mcserver.canopen.canopen_errors import DriveError
from mcserver.drive_sim.cia401_node import Cia401Node
from mcserver.drive_sim.fault_injection import BadRequest
from mcserver.drive_sim.simulation import DriveSimulation
from mcserver.drives.can_bus import CanBus
from mcserver.drives.registry import create_buses
from mcserver.errors import ConfigurationError, RuntimeFault
from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.machine.bus_load import bus_loads
from mcserver.machine.io_process_data import objects_of
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.canopen.eds_files import U8, eds, record
from tests.canopen.local_drives import LocalDrive, until
from tests.canopen.rig import RunningHub, Watched, axis_on
from tests.drive_sim.in_a_thread import simulated
from tests.machine_text import axes_text

# python-canopen's own reader of EDS files
pytestmark = pytest.mark.filterwarnings("ignore:The 'warn' method is deprecated:DeprecationWarning")

NODE = 5
I16, U32 = 3, 7
DRIVE_OBJECTS = (
    0x6040,
    0x6041,
    0x6060,
    0x6061,
    0x6064,
    0x607A,
    0x60FF,
    0x6098,
    0x609A,
    0x607C,
    0x6079,
    0x6502,
)

CHANNELS = """
[[input]]
number = 0
name = "door"
hold_on = true
source = { bus = "left", node = 5, object = "6000h:01", bit = 3 }
[[input]]
number = 1
name = "part"
invert = true
source = { bus = "left", node = 5, object = "6000h:02", bit = 0 }
[[input]]
number = 0
name = "air"
kind = "analog"
unit = "bar"
scale = 0.001
offset = -1.0
source = { bus = "left", node = 5, object = "6401h:01" }
[[output]]
number = 0
name = "lamp"
target = { bus = "left", node = 5, object = "6200h:01", bit = 1 }
[[output]]
number = 1
name = "vacuum"
safe = "keep"
target = { bus = "left", node = 5, object = "6200h:01", bit = 7 }
[[output]]
number = 2
name = "brake"
initial = true
invert = true
target = { bus = "left", node = 5, object = "6200h:01", bit = 0 }
[[output]]
number = 0
name = "valve"
kind = "analog"
min = -10.0
max = 10.0
scale = 0.001
target = { bus = "left", node = 5, object = "6411h:01" }
"""


def machine(address: str, channels: str = CHANNELS) -> Machine:
    return parse_machine(
        f'[machine]\nname = "m"\ncycle_hz = 100\n[[bus]]\nname = "left"\naddress = "{address}"\n'
        + axes_text()
        + channels
    )


def description(profile: int = 401) -> str:
    more = "\n".join(
        (
            record(0x1016, "Consumer heartbeat", (U32,), "rw", ["0"]),
            record(0x6000, "Digital inputs", (U8, U8), "ro", ["0", "0"]),
            record(0x6200, "Digital outputs", (U8, U8), "rww", ["0", "0"]),
            record(0x6206, "Error mode", (U8, U8), "rw", ["255", "255"]),
            record(0x6207, "Error value", (U8, U8), "rw", ["0", "0"]),
            record(0x6401, "Analog inputs", (I16, I16), "ro", ["0", "0"]),
            record(0x6411, "Analog outputs", (I16, I16), "rww", ["0", "0"]),
        )
    )
    return eds(
        without=DRIVE_OBJECTS,
        changes={0x1000: {"DefaultValue": f"0x{0x00030000 + profile:08X}"}},
        rpdos=((0x62000108,), (0x64110110,), (), ()),
        tpdos=((0x60000108,), (0x64010110,), (), ()),
        more=more,
    )


@pytest.fixture
def node(hub: RunningHub) -> Iterator[LocalDrive]:
    made = LocalDrive(hub, description(), NODE, positions=()).start()
    yield made
    made.close()


class Cycle:
    """The executor on a bus whose node has been booted, a cycle for each answered SYNC."""

    def __init__(self, described: Machine, node: LocalDrive) -> None:
        self.node = node
        node.listen()
        self.frames: list[tuple[int, bytes]] = []
        node.network.subscribe(
            0x200 + NODE, lambda identifier, payload, _at: self.frames.append((identifier, bytes(payload)))
        )
        self.buses = create_buses(described)
        self.executor = VirtualExecutor(described, buses=self.buses)
        self.codes: list[int] = []

    def step(self, cycles: int = 1) -> None:
        for _ in range(cycles):
            self.executor.step()
            if self.node.local.nmt.state == "OPERATIONAL":
                # the node answers SYNC before the next cycle
                (bus,) = (each for each in self.buses if isinstance(each, CanBus))
                assert bus.port is not None
                select.select([bus.port.fileno()], [], [], 1.0)
            self.codes += [event.code for event in self.executor.events() if event.kind is EventKind.FAULT]

    def until(self, holds: object, what: str) -> None:
        def stepped() -> bool:
            self.step()
            return bool(holds())  # type: ignore[operator]

        until(stepped, what)

    @property
    def inputs(self) -> list[float]:
        return self.executor.feedback.inputs.tolist()

    def outputs(self) -> tuple[int, int]:
        store = self.node.local.data_store
        digital = store.get(0x6200, {}).get(1, b"\0")
        analog = store.get(0x6411, {}).get(1, b"\0\0")
        return digital[0], struct.unpack("<h", analog)[0]

    def set_node(self, index: int, subindex: int, payload: bytes) -> None:
        self.node.local.data_store.setdefault(index, {})[subindex] = payload

    def close(self) -> None:
        self.executor.close()


@pytest.fixture
def cycle(hub: RunningHub, watched: Watched, node: LocalDrive) -> Iterator[Cycle]:
    described = machine(hub.address())
    watched.start(described)
    made = Cycle(described, node)
    yield made
    made.close()


def test_a_node_is_booted_with_its_process_data(hub: RunningHub, watched: Watched, node: LocalDrive) -> None:
    watched.start(machine(hub.address()))
    assert node.local.nmt.state == "OPERATIONAL"
    assert [node.value(0x1A00, at) for at in (0, 1, 2, 3)] == [3, 0x60000108, 0x60000208, 0x64010110]
    assert [node.value(0x1600, at) for at in (0, 1, 2)] == [2, 0x62000108, 0x64110110]
    assert node.value(0x1800, 1) == 0x180 + NODE
    assert node.value(0x1800, 2) == 1
    assert node.value(0x1017) == 100
    # without a master the lamp goes out, the brake closes (it is inverted), the vacuum stays
    assert node.value(0x6206, 1) == 0b00000011
    assert node.value(0x6207, 1) == 0b00000000


def test_a_node_is_sent_its_initial_values_from_the_first_frame_on(cycle: Cycle) -> None:
    sent = [payload for identifier, payload in cycle.frames if identifier == 0x200 + NODE]
    assert sent
    assert {payload[0] for payload in sent} == {0}, "the brake is on: its bit is inverted"


def test_inputs_and_outputs_pass_once_a_cycle(cycle: Cycle) -> None:
    cycle.set_node(0x6000, 1, bytes((0b0000_1000,)))
    cycle.set_node(0x6000, 2, bytes((1,)))
    cycle.set_node(0x6401, 1, struct.pack("<h", 6500))
    cycle.until(lambda: cycle.inputs == [1.0, 0.0, 5.5], "the inputs")
    cycle.set_node(0x6000, 1, bytes((0,)))
    cycle.set_node(0x6000, 2, bytes((0,)))
    cycle.until(lambda: cycle.inputs[:2] == [0.0, 1.0], "the inputs again")
    assert cycle.outputs() == (0b0000_0000, 0), "the brake is on: its bit is inverted"
    mailbox = cycle.executor.mailbox
    mailbox.set_output(0, 1.0)
    mailbox.set_output(2, 0.0)
    mailbox.set_output(3, -2.5)
    cycle.until(lambda: cycle.outputs() == (0b0000_0011, -2500), "the outputs")
    mailbox.set_output(1, 1.0)
    cycle.until(lambda: cycle.outputs()[0] == 0b1000_0011, "the vacuum")
    mailbox.emergency_stop()
    cycle.until(lambda: cycle.outputs() == (0b1000_0000, 0), "the safe values, with the vacuum kept")
    assert set(cycle.codes) == {FaultCode.INTERLOCK_HOLD, FaultCode.INTERLOCK_FREE, FaultCode.EMERGENCY_STOP}


def test_a_node_that_is_lost_stops_the_programs_and_keeps_new_ones_from_starting(cycle: Cycle) -> None:
    cycle.step(3)
    ring = cycle.executor.open_slot(0)
    cycle.step(3)
    assert cycle.codes == []
    cycle.node.local.nmt.state = "PRE-OPERATIONAL"
    cycle.until(lambda: FaultCode.IO_LOST in cycle.codes, "the fault")
    cycle.step(5)
    assert cycle.executor.feedback.slots[0].state.free
    cycle.codes.clear()
    cycle.executor.open_slot(1)
    cycle.step(3)
    assert cycle.codes == [FaultCode.IO_LOST]
    assert cycle.executor.feedback.slots[1].state.free
    del ring


def test_another_device_at_the_number_is_refused(hub: RunningHub, watched: Watched) -> None:
    other = LocalDrive(hub, description(profile=402), NODE, positions=()).start()
    try:
        with pytest.raises(DriveError, match=r"MC551.*the I/O node 5 on left.*402"):
            watched.start(machine(hub.address()))
    finally:
        other.close()


def test_a_node_that_does_not_answer_the_cycle_is_named(hub: RunningHub) -> None:
    bus = CanBus(machine(hub.address()), machine(hub.address()).buses[0], [], wait=lambda _s: None)
    with pytest.raises(RuntimeFault, match=r"MC444.*I/O node 5 on left"):
        bus.boot()


def test_frames_of_another_length_count_as_not_come(cycle: Cycle) -> None:
    cycle.step(3)
    cycle.executor.open_slot(0)
    cycle.node.local.nmt.state = "STOPPED"
    for length in (0, 3, 5, 8):
        cycle.node.network.send_message(0x180 + NODE, bytes(length))
    cycle.until(lambda: FaultCode.IO_LOST in cycle.codes, "the fault")


def test_the_load_of_the_bus_counts_them() -> None:
    (load,) = bus_loads(machine("can0"))
    assert [share.what for share in load.shares if share.frames] == ["SYNC", "inputs", "outputs"]
    assert load.fits


def test_what_does_not_fit_a_node_is_refused_by_the_machine_file() -> None:
    many = "".join(
        f'[[input]]\nnumber = {at}\nname = "i{at}"\nkind = "analog"\n'
        f'source = {{ bus = "left", node = 5, object = "6402h:{at + 1:02X}" }}\n'
        for at in range(9)
    )
    with pytest.raises(MachineFileRejected, match="more inputs than four PDOs hold"):
        machine("can0", many)


def test_a_drives_node_has_no_inputs_of_the_machine() -> None:
    text = '[machine]\nname = "m"\ncycle_hz = 100\n[[bus]]\nname = "left"\naddress = "can0"\n' + axis_on(0, 5)
    with pytest.raises(ConfigurationError, match="the drive of axis 0"):
        parse_machine(text + CHANNELS)


# ---------------------------------------------------------------- the simulated node


def shown(simulation: DriveSimulation) -> dict[str, dict[str, int]]:
    nodes = simulation.answer({"state": True})["nodes"]
    return nodes[0]  # type: ignore[index,no-any-return]


def test_a_simulated_node_is_set_on_demand_and_is_safe_without_its_master(
    hub: RunningHub, watched: Watched
) -> None:
    described = machine(hub.address())
    with simulated(described) as (simulation, _):
        service = watched.start(described)
        buses = create_buses(described)
        executor = VirtualExecutor(described, buses=buses)
        (bus,) = (each for each in buses if isinstance(each, CanBus))

        def reach(holds: Callable[[], bool], what: str) -> None:
            def stepped() -> bool:
                executor.step()
                if bus.port is not None:
                    select.select([bus.port.fileno()], [], [], 1.0)
                return holds()

            until(stepped, what)

        simulation.answer({"node": NODE, "fault": "set", "index": 0x6000, "subindex": 1, "value": 8})
        simulation.answer({"node": NODE, "fault": "set", "index": 0x6401, "subindex": 1, "value": -500})
        reach(lambda: executor.feedback.inputs.tolist() == [1.0, 1.0, -1.5], "the inputs")
        for column in (0, 1):
            executor.mailbox.set_output(column, 1.0)
        executor.mailbox.set_output(3, 2.0)
        reach(lambda: shown(simulation)["outputs"] == {"6200h:01": 0b1000_0010, "6411h:01": 2000}, "outputs")
        executor.mailbox.set_output(2, 0.0)
        reach(lambda: shown(simulation)["outputs"]["6200h:01"] == 0b1000_0011, "the brake, open")
        # the server is gone: no RPDO tells the node to be safe
        assert bus.port is not None
        bus.port.close()
        service.close()
        until(
            lambda: shown(simulation)["outputs"]["6200h:01"] == 0b1000_0000,
            "the node's own safe values, with the vacuum kept",
        )


@pytest.mark.parametrize(
    "request_",
    [
        {"index": 0x6000, "subindex": 9, "value": 1},
        {"index": 0x6200, "subindex": 1, "value": 1},
        {"index": 0x6000, "subindex": 1, "value": 256},
        {"index": 0x6000, "subindex": 1, "value": "on"},
        {"index": 0x6000, "subindex": 1, "value": 0.5},
        {},
    ],
)
def test_what_no_input_of_a_simulated_node_can_be_is_refused(request_: dict[str, object]) -> None:
    inputs, outputs = objects_of(machine("can0"), "left", NODE)
    node = Cia401Node(NODE, lambda _identifier, _payload: None, inputs, outputs)
    with pytest.raises(BadRequest):
        node.request("set", request_, 0.0)
    with pytest.raises(BadRequest):
        node.request("following_error", {}, 0.0)
