"""What people see of a machine."""

from __future__ import annotations

from mcclient.cli.tables import machine_view
from mcclient.types import AxesStatus, Info, MachineStatus, ToolPose
from rich.console import Console

from tests.wire_values import wire_value

INFO = wire_value(Info, machine="dog", server="1", protocol=(1,), instance="i", epoch=0.0, cycle_s=0.001)
FOOT = wire_value(ToolPose, number=3, position=(-159.0, -400.0, 12.3456), orientation=(-8.913, 0.0, 90.0))


def shown(*tools: ToolPose, **more: str) -> str:
    status = wire_value(MachineStatus, 0.0, 0.0, "i", "ready", wire_value(AxesStatus), tools=tools, **more)
    console = Console(width=100, color_system=None)
    with console.capture() as capture:
        console.print(machine_view("dog", INFO, status))
    return capture.get()


def test_each_tool_is_shown_with_its_pose_and_units() -> None:
    said = shown(FOOT)
    assert "x mm" in said
    assert "c deg" in said
    (row,) = [line.split() for line in said.splitlines() if "T3" in line]
    assert row == ["T3", "-159.000", "-400.000", "12.346", "-8.91", "0.00", "90.00"]


def test_a_machine_without_tools_has_no_table_of_them() -> None:
    assert "tool" not in shown()


def test_where_no_program_runs_earlier_ones_are_not_denied() -> None:
    assert "no program runs; mcctl programs lists earlier ones" in shown()


def test_the_mesh_that_counts_is_said_of_a_printer_that_probes_one() -> None:
    assert "bed mesh: probed" in shown(bed_mesh="probed")
    assert "bed mesh" not in shown()
