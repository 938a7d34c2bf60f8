"""The check of a machine's CiA 402 drives, where the packages for them are installed."""

from __future__ import annotations

import importlib.util

from mcserver.errors import Diagnostic
from mcserver.machine.drive import CanDrive
from mcserver.machine.machine_file import Machine


def find_drive_faults(machine: Machine) -> list[Diagnostic]:
    """Check CiA 402 drives against their EDS files and the cycle.

    Errors MC008 and MC552: the machine cannot be run. Warnings MC022. Nothing where the packages for drives
    on a CAN bus are missing, which `mcserver.machine.plausibility.find_doubts` says.
    """
    if importlib.util.find_spec("canopen") is None or importlib.util.find_spec("can") is None:
        return []
    if not any(isinstance(axis.drive, CanDrive) for axis in machine.axes):
        return []
    # only such machines need these packages
    from mcserver.canopen.machine_file_check import check_drives

    return check_drives(machine)
