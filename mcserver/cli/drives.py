"""``mcserver drives``: parameters of CANopen drives by the names of their EDS, without a running server."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from mcserver.cli.console import json_answer_on_error, narration, results, write_json
from mcserver.cli.options import JsonOption, MachineOption
from mcserver.errors import UsageFault

if TYPE_CHECKING:
    from mcserver.canopen.desk import Reading
    from mcserver.canopen.dictionary import DeviceDictionary
    from mcserver.canopen.parameters import Parameter
    from mcserver.canopen.settings import DriveSettings

AxisArgument = Annotated[int, typer.Argument(metavar="AXIS", min=0, help="Of the machine file.")]
ObjectArgument = Annotated[str, typer.Argument(metavar="OBJECT", help="6065, 6091:01, or a name of the EDS.")]


def build_app() -> typer.Typer:
    """The sub-commands about drives."""
    app = typer.Typer(help="CANopen drives: their parameters by name.", no_args_is_help=True)

    @app.callback()
    def root() -> None:
        """CANopen drives of a machine file: their parameters by the names of their EDS."""

    app.command("list")(list_drives)
    # -6 is a value
    app.command("write", context_settings={"ignore_unknown_options": True})(write)
    for command in (search, read, save):
        app.command(command.__name__)(command)
    return app


@dataclass(frozen=True)
class Described:
    """A drive of the machine file with its dictionary and its parameters."""

    settings: DriveSettings
    dictionary: DeviceDictionary
    parameters: Sequence[Parameter]

    def find(self, text: str) -> Parameter:
        """By number or name; UsageFault: MC559."""
        from mcserver.canopen.parameters import find

        return find(self.parameters, self.dictionary, text)


def described(machine: str, axis: int) -> Described:
    """An axis's drive.

    Raises:
        ConfigurationError: the machine file, MC008 the EDS. UsageFault: MC559 no CiA 402 drive there.
    """
    from mcserver.canopen.parameters import parameters_of
    from mcserver.canopen.service import dictionary_of

    drives = {drive.axis: drive for drive in _drives_of(machine)}
    if axis not in drives:
        shown = ", ".join(f"{each.axis} (node {each.node} on {each.bus})" for each in drives.values())
        raise UsageFault(
            "MC559",
            f"axis {axis} has no CiA 402 drive in {machine}",
            f"axes with one: {shown}" if shown else "give a machine file by --machine",
        )
    dictionary = dictionary_of(drives[axis])
    return Described(drives[axis], dictionary, parameters_of(dictionary, drives[axis].node_axis))


def _drives_of(machine: str) -> list[DriveSettings]:
    from mcserver.canopen.settings import settings_of
    from mcserver.machine.machine_file import load_machine

    return [drive for drive in settings_of(load_machine(machine)) if drive.kind == "cia402"]


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
        drives = _drives_of(machine)
    if json:
        names = ("axis", "bus", "address", "node", "node_axis", "eds")
        write_json(
            {"ok": True, "drives": [{name: getattr(drive, name) for name in names} for drive in drives]}
        )
        return
    rows = [
        (str(drive.axis), drive.bus, drive.address, str(drive.node), drive.eds or "standard objects")
        for drive in drives
    ]
    results().print(_table(("axis", "bus", "address", "node", "EDS"), rows))


def search(
    axis: AxisArgument,
    words: Annotated[list[str], typer.Argument(metavar="WORDS", help="All of them occur, in any case.")],
    machine: MachineOption,
    json: JsonOption = False,
) -> None:
    """Search a drive's parameters by words of their names, types and numbers; the bus is not touched."""
    from mcserver.canopen.parameters import search as matching

    with json_answer_on_error(json):
        _show_parameters(matching(described(machine, axis).parameters, words), json)


def read(
    axis: AxisArgument,
    objects: Annotated[list[str], typer.Argument(metavar="OBJECT…", help="6065, 6091:01, or a name.")],
    machine: MachineOption,
    json: JsonOption = False,
) -> None:
    """Read parameters of a drive; refused while anybody else is master of its bus."""
    from mcserver.canopen.desk import at_desk

    with json_answer_on_error(json):
        drive = described(machine, axis)
        wanted = [drive.find(each) for each in objects]
        with at_desk(drive.settings) as desk:
            _show_readings([desk.read(each) for each in wanted], json)


def write(
    axis: AxisArgument,
    parameter: ObjectArgument,
    value: Annotated[str, typer.Argument(metavar="VALUE", help="Of the EDS's type; 0x1F is a number too.")],
    machine: MachineOption,
    json: JsonOption = False,
) -> None:
    """Write a parameter of a drive without energy, by the EDS's type, access and limits, and read it back."""
    from mcserver.canopen.desk import at_desk
    from mcserver.canopen.parameters import encode

    with json_answer_on_error(json):
        drive = described(machine, axis)
        wanted = drive.find(parameter)
        # what cannot be meant is refused before the bus is opened
        encode(wanted, value)
        with at_desk(drive.settings) as desk:
            _show_readings([desk.write(wanted, value)], json)
    narration().print(
        f"axis {axis}: kept until the drive is switched off; `mcserver drives save {axis}` stores it"
    )


def save(axis: AxisArgument, machine: MachineOption, json: JsonOption = False) -> None:
    """Store all parameters in a drive without energy (1010h), so that they outlast its supply."""
    from mcserver.canopen.desk import at_desk

    with json_answer_on_error(json):
        drive = described(machine, axis)
        with at_desk(drive.settings) as desk:
            desk.save()
    if json:
        write_json({"ok": True})
    narration().print(f"{drive.settings.name}: its parameters are stored")


def _show_parameters(parameters: Sequence[Parameter], json: bool) -> None:
    if json:
        write_json({"ok": True, "parameters": [_as_json(each) for each in parameters]})
        return
    rows = [
        (_object(each), each.name, each.kind, each.access, _limit(each.low), _limit(each.high))
        for each in parameters
    ]
    results().print(_table(("object", "name", "type", "access", "least", "greatest"), rows))
    narration().print(f"{len(parameters)} parameters")


def _show_readings(readings: Sequence[Reading], json: bool) -> None:
    if json:
        shown = [
            {**_as_json(each.parameter), "type": each.kind, "value": each.value, "raw": each.raw.hex()}
            for each in readings
        ]
        write_json({"ok": True, "values": shown})
        return
    rows = [
        (_object(each.parameter), each.parameter.name, each.kind, _value(each), each.raw[::-1].hex())
        if each.kind not in ("str", "utf16", "bytes")
        else (_object(each.parameter), each.parameter.name, each.kind, _value(each), "")
        for each in readings
    ]
    results().print(_table(("object", "name", "type", "value", "hex"), rows))


def _as_json(parameter: Parameter) -> dict[str, object]:
    return {
        "index": parameter.index,
        "subindex": parameter.subindex,
        "name": parameter.name,
        "type": parameter.kind,
        "access": parameter.access,
        "low": parameter.low,
        "high": parameter.high,
    }


def _object(parameter: Parameter) -> str:
    from mcserver.canopen.canopen_errors import object_text

    return object_text(*parameter.place)


def _limit(limit: int | None) -> str:
    return "" if limit is None else str(limit)


def _value(reading: Reading) -> str:
    return str(reading.value)


def _table(titles: Iterable[str], rows: Iterable[Sequence[str]]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in titles:
        table.add_column(title)
    for row in rows:
        # texts of drives and their files are no markup
        table.add_row(*map(Text, row))
    return table
