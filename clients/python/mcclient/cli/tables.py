"""Tables of a machine's state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from mcclient.types import Fault, Info, MachineStatus, ProgramStatus
from mcclient.work_tables import work_places

STATE_STYLES = {
    "ready": "green",
    "running": "green",
    "moving": "green",
    "finished": "green",
    "standstill": "cyan",
    "queued": "cyan",
    "held": "yellow",
    "paused": "yellow",
    "ending": "yellow",
    "stopping": "yellow",
    "aborted": "yellow",
    "interrupted": "red",
    "fault": "bold red",
    "estop": "bold red",
    "faulted": "red",
    "rejected": "red",
    "off": "dim",
    "released": "dim",
}


def plain_table(*titles: str, **column: Any) -> Table:
    """Return a table without lines; ``column``: how its columns are, as of `Table.add_column`."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in titles:
        table.add_column(title, **column)
    return table


def state_text(state: str) -> Text:
    return Text(state, style=STATE_STYLES.get(state, ""))


def machine_view(
    name: str, info: Info, status: MachineStatus, *, online: bool = True, rows: int | None = None
) -> RenderableType:
    """Return the whole machine; ``rows``: how many axes are shown at most."""
    parts: list[RenderableType] = [_headline(name, status, online), _axes_table(info, status, rows)]
    if status.work_offsets:
        parts.append(_work_offsets(info, status))
    if status.tools:
        parts.append(_tools_table(status))
    living = [program for program in status.programs if program.ended_at is None]
    shown = living or list(status.programs)[:3]
    # those that ended go after seconds, and none of an earlier server is here
    none = Text("no program runs; mcctl programs lists earlier ones", style="dim")
    parts.append(programs_table(shown) if shown else none)
    waiting = [program for program in living if program.state == "paused" and program.notice]
    parts += [Text(f"{program.program} waits: {program.notice}", style="yellow") for program in waiting]
    parts += [
        Text(f"{program.program} waits for {awaited(program, status.programs)}", style="yellow")
        for program in living
        if program.waits_for
    ]
    # a latched emergency stop comes before what it made of others
    for fault in sorted(status.faults, key=lambda fault: fault.code != "MC400"):
        parts += fault_texts(fault)
    return Group(*parts)


def awaited(waiting: ProgramStatus, programs: Sequence[ProgramStatus]) -> str:
    """Return the input, or the program that is to leave, for which one waits; empty: for none."""
    if not waiting.waits_for:
        return ""
    names = {each.program: each.name for each in programs}
    if waiting.waits_for not in names:
        return f"the input {waiting.waits_for}"
    return f"{names[waiting.waits_for] or waiting.waits_for} to leave its way"


def _headline(name: str, status: MachineStatus, online: bool) -> Text:
    line = Text.assemble((name, "bold"), "  ", state_text(status.state) if online else ("gone", "bold red"))
    line.append(f"  override {status.override:g} %  t {status.t:.1f} s")
    if status.late_cycles:
        line.append(f"  {status.late_cycles} late cycles", style="yellow")
    if status.bed_mesh is not None:
        line.append(f"  bed mesh: {status.bed_mesh}")
    if status.disk is not None:
        lasts_s, worst_s = status.wall - status.disk.since, status.disk.worst_s
        line.append(f"  slow disk for {lasts_s:.0f} s, up to {worst_s:.1f} s (MC524)", style="yellow")
    return line


