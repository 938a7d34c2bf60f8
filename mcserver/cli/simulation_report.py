"""The report of a simulation for people."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import msgspec
from rich.table import Table
from rich.text import Text

from mcserver.cli.console import json_bytes, results
from mcserver.cli.exit_codes import OutputFault
from mcserver.errors import Diagnostic
from mcserver.simulation.line_times import LineTimes

NOTHING_SIMULATED: Mapping[str, Any] = MappingProxyType(
    {"ok": False, "duration_s": 0.0, "feed_length_mm": 0.0, "lines": [], "axes": {}, "diagnostics": []}
)
MAX_SHOWN_LINES = 60
MAX_SHOWN_SOURCE = 60
TIMES_WIDTH = 50

# A line that takes this many times its requested time shows a reason.
RAMPS_SHOWN = 1.0005


def diagnostics_of(report: Mapping[str, Any]) -> list[Diagnostic]:
    """Return the diagnostics of a report as values."""
    return [
        each if isinstance(each, Diagnostic) else msgspec.convert(each, Diagnostic)
        for each in report["diagnostics"]
    ]


def write_report(report: Mapping[str, Any], times: LineTimes) -> None:
    """Write the report as one JSON object on standard output, its ``lines`` one by one: they may be millions.

    Raises:
        OutputFault: MC015 standard output is closed.
        OSError: it could not be written (full disk, reader gone).
    """
    if sys.stdout is None:
        raise OutputFault("MC015", "standard output is closed", "give it a file or a pipe")
    encode = json_bytes
    write = sys.stdout.buffer.write
    before = b"{"
    for key, value in report.items():
        write(before + encode(key) + b":")
        before = b","
        if key != "lines":
            write(encode(value))
            continue
        between = b"["
        for row in times.rows():
            write(between + encode(row))
            between = b","
        write(b"[]" if between == b"[" else b"]")
    write(b"}\n")
    sys.stdout.flush()


def shown_rows(times: LineTimes) -> list[dict[str, Any]]:
    """Return the lines that people are shown: all, or of many the most stretched."""
    return times.most_stretched(MAX_SHOWN_LINES) if len(times) > MAX_SHOWN_LINES else list(times.rows())


def print_report(report: Mapping[str, Any], times: LineTimes, source_lines: Sequence[str], name: str) -> None:
    """Times of the lines, travel of the axes, and the sums, on standard output."""
    console = results()
    count = len(times)
    shown = shown_rows(times)
    if shown:
        console.print(_table_of_lines(shown, source_lines, console.width))
    if len(shown) < count:
        console.print(f"the {len(shown)} most stretched of {count} lines; --json gives all")
    moved = {index: axis for index, axis in report["axes"].items() if axis["max"] > axis["min"]}
    if moved:
        console.print(_table_of_axes(moved))
    console.print(
        f"{name}: {report['duration_s']:.3f} s, feed path {report['feed_length_mm']:.1f} mm, "
        f"{count} timed line{'s' * (count != 1)}, {times.stretched_count()} stretched by the machine's limits"
    )
    if "shaping" in report:
        shaping = report["shaping"]
        console.print(
            f"shapers: paths come {shaping['delay_s']:.3f} s later, and are left by up to "
            f"{shaping['path_deviation_mm']:.3f} of the {shaping['path_tolerance_mm']:g} mm allowed"
        )
    for pair in report.get("clearance", {"pairs": ()})["pairs"][:1]:
        one, other = pair["bodies"]
        where = f"line {pair['line']}, {pair['time_s']:.3f} s"
        console.print(f"least clearance {pair['least_mm']:g} mm: {one} and {other}, {where}", markup=False)
    switched = report.get("clearance", {}).get("assumed_on", ())
    if switched:
        console.print(f"taken to be switched on by their inputs: {', '.join(switched)}", markup=False)
    judged = report.get("assertions", ())
    if judged and all(each["holds"] for each in judged):
        console.print(f"{len(judged)} assertion{'s' * (len(judged) != 1)}: the run keeps to all")
    if "difference" in report:
        _print_difference(report["difference"])
    if report.get("clearance", {}).get("stops") and report["ok"]:
        console.print("holds, overrides, aborts and emergency stops stay clear from every cycle")
        _print_lost_drives(report["clearance"]["lost_drives"])


def _print_lost_drives(lost: Mapping[str, Any]) -> None:
    """Say how near bodies come where a drive is lost, and how far its axis may run on."""
    console = results()
    if lost["clear"]:
        console.print("so do axes whose drive is lost, one at a time, and they stay within their travel")
    for pair in lost["pairs"][:1]:
        one, other = pair["bodies"]
        where = f"axis {pair['axis']} lost at line {pair['line']}, {pair['time_s']:.3f} s"
        console.print(
            f"least clearance with a drive lost {pair['least_mm']:g} mm: {one} and {other}, {where}",
            markup=False,
        )
    if lost["runs_on"]:
        far = (f"{each['axis']} by {each['by']:g} {each['unit']}" for each in lost["runs_on"])
        console.print(f"axes that may run on where their drive is lost: {', '.join(far)}")


def _print_difference(difference: Mapping[str, Any]) -> None:
    """Say how the other program moves: its setpoints minus those of this one, and its tips' paths."""
    console = results()
    if difference["same"]:
        console.print("the other program has the same setpoints, to the bit")
        return
    console.print(f"the other program takes {difference['duration_s']:+.3f} s")
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in ("axis", "differs by", "at s", "line", "its line", "least", "greatest", "end", "unit"):
        table.add_column(title, justify="right", no_wrap=True)
    for axis in difference["axes"]:
        far = [f"{axis[name]:+.3f}" for name in ("min", "max", "end")]
        where = [f"{axis['time_s']:.3f}", str(axis["line"]), str(axis["other_line"])]
        table.add_row(str(axis["axis"]), f"{axis['most']:+.3f}", *where, *far, axis["unit"])
    if difference["axes"]:
        console.print(table)
    for tip in difference["tips"]:
        of = "X Y Z" if tip["tool"] is None else f"tool {tip['tool']}"
        whose = "its line" if tip["other"] else "line"
        at = f"{whose} {tip['line']}, {tip['time_s']:.3f} s"
        console.print(f"path of {of}: {tip['apart_mm']:.3f} mm apart at the most, {at}")


