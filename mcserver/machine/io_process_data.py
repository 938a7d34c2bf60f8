"""Derive the PDOs of I/O nodes (CiA 401) from the machine file.

The objects of a node are packed in the order of the file, inputs into TPDOs, outputs into RPDOs.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from mcserver.can.cob import Function
from mcserver.can.pdo import MappedObject, MappedPdo, ProcessData
from mcserver.can.port import MAX_PAYLOAD
from mcserver.machine.drive import CanDrive, Drive
from mcserver.machine.io_object import IoObject
from mcserver.machine.io_section import Input, Output
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.toml_positions import Path

if TYPE_CHECKING:
    from mcserver.machine.machine_file import Machine

Key = tuple[int, int]  # index, subindex

# Heartbeat period that a node is configured to.
HEARTBEAT_MS = 100
_TPDOS = (Function.TPDO1, Function.TPDO2, Function.TPDO3, Function.TPDO4)
_RPDOS = (Function.RPDO1, Function.RPDO2, Function.RPDO3, Function.RPDO4)
SYNCHRONOUS = 1
AT_ONCE = 255


def nodes_on(machine: Machine, bus: str) -> list[int]:
    """Return the numbers of a bus's nodes with inputs or outputs."""
    return sorted({each.node for each in _objects(machine) if each.bus == bus})


def io_process_data(machine: Machine, bus: str, node: int) -> ProcessData:
    """Return the PDOs of a node's inputs and outputs.

    Raises:
        ValueError: they do not fit four PDOs either way.
    """
    inputs, outputs = objects_of(machine, bus, node)
    return ProcessData(
        rpdos=_pack(outputs, [function + node for function in _RPDOS], AT_ONCE),
        tpdos=_pack(inputs, [function + node for function in _TPDOS], SYNCHRONOUS),
    )


def _objects(machine: Machine) -> list[IoObject]:
    every = [*(each.source for each in machine.inputs), *(each.target for each in machine.outputs)]
    return [each for each in every if each is not None and each.axis < 0]


def objects_of(machine: Machine, bus: str, node: int) -> tuple[dict[Key, str], dict[Key, str]]:
    """Return the types of a node's input and output objects."""
    inputs = [each.source for each in machine.inputs]
    outputs = [each.target for each in machine.outputs]
    return own_objects(inputs, bus, node), own_objects(outputs, bus, node)


def own_objects(objects: Iterable[IoObject | None], bus: str, node: int) -> dict[Key, str]:
    """Return a node's objects and their types, each once."""
    return {
        (each.index, each.subindex): each.type
        for each in objects
        if each is not None and each.axis < 0 and (each.bus, each.node) == (bus, node)
    }


def _pack(objects: dict[Key, str], cob_ids: list[int], transmission: int) -> tuple[MappedPdo, ...]:
    pdos: list[list[MappedObject]] = [[]]
    for (index, subindex), kind in objects.items():
        mapped = MappedObject(index, subindex, int(kind[1:]))
        if sum(each.bits for each in pdos[-1]) + mapped.bits > 8 * MAX_PAYLOAD:
            pdos.append([])
        pdos[-1].append(mapped)
    pdos = [pdo for pdo in pdos if pdo]
    if len(pdos) > len(cob_ids):
        raise ValueError(f"{len(objects)} objects do not fit {len(cob_ids)} PDOs")
    return tuple(
        MappedPdo(number, cob_id, tuple(pdo), transmission)
        for number, (pdo, cob_id) in enumerate(zip(pdos, cob_ids, strict=False), 1)
    )


def check_nodes(
    inputs: Iterable[Input],
    outputs: Iterable[Output],
    drives: Iterable[tuple[Path, int, Drive]],
    mistakes: Mistakes,
) -> None:
    """Refuse I/O nodes that are drives, or whose objects do not fit their PDOs.

    Args:
        drives: path of the section, number of the axis, drive.
    """
    of_drives = {(drive.bus, drive.node): axis for _, axis, drive in drives if isinstance(drive, CanDrive)}
    for kind, objects in (
        ("input", [(each.name, each.source) for each in inputs]),
        ("output", [(each.name, each.target) for each in outputs]),
    ):
        every = [each for _, each in objects]
        for name, each in objects:
            if each is None or each.axis >= 0:
                continue
            axis = of_drives.get((each.bus, each.node))
            if axis is not None:
                mistakes.add(
                    (kind,),
                    f'"{name}" is on node {each.node} of {each.bus}, the drive of axis {axis}',
                    f"name the drive: {{ drive = {axis}, bit = … }} is a bit of its 60FDh or 60FEh",
                )
            if not _fits(own_objects(every, each.bus, each.node)):
                mistakes.add(
                    (kind,),
                    f"node {each.node} of {each.bus} has more {kind}s than four PDOs hold",
                    "spread them over two nodes",
                )
                return


def _fits(objects: dict[Key, str]) -> bool:
    try:
        _pack(objects, [0] * len(_TPDOS), AT_ONCE)
    except ValueError:
        return False
    return True
