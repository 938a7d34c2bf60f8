"""Drives on buses: ``drives``, ``drives watch``, ``drives scan``, ``sdo read``, ``sdo write``."""

from __future__ import annotations

import asyncio
import re
from typing import Annotated

import typer
from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from mcclient.cli.options import JsonOption, Target, with_target
from mcclient.cli.output import errors_shown, results, say, write_json, write_text
from mcclient.cli.step import step
from mcclient.cli.tables import plain_table
from mcclient.errors import RequestRefused
from mcclient.machine import Machine
from mcclient.types import BusScan, DriveInfo, Fieldbus, SdoReply, SdoType

AxisArgument = Annotated[int, typer.Argument(min=0, max=63, metavar="AXIS", help="Whose drive.")]
ObjectArgument = Annotated[
    str, typer.Argument(metavar="INDEX[:SUB]", help="Hexadecimal, such as 6041, 0x6041 or 1018:1.")
]
TypeOption = Annotated[
    str | None,
    typer.Option(
        "--type",
        "-t",
        metavar="TYPE",
        help="bool, u8 … u64, i8 … i64, f32, f64, str, utf16 or bytes; default: by the drive's EDS.",
    ),
]
# what a drive's number is on its bus
_PLACES = {Fieldbus.CAN: "node", Fieldbus.ETHERCAT: "position"}
_STYLES = {"operational": "green", "booting": "yellow", "restarting": "yellow", "closed": "dim"}


def build_drives_app() -> typer.Typer:
    """``mcctl drives``, and ``mcctl drives watch``."""
    app = typer.Typer(invoke_without_command=True)
    app.callback()(with_target(drives))
    app.command("watch")(with_target(watch))
    app.command("scan")(with_target(scan))
    # a distance may be negative
    app.command("step", context_settings={"ignore_unknown_options": True})(with_target(step))
    return app


def watch(
    target: Target,
    interval: Annotated[
        float, typer.Option("--interval", metavar="S", min=0.05, help="Seconds between two looks.")
    ] = 0.5,
    count: Annotated[
        int, typer.Option("--count", metavar="N", min=0, help="End after so many looks; 0: on Ctrl-C.")
    ] = 0,
    json: JsonOption = False,
) -> None:
    """Look at the drives again and again: states, emergencies, monitored objects."""

    async def work(one: Machine) -> None:
        looks = 0
        with Live(console=results(), auto_refresh=False, transient=False) as live:
            while not count or looks < count:
                if looks:
                    await asyncio.sleep(interval)
                found = await one.drives()
                looks += 1
                if json:
                    write_json(found)
                else:
                    live.update(Group(drives_table(found), *monitor_lines(found)), refresh=True)

    target.carry_out(work, json)


