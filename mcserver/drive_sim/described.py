"""What the EDS or ESI file of a drive adds to its simulation: its identity, and its other objects."""

from __future__ import annotations

from dataclasses import dataclass

from mcserver.canopen.description import dictionary_of
from mcserver.canopen.dictionary import DeviceDictionary
from mcserver.canopen.settings import settings_of
from mcserver.drive_sim.dictionary import FORMATS, ObjectStore
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.machine.axis import Axis
from mcserver.machine.machine_file import Machine

# Communication is the simulation's own.
FIRST_INDEX = 0x2000
_IDENTITY = 0x1018
# CiA 301, table 44.
_VISIBLE_STRING = 9


@dataclass(frozen=True)
class Identity:
    """1018h; 0 keeps what the simulation's own EDS file says."""

    vendor_id: int = 0
    product_code: int = 0
    serial_number: int = 0
    revision: int = 0


def described(machine: Machine, axis: Axis) -> DeviceDictionary | None:
    """Return the objects of the file that an axis's drive has; None: it has no file.

    Raises:
        ConfigurationError: MC008, MC036 the file.
    """
    if not cia402_drive(axis).eds:
        return None
    return dictionary_of(next(drive for drive in settings_of(machine) if drive.axis == axis.index))


def identity_of(axis: Axis, dictionary: DeviceDictionary | None) -> Identity:
    """1018h: by the machine file, else by the drive's file."""
    drive = cia402_drive(axis)
    vendor = product = revision = 0
    if dictionary is not None and dictionary.coe.product_code:
        coe = dictionary.coe
        vendor, product, revision = coe.vendor_id, coe.product_code, coe.revision
    elif dictionary is not None:
        vendor, product, revision = (_default(dictionary, subindex) for subindex in (1, 2, 3))
    return Identity(drive.vendor_id or vendor, drive.product_code or product, 1000 + axis.index, revision)


def _default(dictionary: DeviceDictionary, subindex: int) -> int:
    found = dictionary.get_variable(_IDENTITY, subindex)
    return found.default if found is not None and isinstance(found.default, int) else 0


def add_objects(store: ObjectStore, dictionary: DeviceDictionary | None) -> None:
    """Give a simulated drive the objects of its file that it does not have: they keep what is written."""
    if dictionary is None or dictionary.generic:
        return
    known = (*FORMATS, _VISIBLE_STRING)
    store.add(each for each in dictionary.variables if each.index >= FIRST_INDEX and each.data_type in known)
