"""Work coordinate systems in the status, and in what people see of it."""

from __future__ import annotations

import numpy as np
from mcclient.cli.tables import machine_view
from mcclient.types import AxesStatus, Info, MachineStatus, WorkOffset
from rich.console import Console

from mcserver.machine.machine_file import load_machine
from mcserver.net.status import EdgeUnits
from mcserver.units import MM
from tests.wire_values import wire_value


def test_the_status_names_the_systems_that_were_set_in_mm_and_deg() -> None:
    units = EdgeUnits(load_machine("cartesian"))
    systems = {2: {0: 12.5 * MM, 3: np.pi / 2}, 7: {2: -3.0 * MM, 63: 1.0}, 1: {}}
    found = {each.system: each.origin for each in units.work_offsets(systems)}
    assert list(found) == ["G55", "G59.1"]
    assert {axis: round(value, 9) for axis, value in found["G55"].items()} == {"0": 12.5, "3": 90.0}
    assert list(found["G59.1"]) == ["2"]
    assert units.work_offsets({}) == []


def test_people_see_where_the_axes_are_in_g54_and_where_each_system_reads_zero() -> None:
    axes = wire_value(AxesStatus,
        index=(0, 2), position=(30.0, 5.0), setpoint=(30.0, 5.0), velocity=(0.0, 0.0), torque=(0.0, 0.0),
        state=("off", "off"),
    )  # fmt: skip
    offsets = (WorkOffset("G54", {"0": 12.5}), WorkOffset("G55", {"0": 1.0, "2": -2.0}))
    status = wire_value(MachineStatus, 0.0, 0.0, "i", "ready", axes, work_offsets=offsets)
    info = wire_value(Info, "cell", "1", (1,), "i", 0.0, 0.001)
    console = Console(width=120, color_system=None)
    with console.capture() as capture:
        console.print(machine_view("cell", info, status))
    text = capture.get()
    assert "in G54" in text
    assert "17.500" in text
    assert "G55" in text
    assert "axis 0 1.000, axis 2 -2.000" in text