def _axes_table(info: Info, status: MachineStatus, rows: int | None) -> Table:
    units = {axis.index: axis.unit for axis in info.axes}
    table = plain_table()
    table.add_column("axis", justify="right")
    for title in ("position", "setpoint", "velocity"):
        table.add_column(title, justify="right", min_width=11)
    table.add_column("unit")
    table.add_column("state", min_width=10)
    axes = status.axes
    # only machines that have something to home
    homing = {axis.index for axis in info.axes if axis.homing is not None} if axes.homed else set()
    if homing:
        table.add_column("homed")
    if axes.skew:
        table.add_column("skew", justify="right")
    # where a program's words would put the axes: every program starts in G54
    work = next((each for each in status.work_offsets if each.system == "G54"), None)
    places = work_places(status.work_offsets, dict(zip(axes.index, axes.position, strict=True)))
    if work is not None:
        table.add_column("in G54", justify="right", min_width=11)
    count = len(axes.index) if rows is None else min(rows, len(axes.index))
    for row in range(count):
        unit = units.get(axes.index[row], "")
        cells: list[str | Text] = [
            str(axes.index[row]),
            f"{axes.position[row]:.3f}",
            f"{axes.setpoint[row]:.3f}",
            f"{axes.velocity[row]:.2f}",
            unit,
            state_text(axes.state[row]),
        ]
        if axes.silent and axes.silent[row]:
            # its drive does not answer
            cells[-1] = Text.assemble(cells[-1], ", silent: old values")
        if homing:
            cells.append(_homed_text(axes.index[row] in homing, homed=axes.homed[row]))
        if axes.skew:
            cells.append(f"{axes.skew[row]:.3f}")
        if work is not None:
            index = axes.index[row]
            shown = str(index) in work.origin or (work.rotation and index in (0, 1))
            cells.append(f"{places[index]:.3f}" if shown else "")
        table.add_row(*cells)
    if count < len(axes.index):
        table.add_row("…", f"{len(axes.index) - count} more")
    return table


def _homed_text(needed: bool, *, homed: bool) -> Text:
    if not needed:
        return Text("")
    return Text("yes", style="green") if homed else Text("no", style="yellow")


def _work_offsets(info: Info, status: MachineStatus) -> Table:
    """Return where each work coordinate system reads zero."""
    units = {axis.index: axis.unit for axis in info.axes}
    table = plain_table()
    table.add_column("system", no_wrap=True)
    table.add_column("reads zero at")
    for each in status.work_offsets:
        places = [
            f"axis {axis} {value:.3f} {units.get(int(axis), '')}".rstrip()
            for axis, value in each.origin.items()
        ]
        places += [f"turned by {each.rotation:.3f} deg about Z"] if each.rotation else []
        table.add_row(each.system, ", ".join(places))
    return table


def _tools_table(status: MachineStatus) -> Table:
    table = plain_table(
        "tool", "x mm", "y mm", "z mm", "a deg", "b deg", "c deg", justify="right", no_wrap=True
    )
    for tool in status.tools:
        table.add_row(
            f"T{tool.number}",
            *(f"{value:.3f}" for value in tool.position),
            *(f"{value:.2f}" for value in tool.orientation),
        )
    return table


def programs_table(programs: Sequence[ProgramStatus]) -> Table:
    """One row a program."""
    table = plain_table()
    # ids are typed again by people: never cut
    table.add_column("program", no_wrap=True, overflow="fold")
    table.add_column("state", no_wrap=True)
    table.add_column("name", overflow="ellipsis", max_width=30, no_wrap=True)
    for title in ("line", "done", "taken", "feed"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("axes", no_wrap=True, overflow="ellipsis", max_width=12)
    table.add_column("client", no_wrap=True, overflow="ellipsis", max_width=12)
    for program in programs:
        table.add_row(
            program.program,
            state_text(program.state),
            Text(program.name),
            str(program.line),
            str(program.done),
            str(program.accepted),
            f"{program.override:g} %",
            axes_text(program.axes),
            program.client,
        )
    return table


def axes_text(axes: Sequence[int]) -> str:
    """Axis numbers with runs drawn together: ``0-5,8``."""
    runs: list[list[int]] = []
    for axis in sorted(axes):
        if runs and axis == runs[-1][1] + 1:
            runs[-1][1] = axis
        else:
            runs.append([axis, axis])
    return ",".join(str(first) if first == last else f"{first}-{last}" for first, last in runs)


def fault_texts(fault: Fault) -> list[Text]:
    head = Text.assemble((f"fault[{fault.code}]", "bold red"), f": {fault.message}")
    return [head, Text(f"  = help: {fault.hint}")] if fault.hint else [head]
