"""``mcserver drives``: parameters of CANopen drives by the names of their EDS, without a running server."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer

from mcserver.canopen import parameters as of_drives
from mcserver.canopen.canopen_errors import object_text
from mcserver.canopen.desk import Reading
from mcserver.canopen.parameters import Parameter, encode
from mcserver.cli.console import json_answer_on_error, narration, results, write_json
from mcserver.cli.drive_files import backup, compare, restore
from mcserver.cli.drive_health import health
from mcserver.cli.drive_of_machine import AxisArgument, as_json, at_desk_of, described, drives_of, table
from mcserver.cli.drive_scope import scope
from mcserver.cli.drive_tune import tune
from mcserver.cli.drive_units import units
from mcserver.cli.options import JsonOption, MachineOption
from mcserver.machine.machine_file import load_machine

ObjectArgument = Annotated[str, typer.Argument(metavar="OBJECT", help="6065, 6091:01, or a name of the EDS.")]


def build_app() -> typer.Typer:
    """Return the sub-commands about drives."""
    app = typer.Typer(help="CANopen drives: their parameters by name.", no_args_is_help=True)

    @app.callback()
    def root() -> None:
        """CANopen drives of a machine file: their parameters by the names of their EDS."""

    app.command("list")(list_drives)
    # -6 is a value
    app.command("write", context_settings={"ignore_unknown_options": True})(write)
    for command in (search, read, save, backup, compare, restore, health, units, scope, tune):
        app.command(command.__name__)(command)
    return app


def list_drives(
    machine: MachineOption,
    axis: Annotated[
        int | None, typer.Argument(metavar="[AXIS]", min=0, help="List this drive's parameters.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """List the drives of a machine file, or one drive's parameters by its EDS; the bus is not touched."""
    with json_answer_on_error(json):
        if axis is not None:
            _show_parameters(described(machine, axis).parameters, json)
            return
        drives = drives_of(load_machine(machine))
    if json:
        names = ("axis", "bus", "address", "node", "node_axis", "eds")
        write_json(
            {"ok": True, "drives": [{name: getattr(drive, name) for name in names} for drive in drives]}
        )
        return
    rows = [
        (
            str(drive.axis),
            drive.bus,
            drive.address,
            str(drive.node) if drive.fieldbus == "can" else f"position {drive.node - 1}",
            drive.eds or "standard objects",
        )
        for drive in drives
    ]
    results().print(table(("axis", "bus", "address", "node", "EDS"), rows))


def search(
    axis: AxisArgument,
    words: Annotated[list[str], typer.Argument(metavar="WORDS", help="All of them occur, in any case.")],
    machine: MachineOption,
    json: JsonOption = False,
) -> None:
    """Search a drive's parameters by words of their names, types and numbers; the bus is not touched."""
    with json_answer_on_error(json):
        _show_parameters(of_drives.search(described(machine, axis).parameters, words), json)


def read(
    axis: AxisArgument,
    objects: Annotated[list[str], typer.Argument(metavar="OBJECT…", help="6065, 6091:01, or a name.")],
    machine: MachineOption,
    json: JsonOption = False,
) -> None:
    """Read parameters of a drive; refused while anybody else is master of its bus."""
    with json_answer_on_error(json):
        drive = described(machine, axis)
        wanted = [drive.find(each) for each in objects]
        with at_desk_of(drive.settings) as desk:
            _show_readings([desk.read(each) for each in wanted], json)


def write(
    axis: AxisArgument,
    parameter: ObjectArgument,
    value: Annotated[str, typer.Argument(metavar="VALUE", help="Of the EDS's type; 0x1F is a number too.")],
    machine: MachineOption,
    json: JsonOption = False,
) -> None:
    """Write a parameter of a drive without energy, by the EDS's type, access and limits, and read it back."""
    with json_answer_on_error(json):
        drive = described(machine, axis)
        wanted = drive.find(parameter)
        # what cannot be meant is refused before the bus is opened
        encode(wanted, value)
        with at_desk_of(drive.settings) as desk:
            _show_readings([desk.write(wanted, value)], json)
    narration().print(
        f"axis {axis}: kept until the drive is switched off; `mcserver drives save {axis}` stores it"
    )


def save(axis: AxisArgument, machine: MachineOption, json: JsonOption = False) -> None:
    """Store all parameters in a drive without energy (1010h), so that they outlast its supply."""
    with json_answer_on_error(json):
        drive = described(machine, axis)
        with at_desk_of(drive.settings) as desk:
            desk.save()
    if json:
        write_json({"ok": True})
    narration().print(f"{drive.settings.name}: its parameters are stored")


def _show_parameters(parameters: Sequence[Parameter], json: bool) -> None:
    if json:
        write_json({"ok": True, "parameters": [as_json(each) for each in parameters]})
        return
    rows = [
        (_object(each), each.name, each.type, each.access, _limit(each.low), _limit(each.high))
        for each in parameters
    ]
    results().print(table(("object", "name", "type", "access", "least", "greatest"), rows))
    narration().print(f"{len(parameters)} parameters")


def _show_readings(readings: Sequence[Reading], json: bool) -> None:
    if json:
        shown = [
            {**as_json(each.parameter), "type": each.kind, "value": each.value, "raw": each.raw.hex()}
            for each in readings
        ]
        write_json({"ok": True, "values": shown})
        return
    rows = [
        (
            _object(each.parameter),
            each.parameter.name,
            each.kind,
            str(each.value),
            "" if each.kind in ("str", "utf16", "bytes") else each.raw[::-1].hex(),
        )
        for each in readings
    ]
    results().print(table(("object", "name", "type", "value", "hex"), rows))


def _object(parameter: Parameter) -> str:
    return object_text(*parameter.place)


def _limit(limit: int | None) -> str:
    return "" if limit is None else str(limit)
