"""From a machine to its buses: one bus for each kind of drive, more where a kind needs it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from mcserver.config import Axis, Machine
from mcserver.drives.bus import DriveBus
from mcserver.drives.ideal import IdealBus
from mcserver.drives.simulated import SimulatedBus
from mcserver.errors import ConfigurationError

BusFactory = Callable[[Machine, Sequence[Axis], Sequence[int]], list[DriveBus]]


def _ideal(_machine: Machine, axes: Sequence[Axis], columns: Sequence[int]) -> list[DriveBus]:
    return [IdealBus(axes, columns)]


def _simulated(machine: Machine, axes: Sequence[Axis], columns: Sequence[int]) -> list[DriveBus]:
    return [SimulatedBus(axes, columns, machine.cycle_s)]


# Kind of drive → what makes its buses. A new kind is one entry here.
BUS_FACTORIES: Mapping[str, BusFactory] = MappingProxyType({"ideal": _ideal, "simulated": _simulated})


def create_buses(machine: Machine, factories: Mapping[str, BusFactory] = BUS_FACTORIES) -> list[DriveBus]:
    """Buses that together drive every axis of the machine once.

    Args:
        factories: kind of drive → a function of (machine, axes of that kind, their columns).

    Raises:
        ConfigurationError: MC006 a kind of drive that this installation cannot drive.
    """
    by_kind: dict[str, list[int]] = {}
    for column, axis in enumerate(machine.axes):
        by_kind.setdefault(axis.drive.kind, []).append(column)
    buses: list[DriveBus] = []
    for kind, columns in by_kind.items():
        factory = factories.get(kind)
        if factory is None:
            axis = machine.axes[columns[0]]
            raise ConfigurationError(
                "MC006",
                f"axis {axis.index} has a drive of kind {kind!r}, which this installation cannot drive",
                f'set kind = "simulated" there, or one of: {", ".join(sorted(factories))}',
            )
        buses += factory(machine, [machine.axes[column] for column in columns], columns)
    return buses
