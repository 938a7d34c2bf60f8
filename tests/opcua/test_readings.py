"""States of machines in the terms of OPC 40501-1."""

from __future__ import annotations

from typing import Any

import pytest
from asyncua import ua
from mcclient.types import Fault, MachineStatus

from mcserver.opcua.nodesets import State
from mcserver.opcua.readings import alerts_of, gone, readings_of
from tests.opcua.machines import LOST_DRIVE, program, state


class ByName(dict[str, State]):
    def __missing__(self, name: str) -> State:
        return State(name, ua.NodeId(name, 1), 0)


def read(status: MachineStatus | None) -> dict[str, Any]:
    """Values by the last names of their paths; states by their names."""
    found = readings_of(status, ByName(), ByName())
    return {
        path.removesuffix(".CurrentState").rpartition(".")[2]: (
            value.node.Identifier if isinstance(value, State) else value
        )
        for path, value in found.items()
    }


@pytest.mark.parametrize(
    ("status", "channel", "active", "item"),
    [
        (state(), 2, "Initializing", "NotExecuting"),
        (state(programs=(program("queued"),)), 2, "Initializing", "NotExecuting"),
        (state(programs=(program("running"),)), 0, "Running", "Executing"),
        (state(programs=(program("held"),)), 1, "Interrupted", "NotExecuting"),
        (state(programs=(program("paused"),)), 1, "Interrupted", "NotExecuting"),
        (state(programs=(program("finished"),)), 2, "Ended", "NotExecuting"),
        (state(programs=(program("aborted"),)), 2, "Aborted", "NotExecuting"),
        (state(state="estop"), 2, "Initializing", "OutOfService"),
        (state(LOST_DRIVE, state="fault"), 2, "Initializing", "OutOfService"),
    ],
)
def test_a_program_decides_the_states_of_channel_and_machine(
    status: MachineStatus, channel: int, active: str, item: str
) -> None:
    found = read(status)
    assert (found["ChannelState"], found["State"], found["MachineryItemState"]) == (channel, active, item)


@pytest.mark.parametrize(
    ("name", "channel", "operation"),
    [("part.nc", 0, 1), ("manual input by ada", 1, 0), ("jog axis X", 2, 0), ("home axis X", 2, 0)],
)
def test_what_is_moved_by_hand_is_no_automatic_operation(name: str, channel: int, operation: int) -> None:
    found = read(state(programs=(program("running", name),)))
    assert (found["ChannelMode"], found["OperationMode"]) == (channel, operation)


def test_a_machine_that_does_not_answer_has_no_values_and_is_not_available() -> None:
    found = read(None)
    assert found.pop("MachineryItemState") == "NotAvailable"
    assert set(found.values()) == {None}


def test_alerts_are_the_emergency_stop_each_latched_fault_and_the_end_of_the_program() -> None:
    ended = program("faulted", fault=Fault("MC410", "following error"))
    first = alerts_of(state(LOST_DRIVE, LOST_DRIVE, state="estop", programs=(ended,)))
    assert [each.key for each in first] == ["EMERGENCY_STOP", "MC407.1", "MC410"]
    second = alerts_of(state(LOST_DRIVE))
    assert [each.key for each in gone(first, second)] == ["EMERGENCY_STOP", "MC410"]
    assert not gone(second, first)
