"""All that is wrong or doubtful in a machine file: what ``mcserver machine check`` lists."""

from __future__ import annotations

from mcserver.canopen.drive_faults import find_drive_faults
from mcserver.clearance.meter import find_clearance_faults
from mcserver.errors import Diagnostic
from mcserver.machine.machine_file import Machine
from mcserver.machine.plausibility import find_doubts, find_tool_faults
from mcserver.simulation.button_faults import find_button_faults


def find_machine_faults(machine: Machine, text: str) -> list[Diagnostic]:
    """Return errors and warnings of a machine file that could be read.

    Args:
        text: of the file, for the places of what is wrong.
    """
    return [
        *find_tool_faults(machine),
        *find_drive_faults(machine),
        *find_doubts(machine),
        *find_clearance_faults(machine),
        *(find_button_faults(machine, text) if machine.buttons else ()),
    ]
