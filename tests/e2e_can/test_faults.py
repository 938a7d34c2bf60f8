"""Some rows of docs/canopen-faults.md from a real run; `make faults` makes all of them."""

from __future__ import annotations

import asyncio

import pytest

from tests.e2e_can.bench import LINE
from tests.e2e_can.disturbances import ON_ITS_BUS, SILENCE_CYCLES, disturbances
from tests.e2e_can.faults import measure
from tests.e2e_can.outcome import Outcome

# a computer that also runs the drives is late now and then
CYCLE_HZ = 50.0
STOPPING = {
    "mute": "MC411",
    "short TPDO": "MC411",
    "EMCY, overcurrent": "MC425",
    "reboot": "MC426",
    "process killed": "MC411",
    "bus away": "MC429",
}
PASSED_OVER = {"TPDO 2 cycles late": "", "SDO aborted": "MC553"}
pytestmark = pytest.mark.timeout(400)


@pytest.fixture(scope="module")
def outcomes() -> dict[str, Outcome]:
    """Of all of them, one after the other on one machine."""
    chosen = [each for each in disturbances(CYCLE_HZ) if each.name in STOPPING | PASSED_OVER]
    return {each.fault: each for each in asyncio.run(measure(chosen, cycle_hz=CYCLE_HZ))}


def test_each_fault_has_its_code(outcomes: dict[str, Outcome]) -> None:
    assert {fault: each.code for fault, each in outcomes.items()} == STOPPING | PASSED_OVER


def test_a_fault_stops_the_group_names_axis_and_line_latches_and_is_recovered_without_a_jump(
    outcomes: dict[str, Outcome],
) -> None:
    for each in map(outcomes.__getitem__, STOPPING):
        assert each.axis in ON_ITS_BUS, each
        assert each.line == LINE, each
        assert each.reported is not None, each
        assert 0 <= each.reported < SILENCE_CYCLES, each
        assert each.braked == each.reported + 1, each
        assert each.latch == "MC412", each
        assert each.recovered, each
        assert each.jump == 0, each


def test_what_stops_nothing_changes_nothing(outcomes: dict[str, Outcome]) -> None:
    for each in map(outcomes.__getitem__, PASSED_OVER):
        assert each.recovered, each
        assert each.reported is None, each
