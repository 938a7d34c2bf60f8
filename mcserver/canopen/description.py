"""The file that describes a drive: EDS or DCF of CANopen, ESI of EtherCAT; one object dictionary of both."""

from __future__ import annotations

import hashlib
from pathlib import Path

from mcserver.canopen.dictionary import Description, DeviceDictionary, generic_dictionary
from mcserver.canopen.eds import parse_description
from mcserver.canopen.eds_text import MAX_BYTES, decode, fault
from mcserver.canopen.esi import parse_esi
from mcserver.canopen.esi_xml import is_xml
from mcserver.canopen.settings import DriveSettings
from mcserver.errors import ConfigurationError


def describe(drive: DriveSettings) -> Description:
    """Return a drive as its file describes it; without one with the standard's objects.

    Raises:
        ConfigurationError: MC008 the file cannot be read, MC036 it is not certain which of its devices the
            drive is.
    """
    if not drive.eds:
        return Description(generic_dictionary(drive.node))
    raw = _read(drive.eds)
    if is_xml(raw) and drive.fieldbus != "ethercat":
        raise ConfigurationError(
            "MC036",
            f"{drive.name}: {drive.eds} is an ESI file, of a drive on EtherCAT",
            "give the drive's EDS or DCF file, or leave eds out",
        )
    if is_xml(raw):
        found = parse_esi(raw, drive.node, drive.eds, drive.vendor_id, drive.product_code)
    else:
        found = parse_description(decode(raw), drive.node, drive.eds)
    found.dictionary.sha256 = hashlib.sha256(raw).hexdigest()
    return found


def dictionary_of(drive: DriveSettings) -> DeviceDictionary:
    """As `describe`, the objects alone."""
    return describe(drive).dictionary


def _read(path: str) -> bytes:
    try:
        if Path(path).stat().st_size > MAX_BYTES:
            raise fault(
                path, "", "", f"has more than {MAX_BYTES} bytes", "give the drive's EDS, DCF or ESI file"
            )
        return Path(path).read_bytes()
    except OSError as error:
        raise fault(
            path,
            "",
            "",
            f"the file cannot be read: {error.strerror or error}",
            "check `eds` in the machine file; relative paths start from the machine file's folder",
        ) from error
