"""From a machine to its buses: one bus for each kind of drive, more where a kind needs it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from mcserver.drives.bus import DriveBus
from mcserver.drives.can_bus import CanBus
from mcserver.drives.ideal import IdealBus
from mcserver.drives.simulated import SimulatedBus
from mcserver.errors import ConfigurationError
from mcserver.machine.io_process_data import nodes_on
from mcserver.machine.machine_file import Axis, Machine

BusFactory = Callable[[Machine, Sequence[Axis], Sequence[int]], list[DriveBus]]


def _ideal(_machine: Machine, axes: Sequence[Axis], columns: Sequence[int]) -> list[DriveBus]:
    return [IdealBus(axes, columns)]


def _simulated(machine: Machine, axes: Sequence[Axis], columns: Sequence[int]) -> list[DriveBus]:
    return [SimulatedBus(axes, columns, machine.cycle_s)]


def _on_can(machine: Machine, _axes: Sequence[Axis], columns: Sequence[int]) -> list[DriveBus]:
    buses: list[DriveBus] = []
    for bus in machine.buses:
        own = [column for column in columns if machine.axes[column].drive.bus == bus.name]
        if own:
            buses.append(CanBus(machine, bus, own))
    return buses


# Kind of drive → what makes its buses; kinds with the same maker share buses. A new kind is an entry here and
# in the table below.
BUS_FACTORIES: Mapping[str, BusFactory] = MappingProxyType(
    {"ideal": _ideal, "simulated": _simulated, "cia402": _on_can, "servosila": _on_can}
)
# The same on a virtual clock, where there is no hardware: drives on a bus are simulated.
VIRTUAL_FACTORIES: Mapping[str, BusFactory] = MappingProxyType(
    {"ideal": _ideal, "simulated": _simulated, "cia402": _simulated, "servosila": _simulated}
)


def create_buses(machine: Machine, factories: Mapping[str, BusFactory] = BUS_FACTORIES) -> list[DriveBus]:
    """Buses that together drive every axis of the machine once; nothing is opened before their `boot`.

    Args:
        factories: kind of drive → a function of (machine, axes of that kind, their columns).

    Raises:
        ConfigurationError: MC006 a kind of drive that this installation cannot drive.
    """
    by_factory: dict[BusFactory, list[int]] = {}
    for column, axis in enumerate(machine.axes):
        factory = factories.get(axis.drive.kind)
        if factory is None:
            raise ConfigurationError(
                "MC006",
                f"axis {axis.index} has a drive of kind {axis.drive.kind!r}, "
                "which this installation cannot drive",
                f'set kind = "simulated" there, or one of: {", ".join(sorted(factories))}',
            )
        by_factory.setdefault(factory, []).append(column)
    buses: list[DriveBus] = []
    for factory, columns in by_factory.items():
        buses += factory(machine, [machine.axes[column] for column in columns], columns)
    if factories is BUS_FACTORIES:
        buses += _for_io_alone(machine, buses)
    return buses


def _for_io_alone(machine: Machine, buses: Sequence[DriveBus]) -> list[DriveBus]:
    """Make the CAN buses that have inputs and outputs, but no drives."""
    made = {bus.config.name for bus in buses if isinstance(bus, CanBus)}
    return [
        CanBus(machine, bus, [])
        for bus in machine.buses
        if bus.name not in made and nodes_on(machine, bus.name)
    ]
