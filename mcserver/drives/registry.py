"""From a machine to its buses: one bus for each kind of drive, more where a kind needs it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType

from mcserver.can.port import CanPort
from mcserver.drives.bus import DriveBus
from mcserver.drives.ideal import IdealBus
from mcserver.drives.simulated import SimulatedBus
from mcserver.errors import ConfigurationError
from mcserver.machine.axis import Axis
from mcserver.machine.bus_section import BusConfig
from mcserver.machine.drive import CanDrive, Drive, IdealDrive
from mcserver.machine.io_process_data import nodes_on
from mcserver.machine.machine_file import Machine

BusFactory = Callable[[Machine, Sequence[Axis], Sequence[int]], list[DriveBus]]
# From a machine and one of its buses to a port on it.
BusOpener = Callable[[Machine, BusConfig], CanPort]


def _ideal(_machine: Machine, axes: Sequence[Axis], columns: Sequence[int]) -> list[DriveBus]:
    return [IdealBus(axes, columns)]


def _simulated(machine: Machine, axes: Sequence[Axis], columns: Sequence[int]) -> list[DriveBus]:
    return [SimulatedBus(axes, columns, machine.cycle_s)]


def on_buses(openers: Mapping[str, BusOpener] = MappingProxyType({})) -> BusFactory:
    """Return what makes the buses of a machine file.

    Args:
        openers: by kind of a bus that is no CAN bus.
    """

    def make(machine: Machine, axes: Sequence[Axis], columns: Sequence[int]) -> list[DriveBus]:
        # an executor without such drives starts without their code
        from mcserver.drives.can_bus import CanBus
        from mcserver.drives.cia402.loop_gains import ETHERCAT_DELAY_CYCLES

        on: dict[str, list[int]] = {bus.name: [] for bus in machine.buses}
        for axis, column in zip(axes, columns, strict=True):
            on[machine.bus_of(axis).name].append(column)
        made: list[DriveBus] = []
        for bus in machine.buses:
            # one without drives may have inputs and outputs
            if not on[bus.name] and not nodes_on(machine, bus.name):
                continue
            if bus.kind == "can":
                made.append(CanBus(machine, bus, on[bus.name]))
                continue
            opener = partial(_opened, openers.get(bus.kind), machine, bus)
            made.append(CanBus(machine, bus, on[bus.name], opener=opener, delay_cycles=ETHERCAT_DELAY_CYCLES))
        return made

    return make


def _opened(opener: BusOpener | None, machine: Machine, bus: BusConfig, _address: str) -> CanPort:
    if opener is None:
        raise ConfigurationError(
            "MC006",
            f"bus {bus.name} is of kind {bus.kind!r}, which is driven by the executor's process alone",
            "run it by `mcserver run`",
        )
    return opener(machine, bus)


# Type of drive → what makes its buses; a drive has the one of its nearest type.
BUS_FACTORIES: Mapping[type[Drive], BusFactory] = MappingProxyType(
    {Drive: _simulated, IdealDrive: _ideal, CanDrive: on_buses()}
)
# The same on a virtual clock, where there is no hardware: drives on a bus are simulated.
VIRTUAL_FACTORIES: Mapping[type[Drive], BusFactory] = MappingProxyType(
    {Drive: _simulated, IdealDrive: _ideal}
)


def create_buses(
    machine: Machine, factories: Mapping[type[Drive], BusFactory] = BUS_FACTORIES
) -> list[DriveBus]:
    """Buses that together drive every axis of the machine once; nothing is opened before their `boot`.

    Args:
        factories: type of drive → a function of (machine, its axes, their columns).

    Raises:
        ConfigurationError: MC006 a kind of drive that this installation cannot drive.
    """
    by_factory: dict[BusFactory, list[int]] = {}
    if CanDrive in factories and any(nodes_on(machine, bus.name) for bus in machine.buses):
        # a bus may have inputs and outputs without any drive
        by_factory[factories[CanDrive]] = []
    for column, axis in enumerate(machine.axes):
        factory = next((factories[kind] for kind in type(axis.drive).__mro__ if kind in factories), None)
        if factory is None:
            raise ConfigurationError(
                "MC006",
                f"axis {axis.index} has a drive of kind {axis.drive.kind!r}, "
                "which this installation cannot drive",
                'set kind = "simulated" there',
            )
        by_factory.setdefault(factory, []).append(column)
    buses: list[DriveBus] = []
    for factory, columns in by_factory.items():
        buses += factory(machine, [machine.axes[column] for column in columns], columns)
    return buses