def scan(
    target: Target,
    bus: Annotated[str, typer.Argument(metavar="[BUS]", help="Name of a bus; left out: all of them.")] = "",
    machine_file: Annotated[
        bool, typer.Option("--machine-file", help="Print a machine file to start from, instead of the table.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Look who is on the machine's buses: identity, modes, EDS file, axis; nothing is changed."""

    found = target.carry_out(lambda one: one.drives_scan(bus), json)
    if json:
        write_json(found)
        return
    for each in found:
        if machine_file:
            write_text(each.machine_file)
            continue
        say(f"{each.bus} ({each.address})")
        results().print(scan_table(each))


def scan_table(found: BusScan) -> Table:
    """One row a node."""
    table = plain_table(_PLACES[found.fieldbus], "axis", "what", "vendor", "product", "modes", "EDS")
    for node in found.nodes:
        table.add_row(
            str(node.node),
            "–" if node.axis is None else str(node.axis),
            Text(node.what),
            _hexadecimal(node.vendor_id),
            _hexadecimal(node.product_code),
            ", ".join(node.modes) or "–",
            Text(node.eds.rpartition("/")[2] or "–"),
        )
    return table


def monitor_lines(drives: tuple[DriveInfo, ...]) -> list[Text]:
    """Return what machine files show of drives, and last emergencies: one line each."""
    lines = []
    for drive in drives:
        for shown in drive.monitor:
            value = "–" if shown.value is None else f"{shown.value:g}"
            place = f"  ({shown.index:04X}h:{shown.subindex:02X})" if shown.index else ""
            lines.append(Text(f"axis {drive.axis}: {shown.name} {value}{place}"))
        if drive.emergency_code:
            age = "" if drive.emergency_age_s is None else f" ({drive.emergency_age_s:.1f} s ago)"
            lines.append(Text(f"axis {drive.axis}: emergency {drive.emergency}{age}"))
        if drive.message:
            lines.append(Text(f"axis {drive.axis}: {drive.message}"))
    return lines


def drives(target: Target, context: typer.Context, json: JsonOption = False) -> None:
    """Every drive on a bus: node, heartbeat, statusword, identity, last emergency, monitored objects."""
    if context.invoked_subcommand is not None:
        return

    async def work(one: Machine) -> tuple[str, tuple[DriveInfo, ...]]:
        return one.name, await one.drives()

    name, found = target.carry_out(work, json)
    if json:
        write_json(found)
    elif found:
        results().print(drives_table(found))
        for line in monitor_lines(found):
            results().print(line)
    else:
        say(f"{name}: no drive is on a bus")


def drives_table(drives: tuple[DriveInfo, ...]) -> Table:
    """One row a drive."""
    table = plain_table()
    table.add_column("axis", justify="right")
    for title in ("bus", " or ".join(sorted({_PLACES[each.fieldbus] for each in drives})), "state", "nmt"):
        table.add_column(title, no_wrap=True)
    table.add_column("heard", justify="right", no_wrap=True)
    for title in ("status", "vendor", "product", "boots"):
        table.add_column(title, no_wrap=True)
    for drive in drives:
        table.add_row(
            str(drive.axis),
            Text(drive.bus),
            str(drive.node),
            Text(drive.state, style=_STYLES.get(drive.state, "bold red")),
            drive.nmt or "–",
            "–" if drive.heartbeat_age_s is None else f"{drive.heartbeat_age_s:.2f} s ago",
            _status(drive),
            _hexadecimal(drive.vendor_id),
            _hexadecimal(drive.product_code),
            str(drive.boot_ups),
        )
    return table


def _status(drive: DriveInfo) -> str:
    return "–" if drive.statusword is None else f"{drive.statusword:04X}h {drive.status}"


def _hexadecimal(value: int | None) -> str:
    return "–" if value is None else f"0x{value:08X}"


def build_sdo_app() -> typer.Typer:
    """``mcctl sdo …``."""
    app = typer.Typer(help="Objects of a drive on CAN or EtherCAT (SDO).", no_args_is_help=True)

    @app.callback()
    def root() -> None:
        """Objects of a drive on CAN or EtherCAT (SDO)."""

    app.command("read")(with_target(read))
    # a value may be negative: such a word is no option
    app.command("write", context_settings={"ignore_unknown_options": True})(with_target(write))
    return app


def read(
    target: Target,
    axis: AxisArgument,
    place: ObjectArgument,
    kind: TypeOption = None,
    json: JsonOption = False,
) -> None:
    """Read an object: mcctl sdo read 2 6041."""
    _carry_out(target, axis, place, kind, json)


def write(
    target: Target,
    axis: AxisArgument,
    place: ObjectArgument,
    value: Annotated[
        str, typer.Argument(metavar="VALUE", help="A number, also 0x10 and 1.5; text; bytes as 01 ff.")
    ],
    kind: TypeOption = None,
    json: JsonOption = False,
) -> None:
    """Write an object, unless that would fight the cycle: mcctl sdo write 2 6065 5000."""
    _carry_out(target, axis, place, kind, json, value)


def _carry_out(
    target: Target, axis: int, place: str, kind: str | None, json: bool, value: str | None = None
) -> None:
    """Read an object, or write a value into it, and tell what it holds."""
    with errors_shown(json):
        index, subindex = parse_object(place)
        chosen = sdo_type(kind)

    async def work(one: Machine) -> SdoReply:
        if value is None:
            return await one.sdo_read(index, subindex, axis=axis, type=chosen)
        return await one.sdo_write(index, value, subindex, axis=axis, type=chosen)

    _tell(target.carry_out(work, json), json)


def parse_object(text: str) -> tuple[int, int]:
    """Index and subindex of ``6041``, ``0x6041``, ``6041h``, ``1018:1``, ``1018h:01``.

    Raises:
        RequestRefused: MC511 it is no such text.
    """
    found = re.fullmatch(
        r"(?:0x)?([0-9a-f]{1,4})h?(?::(?:0x([0-9a-f]{1,2})|([0-9a-f]{1,2})h?))?", text.strip().lower()
    )
    if found is None:
        raise RequestRefused(
            "MC511", f"{text!r} names no object", "give index and subindex, hexadecimal: 6041 or 1018:1"
        )
    return int(found[1], 16), int(found[2] or found[3] or "0", 16)


def sdo_type(kind: str | None) -> SdoType | None:
    """Return the type of that name. Raises RequestRefused (MC511) where there is none."""
    if kind is None or kind in list(SdoType):
        return None if kind is None else SdoType(kind)
    raise RequestRefused("MC511", f"there is no type {kind!r}", f"use one of {' '.join(SdoType)}")


def _tell(found: SdoReply, as_json: bool) -> None:
    place = f"{found.index:04X}h:{found.subindex:02X}"
    if as_json:
        shown = {
            name: getattr(found, name)
            for name in ("axis", "bus", "fieldbus", "node", "index", "subindex", "type", "value")
        }
        write_json({"ok": True, **shown, "raw": found.raw.hex()})
        return
    value = found.value
    if isinstance(value, int) and not isinstance(value, bool):
        width = max(2, 2 * len(found.raw))
        shown_value = f"{value} (0x{int.from_bytes(found.raw, 'little'):0{width}X})"
    else:
        shown_value = str(value)
    who = f"axis {found.axis} ({_PLACES[found.fieldbus]} {found.node} on {found.bus})"
    results().print(f"{who}  {place}  {found.type}  {shown_value}")
