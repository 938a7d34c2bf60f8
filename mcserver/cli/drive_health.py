"""``mcserver drives health``: how the buses of a machine are, and what their drives remember."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
import typer
from rich.text import Text

from mcserver.canopen.error_history import condition_of
from mcserver.canopen.settings import settings_of
from mcserver.canopen.views import BusHealth
from mcserver.cli.console import json_answer_on_error, narration, results, write_json
from mcserver.cli.drive_of_machine import at_desk_of, check_seconds, described_drives, table
from mcserver.cli.options import JsonOption, MachineOption
from mcserver.errors import McError, UsageFault
from mcserver.ethercat.line_health import bus_health
from mcserver.machine.machine_file import Machine, load_machine

LONGEST_S = 3600.0


class BusReport(BusHealth):
    """One bus, and where nobody else is its master its drives.

    Attributes:
        drives: by axis, what the drives say of themselves.
    """

    drives: dict[str, dict[str, Any]] = msgspec.field(default_factory=dict)


def health(
    machine: MachineOption,
    seconds: Annotated[float, typer.Option("--seconds", help="How long each bus is listened to.")] = 5.0,
    json: JsonOption = False,
) -> None:
    """Listen on the buses beside a running server, or with none ask the drives too; report what is wrong."""
    with json_answer_on_error(json):
        check_seconds(seconds, LONGEST_S)
        described = load_machine(machine)
        buses = {drive.bus for drive in settings_of(described)}
        if not buses:
            raise UsageFault("MC559", f"{machine} has no drive on a bus", "give a machine file by --machine")
        reports = [_report(described, bus, seconds) for bus in sorted(buses)]
    if json:
        write_json({"ok": True, "buses": reports})
        return
    for report in reports:
        _show(report)


def _report(machine: Machine, bus: str, seconds: float) -> BusReport:
    drives = [drive for drive in described_drives(machine) if drive.settings.bus == bus]
    found = bus_health(
        machine,
        bus,
        seconds,
        {each.settings.axis: each.process_data for each in drives},
        [signal for each in drives for signal in each.signals],
    )
    report = BusReport(found.bus, found.counts, found.master, found.error_frames, found.following_errors)
    if not report.master:
        for drive in drives:
            try:
                with at_desk_of(drive.settings) as desk:
                    report.drives[str(drive.settings.axis)] = msgspec.to_builtins(condition_of(desk))
            except McError as error:
                report.drives[str(drive.settings.axis)] = {"error": f"{error.code}: {error.message}"}
    return report


def _show(report: BusReport) -> None:
    out, counts, errors = results(), report.counts, report.following_errors
    out.print(
        Text(
            f"bus {report.bus}: {counts.frames} frames in {counts.duration_s:.1f} s, load {counts.load:.1%}, "
            f"{report.error_frames} error frames"
        )
    )
    if counts.syncs:
        out.print(
            Text(
                f"  SYNC {counts.syncs / counts.duration_s:.1f} Hz, "
                f"longest gap {counts.longest_sync_gap_s * 1e3:.1f} ms by this computer's clock"
            )
        )
    else:
        out.print(Text("  no SYNC: no cycle runs"))
    rows = [
        (
            str(node.node),
            ", ".join(map(str, node.axes)) or "–",
            node.state or "no heartbeat",
            f"{node.longest_gap_s * 1e3:.0f}",
            str(node.readings),
            str(node.late),
            str(node.lost),
            ", ".join(f"{errors[axis]:.4g}" for axis in map(str, node.axes) if axis in errors) or "–",
        )
        for node in counts.nodes
    ]
    titles = ("node", "axes", "state", "heartbeat gap [ms]", "readings", "late", "lost", "following error")
    out.print(table(titles, rows))
    for node in counts.nodes:
        for text in node.emergencies:
            out.print(Text(f"  node {node.node}: emergency {text}"))
        if node.boot_ups:
            out.print(Text(f"  node {node.node}: has started {node.boot_ups} times while it was listened to"))
    for cob_id, count in counts.strangers.items():
        out.print(Text(f"  {cob_id}: {count} frames that belong to no node of the machine file"))
    for axis, said in report.drives.items():
        if "error" in said:
            out.print(Text(f"  axis {axis}: {said['error']}"))
            continue
        history = said["history"]
        remembered = "no 1003h" if history is None else "; ".join(history) or "none"
        out.print(
            Text(f"  axis {axis}: {said['status']}; error register: {said['register']}; errors: {remembered}")
        )
        for name, counts in said["line_errors"].items():
            if any(counts):
                out.print(Text(f"  axis {axis}: {name} by port: {', '.join(map(str, counts))}"))
    if report.master:
        narration().print(
            f"{report.bus}: {report.master} heard: another master is at work, nothing was asked"
        )