def _table_of_lines(lines: Sequence[Mapping[str, Any]], source_lines: Sequence[str], width: int) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in ("line", "start s", "end s", "asked s", "×"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("bound by", no_wrap=True)
    # the numbers come whole; a narrow terminal costs the program's text
    bound = max(8, *(len(_bound_of(each)) for each in lines))
    room = max(8, width - TIMES_WIDTH - bound)
    table.add_column("program", no_wrap=True, overflow="ellipsis", max_width=min(room, MAX_SHOWN_SOURCE))
    for each in lines:
        number = int(each["line"])
        source = source_lines[number - 1].strip() if 0 < number <= len(source_lines) else ""
        table.add_row(
            str(number),
            f"{each['start_s']:.3f}",
            f"{each['end_s']:.3f}",
            _number(each["requested_s"]),
            _number(each["stretched_by"]),
            _bound_of(each),
            Text(source),
        )
    return table


def _bound_of(line: Mapping[str, Any]) -> str:
    """Return what stretched a line: a limit, or under G94 the ramps to its speed and from it."""
    if line["bound_by"]:
        return str(line["bound_by"])
    return "ramps" if (line["stretched_by"] or 1.0) >= RAMPS_SHOWN else ""


def _table_of_axes(axes: Mapping[str, Mapping[str, Any]]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in ("axis", "least", "greatest", "end"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("unit")
    for index, axis in axes.items():
        table.add_row(
            index, f"{axis['min']:.3f}", f"{axis['max']:.3f}", f"{axis['position']:.3f}", str(axis["unit"])
        )
    return table


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"
