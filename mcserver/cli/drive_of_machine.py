"""A drive of a machine file as commands name it: by its axis, with the parameters of its EDS."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from mcserver.canopen.dictionary import DeviceDictionary
from mcserver.canopen.parameters import Parameter, find, parameters_of
from mcserver.canopen.service import dictionary_of
from mcserver.canopen.settings import DriveSettings, settings_of
from mcserver.errors import UsageFault
from mcserver.machine.machine_file import load_machine

AxisArgument = Annotated[int, typer.Argument(metavar="AXIS", min=0, help="Of the machine file.")]


@dataclass(frozen=True)
class Described:
    """A drive of the machine file with its dictionary and its parameters."""

    settings: DriveSettings
    dictionary: DeviceDictionary
    parameters: Sequence[Parameter]

    def find(self, text: str) -> Parameter:
        """By number or name; UsageFault: MC559."""
        return find(self.parameters, self.dictionary, text)


def described(machine: str, axis: int) -> Described:
    """An axis's drive.

    Raises:
        ConfigurationError: the machine file, MC008 the EDS. UsageFault: MC559 no CiA 402 drive there.
    """
    drives = {drive.axis: drive for drive in drives_of(machine)}
    if axis not in drives:
        shown = ", ".join(f"{each.axis} (node {each.node} on {each.bus})" for each in drives.values())
        raise UsageFault(
            "MC559",
            f"axis {axis} has no CiA 402 drive in {machine}",
            f"axes with one: {shown}" if shown else "give a machine file by --machine",
        )
    dictionary = dictionary_of(drives[axis])
    return Described(drives[axis], dictionary, parameters_of(dictionary, drives[axis].node_axis))


def drives_of(machine: str) -> list[DriveSettings]:
    """CiA 402 drives of a machine file, by axis."""
    return [drive for drive in settings_of(load_machine(machine)) if drive.kind == "cia402"]


def as_json(parameter: Parameter) -> dict[str, object]:
    """What JSON answers say of a parameter."""
    return {
        "index": parameter.index,
        "subindex": parameter.subindex,
        "name": parameter.name,
        "type": parameter.kind,
        "access": parameter.access,
        "low": parameter.low,
        "high": parameter.high,
    }


def table(titles: Iterable[str], rows: Iterable[Sequence[str]]) -> Table:
    """A table whose cells are text as it is."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in titles:
        table.add_column(title)
    for row in rows:
        # texts of drives and their files are no markup
        table.add_row(*map(Text, row))
    return table
