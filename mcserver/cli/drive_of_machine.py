"""A drive of a machine file as commands name it: by its axis, with the parameters of its EDS."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from mcserver.can.pdo import ProcessData
from mcserver.canopen.coe import configure_coe
from mcserver.canopen.cycle_samples import Signal, signals_of
from mcserver.canopen.description import dictionary_of
from mcserver.canopen.desk import Desk, at_desk
from mcserver.canopen.dictionary import DeviceDictionary
from mcserver.canopen.parameters import Parameter, find, parameters_of
from mcserver.canopen.process_data import plan_process_data
from mcserver.canopen.sdo_write import DriveDictionary
from mcserver.canopen.settings import DriveSettings, settings_of
from mcserver.errors import UsageFault
from mcserver.machine.axis import Axis
from mcserver.machine.machine_file import Machine, load_machine

AxisArgument = Annotated[int, typer.Argument(metavar="AXIS", min=0, help="Of the machine file.")]


@dataclass(frozen=True)
class Described:
    """A drive of the machine file with its dictionary and its parameters."""

    settings: DriveSettings
    axis: Axis
    dictionary: DeviceDictionary
    parameters: Sequence[Parameter]

    def find(self, text: str) -> Parameter:
        """By number or name; UsageFault: MC559."""
        return find(self.parameters, self.dictionary, text)

    @property
    def process_data(self) -> ProcessData:
        """What the cycle exchanges with it; ConfigurationError: MC552."""
        if self.settings.fieldbus == "ethercat":
            # the length of a cycle is in no PDO
            return configure_coe(self.settings, 0.001)[1].process_data
        return plan_process_data(DriveDictionary(self.settings, self.dictionary)).process_data

    @property
    def signals(self) -> list[Signal]:
        """What of it is on the bus in a cycle; ConfigurationError: MC552."""
        return signals_of(self.axis, self.process_data, self.dictionary, self.settings.node_axis)


def check_seconds(seconds: float, longest: float) -> None:
    """Refuse a time that a bus cannot be listened to; UsageFault: MC017."""
    if not 0.0 < seconds <= longest:
        raise UsageFault("MC017", f"--seconds {seconds:g} is no duration", f"give 0.1 to {longest:g}")


def at_desk_of(drive: DriveSettings) -> AbstractContextManager[Desk]:
    """Return the drive's desk, on CAN or by its mailbox on EtherCAT. Raises: as these."""
    if drive.fieldbus == "ethercat":
        from mcserver.ethercat.desk import at_ethercat_desk

        return at_ethercat_desk(drive)
    return at_desk(drive)


def described(machine: str, axis: int) -> Described:
    """Return an axis's drive.

    Raises:
        ConfigurationError: the machine file, MC008 the EDS. UsageFault: MC559 no CiA 402 drive there.
    """
    loaded = load_machine(machine)
    drives = {drive.axis: drive for drive in drives_of(loaded)}
    if axis not in drives:
        shown = ", ".join(f"{each.axis} (node {each.node} on {each.bus})" for each in drives.values())
        raise UsageFault(
            "MC559",
            f"axis {axis} has no CiA 402 drive in {machine}",
            f"axes with one: {shown}" if shown else "give a machine file by --machine",
        )
    return _described(loaded, drives[axis])


def described_drives(machine: Machine) -> Iterator[Described]:
    """Every CiA 402 drive of a machine, by axis; ConfigurationError: MC008 an EDS."""
    for drive in drives_of(machine):
        yield _described(machine, drive)


def _described(machine: Machine, drive: DriveSettings) -> Described:
    dictionary = dictionary_of(drive)
    axis = next(axis for axis in machine.axes if axis.index == drive.axis)
    return Described(drive, axis, dictionary, parameters_of(dictionary, drive.node_axis))


def drives_of(machine: Machine) -> list[DriveSettings]:
    """CiA 402 drives of a machine, by axis."""
    return [drive for drive in settings_of(machine) if drive.kind == "cia402"]


def as_json(parameter: Parameter) -> dict[str, object]:
    """Return what JSON answers say of a parameter."""
    return {
        "index": parameter.index,
        "subindex": parameter.subindex,
        "name": parameter.name,
        "type": parameter.type,
        "access": parameter.access,
        "low": parameter.low,
        "high": parameter.high,
    }


def table(titles: Iterable[str], rows: Iterable[Sequence[str]]) -> Table:
    """Return a table whose cells are text as it is."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in titles:
        table.add_column(title)
    for row in rows:
        # texts of drives and their files are no markup
        table.add_row(*map(Text, row))
    return table
