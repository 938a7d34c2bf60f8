"""The check of a machine's CiA 402 drives."""

from __future__ import annotations

from mcserver.errors import Diagnostic
from mcserver.machine.drive import CanDrive
from mcserver.machine.machine_file import Machine


def find_drive_faults(machine: Machine) -> list[Diagnostic]:
    """Check CiA 402 drives against their EDS files and the cycle.

    Errors MC008 and MC552: the machine cannot be run. Warnings MC022.
    """
    if not any(isinstance(axis.drive, CanDrive) for axis in machine.axes):
        return []
    # only such machines need these packages
    from mcserver.canopen.machine_file_check import check_drives

    return check_drives(machine)
