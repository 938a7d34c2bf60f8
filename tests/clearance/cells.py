"""Servers on a virtual clock, of machines that name bodies."""

from __future__ import annotations

from collections.abc import Callable

from mcserver.service.program import Program
from mcserver.units import MM
from tests.service.virtual_cell import VirtualCell

# as of the fixture `start`
Start = Callable[..., VirtualCell]


def place(cell: VirtualCell, axis: int) -> float:
    """Where an axis is [mm]."""
    return cell.position(axis) / MM


def fault_of(program: Program) -> tuple[str, int]:
    """Code and line of a program's fault."""
    assert program.fault is not None, program.state
    return program.fault.code, program.fault.line
