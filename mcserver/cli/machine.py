"""``mcserver machine check | show``: a machine file read and explained; a built-in one to start from."""

from __future__ import annotations

import math
from typing import Annotated

import typer
from rich.table import Table

from mcserver.cli.console import (
    json_answer_on_error,
    narration,
    results,
    show_diagnostics,
    write_json,
    write_text,
)
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import JsonOption
from mcserver.machine.axis import Axis, axis_name
from mcserver.machine.bus_load import bus_loads
from mcserver.machine.machine_file import BUILT_IN, Machine, builtin_text, load_machine, machine_text
from mcserver.simulation.machine_faults import find_machine_faults
from mcserver.units import AxisType


def build_app() -> typer.Typer:
    """Return the sub-commands about machine files."""
    app = typer.Typer(help="Machine files.", no_args_is_help=True)

    @app.callback()
    def root() -> None:
        """Machine files."""

    app.command("check")(check_machine)
    app.command("show")(show_machine)
    return app


def check_machine(
    file: Annotated[
        str, typer.Argument(metavar="FILE", help="A TOML file, or the name of a built-in machine.")
    ],
    json: JsonOption = False,
) -> None:
    """Read a machine file, list its errors and warnings. Exit code 3 where it cannot be used."""
    with json_answer_on_error(json):
        machine = load_machine(file)
    findings = find_machine_faults(machine, machine_text(file))
    errors = sum(each.severity == "error" for each in findings)
    if json:
        found = [each.as_json() for each in findings]
        write_json({"ok": not errors, "name": machine.name, "diagnostics": found})
    else:
        _describe(machine)
    if errors or not json:
        show_diagnostics(findings, [], file)
    if errors:
        narration().print(
            f"{errors} error{'s' * (errors != 1)}: the machine cannot be used as it is", style="bold red"
        )
        raise typer.Exit(int(ExitCode.CONFIGURATION))
    if findings and not json:
        narration().print(f"warnings: {len(findings)}; no errors", style="yellow")


def show_machine(
    name: Annotated[str, typer.Argument(metavar="NAME", help=f"One of {', '.join(BUILT_IN)}.")],
) -> None:
    """Print a built-in machine file to start from: mcserver machine show cartesian > mine.toml"""
    write_text(builtin_text(name))


def _describe(machine: Machine) -> None:
    results().print(_table_of_axes(machine))
    for tool in machine.tools:
        chain = " ".join(axis_name(index) for index in tool.axes)
        load = "" if tool.payload is None else f", {tool.payload.mass:g} kg"
        results().print(f"T{tool.number}: {tool.frame}{load}, moved by {chain}")
    for bus_load in bus_loads(machine):
        results().print(f"bus {bus_load.bus}: {bus_load.arithmetic()}")
    results().print(
        f"{machine.name}: {len(machine.axes)} axes, {len(machine.tools)} tools, "
        f"{machine.cycle_hz:g} cycles a second"
    )


def _table_of_axes(machine: Machine) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("axis")
    limited = any(axis.max_torque != math.inf for axis in machine.axes)
    torque = ("torque",) if limited else ()
    for title in ("unit", "velocity /s", "acceleration /s²", "jerk /s³", *torque, "from", "to"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("drive")
    for axis in machine.axes:
        by_time = (axis.max_velocity, axis.max_acceleration, axis.max_jerk)
        table.add_row(
            axis_name(axis.index),
            axis.type.unit,
            *(_edge(axis, limit) for limit in by_time),
            *((_torque(axis),) if limited else ()),
            *(_edge(axis, limit) for limit in (axis.min_position, axis.max_position)),
            axis.drive.kind,
        )
    return table


def _torque(axis: Axis) -> str:
    """N·m, N of a linear axis; the URDF's effort is not read here."""
    if axis.max_torque is None:
        return "URDF"
    unit = "N·m" if axis.type is AxisType.ROTARY else "N"
    return f"{axis.max_torque:g} {unit}" if math.isfinite(axis.max_torque) else "–"


def _edge(axis: Axis, value: float) -> str:
    return f"{value / axis.type.si_per_unit:g}" if math.isfinite(value) else "–"
