"""Inputs and outputs for clients: state, setting by hand, interlocks, against the real executor's code."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from mcserver.errors import ServiceError
from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.service.executor_port import ExecutorPort
from mcserver.service.program import Program
from mcserver.service.reports import Event
from mcserver.service.service import MachineService
from mcserver.service.service_options import ServiceOptions
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.machine_text import axes_text
from tests.service.fakes import FakePipelines, FakePort, three_axes
from tests.service.virtual_cell import VirtualCell

CHANNELS = """
[[bus]]
name = "udp:239.0.0.1:4444"
[[input]]
number = 0
name = "door"
hold_on = true
[[input]]
number = 1
name = "guard"
stop_on = true
[[input]]
number = 0
name = "air"
kind = "analog"
unit = "bar"
[[input]]
number = 2
name = "real"
source = { bus = "udp:239.0.0.1:4444", node = 5, object = "6000h:01", bit = 0 }
[[output]]
number = 0
name = "lamp"
[[output]]
number = 0
name = "power"
kind = "analog"
max = 10.0
[[output]]
number = 1
name = "beam"
laser = true
"""


def cell() -> Machine:
    text = '[machine]\nname = "bench"\n[[axis]]\nindex = 0\ntype = "linear"\nmax_velocity = 10.0\n'
    return parse_machine(text + "max_acceleration = 10.0\n" + CHANNELS)


class Port(FakePort):
    """A fake port whose inputs and outputs are those of an executor on a virtual clock."""

    def __init__(self, machine: Machine) -> None:
        super().__init__(machine)
        self.executor = VirtualExecutor(machine)
        self.real = ExecutorPort(machine, Faces(self.executor))
        self.step()

    def step(self) -> None:
        self.executor.step()
        for event in self.executor.events():
            if event.kind is EventKind.FAULT:
                self.happen(event.kind, event.program, code=event.code, values=event.values)

    def set_output(self, column: int, value: float) -> None:
        self.real.orders.set_output(column, value)

    def set_input(self, column: int, value: float) -> None:
        self.real.orders.set_input(column, value)

    def snapshot(self) -> Any:
        return self.real.snapshot()


class Faces:
    """What a port asks of an executor."""

    alive = True
    ending = ""
    epoch = 0.0

    def __init__(self, executor: VirtualExecutor) -> None:
        self._executor = executor

    def __getattr__(self, name: str) -> Any:
        return getattr(self._executor, name)


class Bench:
    def __init__(self, service: MachineService, port: Port, events: list[Event]) -> None:
        self.service = service
        self.port = port
        self.events = events

    async def settle(self) -> None:
        self.port.step()
        for _ in range(200):
            await asyncio.sleep(0)
        await asyncio.sleep(0.05)

    async def set_input(self, name: str, value: float) -> None:
        self.service.channels.set_input(name, value)
        await self.settle()

    def output(self, name: str) -> tuple[float, str]:
        each = next(e for e in self.service.channels.outputs(self.port.snapshot()) if e.name == name)
        return each.value, each.set_by

    def kinds(self) -> list[str]:
        return [event.kind for event in self.events]


@pytest.fixture
async def bench(tmp_path: Path) -> AsyncIterator[Bench]:
    machine = cell()
    port = Port(machine)
    events: list[Event] = []
    service = MachineService(
        machine,
        port,
        FakePipelines(port),
        ServiceOptions(tmp_path / "journal.db", "one"),
        on_ack=lambda _ack: None,
        on_event=events.append,
    )
    service.start()
    yield Bench(service, port, events)
    port.stops_at_once = True
    await service.stop()


def refusal(call: Any, *arguments: Any) -> str:
    with pytest.raises(ServiceError) as caught:
        call(*arguments)
    return caught.value.code


async def test_an_output_is_set_by_hand(bench: Bench) -> None:
    assert bench.service.set_output("lamp", True) == 1.0
    assert bench.service.set_output("power", 2.5) == 2.5
    await bench.settle()
    assert bench.output("lamp") == (1.0, "operator")
    assert bench.output("power") == (2.5, "operator")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("nothing", 1.0),
        ("", 1.0),
        ("door", 1.0),
        ("lamp", 2.0),
        ("lamp", float("nan")),
        ("power", 10.1),
        ("power", -0.1),
        ("power", float("inf")),
    ],
)
async def test_what_no_output_can_be_is_refused(bench: Bench, name: str, value: float) -> None:
    assert refusal(bench.service.set_output, name, value) == "MC445"


@pytest.mark.parametrize(
    ("name", "value", "code"),
    [("lamp", 1.0, "MC445"), ("door", 0.5, "MC445"), ("air", float("nan"), "MC445"), ("real", 1.0, "MC446")],
)
async def test_what_no_simulated_input_can_be_is_refused(
    bench: Bench, name: str, value: float, code: str
) -> None:
    assert refusal(bench.service.channels.set_input, name, value) == code


async def test_nobody_switches_a_laser_on_by_hand(bench: Bench) -> None:
    assert refusal(bench.service.set_output, "beam", True) == "MC446"
    assert bench.service.set_output("beam", False) == 0.0


async def test_an_output_of_a_running_program_is_left_to_it(bench: Bench) -> None:
    program = await bench.service.open("c")
    bench.port.executor.executor._io.set(0, 1.0, 0)
    await bench.settle()
    assert bench.output("lamp") == (1.0, program.program)
    assert refusal(bench.service.set_output, "lamp", False) == "MC446"


async def test_the_emergency_stop_locks_the_outputs(bench: Bench) -> None:
    bench.service.latch.emergency_stop("c", "")
    assert refusal(bench.service.set_output, "lamp", True) == "MC509"


async def opened(bench: Bench) -> Program:
    return await bench.service.open("c")


async def test_a_door_holds_the_programs_until_somebody_resumes_them(bench: Bench) -> None:
    program = await opened(bench)
    await bench.set_input("door", 1.0)
    assert program.state == "held"
    held = next(event for event in bench.events if event.kind == "program.held")
    assert held.reason == "MC441"
    assert "door" in held.message
    assert program.status().waits_for == "door"
    assert refusal(bench.service.resume, None) == "MC443"
    await bench.set_input("door", 0.0)
    assert (program.state, program.status().waits_for) == ("held", "")
    bench.service.resume(None)
    assert program.state == "running"
    assert ("resume", 0) in bench.port.calls
    reasons = [event.reason for event in bench.events if event.kind == "warning"]
    assert reasons == ["MC441", "MC447"]


async def test_a_program_that_is_opened_behind_an_open_door_is_held(bench: Bench) -> None:
    await bench.set_input("door", 1.0)
    program = await opened(bench)
    assert (program.state, program.status().waits_for) == ("held", "door")


async def test_a_stop_input_counts_as_an_emergency_stop(bench: Bench) -> None:
    program = await opened(bench)
    await bench.set_input("guard", 1.0)
    await bench.settle()
    assert bench.service.latch.state == "estop"
    assert program.state == "faulted"
    stop = next(event for event in bench.events if event.kind == "estop")
    assert "guard" in stop.reason
    assert [fault.code for fault in bench.service.latch.faults] == [f"MC{FaultCode.INTERLOCK_STOP}"]
    assert refusal(bench.service.reset, None) == "MC443"
    await bench.set_input("guard", 0.0)
    bench.service.reset(None)
    assert bench.service.latch.state == "ready"


async def test_a_machine_without_channels_has_none(tmp_path: Path) -> None:
    port = FakePort(three_axes())
    service = MachineService(
        three_axes(),
        port,
        FakePipelines(port),
        ServiceOptions(tmp_path / "journal.db", "one"),
        on_ack=lambda _ack: None,
        on_event=lambda _event: None,
    )
    service.start()
    assert service.channels.inputs(port.snapshot()) == []
    assert refusal(service.set_output, "lamp", True) == "MC445"
    await service.stop()


async def test_a_program_says_for_which_input_it_waits(tmp_path: Path) -> None:
    text = f'[machine]\nname = "oven"\n{axes_text()}[[input]]\nnumber = 0\nname = "hot"\n'
    cell = VirtualCell(parse_machine(text), tmp_path)
    program = await cell.begin("G1010", "M66 P0 L3 Q9999", "M66 P0 L3 Q9", "G1 X20 F6000")
    await cell.until(lambda: bool(program.waits_for))
    assert (program.state, program.status().waits_for) == ("running", "hot")
    cell.service.channels.set_input("hot", 1.0)
    await cell.ended(program)
    assert (program.state, program.status().waits_for) == ("finished", "")
    cell.service.channels.set_input("hot", 0.0)
    in_vain = await cell.run("G1010", "M66 P0 L3 Q0.5")
    assert (in_vain.state, in_vain.status().waits_for) == ("faulted", "")
    await cell.stop()
