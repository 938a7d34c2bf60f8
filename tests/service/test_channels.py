"""Inputs and outputs for clients: state, setting by hand, interlocks, against the real executor's code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mcserver.errors import ServiceError
from mcserver.executor.fault_codes import FaultCode
from mcserver.machine.machine_file import Machine, parse_machine
from tests.machine_text import axes_text
from tests.service.conftest import Bench
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


def machine() -> Machine:
    return parse_machine(f'[machine]\nname = "bench"\n{axes_text()}{CHANNELS}')


def refusal(call: Any, *arguments: Any) -> str:
    with pytest.raises(ServiceError) as caught:
        call(*arguments)
    return caught.value.code


def output(cell: VirtualCell, name: str) -> tuple[float, str]:
    """Its value, and who has set it."""
    channels = cell.service.channels.outputs(cell.service.port.snapshot())
    return next((each.value, each.set_by) for each in channels if each.name == name)


async def test_an_output_is_set_by_hand(cell: VirtualCell) -> None:
    assert cell.service.set_output("lamp", True) == 1.0
    assert cell.service.set_output("power", 2.5) == 2.5
    await cell.until(lambda: output(cell, "lamp") == (1.0, "operator"))
    await cell.until(lambda: output(cell, "power") == (2.5, "operator"))


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
async def test_what_no_output_can_be_is_refused(cell: VirtualCell, name: str, value: float) -> None:
    assert refusal(cell.service.set_output, name, value) == "MC445"


@pytest.mark.parametrize(
    ("name", "value", "code"),
    [("lamp", 1.0, "MC445"), ("door", 0.5, "MC445"), ("air", float("nan"), "MC445"), ("real", 1.0, "MC446")],
)
async def test_what_no_simulated_input_can_be_is_refused(
    cell: VirtualCell, name: str, value: float, code: str
) -> None:
    assert refusal(cell.service.channels.set_input, name, value) == code


async def test_nobody_switches_a_laser_on_by_hand(cell: VirtualCell) -> None:
    assert refusal(cell.service.set_output, "beam", True) == "MC446"
    assert cell.service.set_output("beam", False) == 0.0


async def test_an_output_of_a_running_program_is_left_to_it(cell: VirtualCell) -> None:
    program = await cell.begin("G1010", "M64 P0", "G04 P1000")
    await cell.until(lambda: output(cell, "lamp") == (1.0, program.program))
    assert refusal(cell.service.set_output, "lamp", False) == "MC446"


async def test_the_emergency_stop_locks_the_outputs(cell: VirtualCell) -> None:
    cell.service.latch.emergency_stop("c", "")
    assert refusal(cell.service.set_output, "lamp", True) == "MC509"


async def test_a_door_holds_the_programs_until_somebody_resumes_them(cell: VirtualCell) -> None:
    program = await cell.begin("G1010", "G01 X300 F600")
    cell.service.channels.set_input("door", 1.0)
    await cell.until(lambda: program.state == "held")
    held = next(event for event in cell.events if event.kind == "program.held")
    assert held.reason == "MC441"
    assert "door" in held.message
    assert program.status().waits_for == "door"
    assert refusal(cell.service.resume, None) == "MC443"
    cell.service.channels.set_input("door", 0.0)
    await cell.until(lambda: not program.status().waits_for)
    assert program.state == "held"
    cell.service.resume(None)
    assert program.state == "running"
    before = cell.position(0)
    await cell.until(lambda: cell.position(0) > before)
    reasons = [event.reason for event in cell.events if event.kind == "warning"]
    assert reasons == ["MC441", "MC447"]


async def test_a_program_that_is_opened_behind_an_open_door_is_held(cell: VirtualCell) -> None:
    cell.service.channels.set_input("door", 1.0)
    await cell.until(lambda: any(event.reason == "MC441" for event in cell.events))
    program = await cell.service.open("c")
    assert (program.state, program.status().waits_for) == ("held", "door")


async def test_a_stop_input_counts_as_an_emergency_stop(cell: VirtualCell) -> None:
    program = await cell.begin("G1010", "G01 X300 F600")
    cell.service.channels.set_input("guard", 1.0)
    await cell.ended(program)
    assert cell.service.latch.state == "estop"
    assert program.state == "faulted"
    stop = next(event for event in cell.events if event.kind == "estop")
    assert "guard" in stop.reason
    assert [fault.code for fault in cell.service.latch.faults] == [f"MC{FaultCode.INTERLOCK_STOP}"]
    assert refusal(cell.service.reset, None) == "MC443"
    cell.service.channels.set_input("guard", 0.0)
    await cell.until(lambda: not cell.service.channels.stopping())
    cell.service.reset(None)
    assert cell.service.latch.state == "ready"


async def test_a_machine_without_channels_has_none(bench: Bench) -> None:
    assert bench.service.channels.inputs(bench.port.snapshot()) == []
    assert refusal(bench.service.set_output, "lamp", True) == "MC445"


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
