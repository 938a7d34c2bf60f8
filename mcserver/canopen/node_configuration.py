"""Identification and configuration of one node by SDO, whatever bus its mailbox or server is on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from mcserver.canopen.abort_codes import ABSENT, OUT_OF_RANGE, UNMAPPABLE
from mcserver.canopen.canopen_errors import DriveError, object_text
from mcserver.canopen.configuration import mode_refusal
from mcserver.canopen.node import Identity, NodeAxis
from mcserver.canopen.profiles import CIA_401, CIA_402, device_text
from mcserver.canopen.sdo_write import SdoWrite
from mcserver.canopen.settings import DriveSettings


class SdoClient(Protocol):
    """Reads and writes objects of one node; `mcserver.canopen.sdo.NodeSdo`."""

    def upload(self, index: int, subindex: int, *, attempts: int = 0) -> bytes:
        """Read an object. Raises: DriveError MC553 it is refused, MC554 no answer."""

    def download(self, index: int, subindex: int, payload: bytes, *, attempts: int = 0) -> None:
        """Write an object. Raises: as `upload`."""


class ConfiguredNode(Protocol):
    """What is known of a node, and filled in by its configuration.

    Attributes:
        settings: of its first axis. axes: all of them. identity: 1000h and 1018h.
        dropped: PDOs that it refused. remarks: what it did without, in words.
    """

    settings: DriveSettings
    axes: tuple[NodeAxis, ...]
    identity: Identity
    dropped: frozenset[str]
    remarks: tuple[str, ...]


def configure_node(
    node: ConfiguredNode, sdo: SdoClient, writes: Sequence[SdoWrite], check: Callable[[], None]
) -> None:
    """Check who it is, and write its configuration.

    Args:
        check: called between transfers; raises `Stopped`.

    Raises:
        DriveError: MC551 it is another device, MC553, MC554. Stopped.
    """
    node.identity = _identify(node, sdo)
    if node.settings.kind == "cia402":
        for axis in node.axes:
            _check_mode(axis.settings, sdo)
    remarks: list[str] = []
    dropped: set[str] = set()
    for write in writes:
        check()
        if write.spare_pdo in dropped:
            continue
        try:
            _write(node, sdo, write)
        except DriveError as error:
            code = error.details.get("abort_code")
            if write.spare_pdo and code in UNMAPPABLE:
                dropped.add(write.spare_pdo)
                remarks.append(f"{write.spare_pdo} is not used: {error.message}")
            elif write.optional and code in ABSENT:
                place = object_text(write.index, write.subindex)
                remarks.append(f"{place} is not there: no {write.what}")
            elif write.doubt and error.code == "MC551":
                remarks.append(f"{object_text(write.index, write.subindex)}: {write.doubt}")
            elif write.instead and code in OUT_OF_RANGE:
                remarks.append(_write_instead(sdo, write))
            else:
                raise DriveError(
                    error.code,
                    f"{error.message} ({write.what})",
                    write.remedy if write.remedy and code in OUT_OF_RANGE | ABSENT else error.hint,
                    axis=node.settings.axis,
                    **error.details,
                ) from None
    node.dropped = frozenset(dropped)
    node.remarks = tuple(remarks)


def _write(node: ConfiguredNode, sdo: SdoClient, write: SdoWrite) -> None:
    if write.unless is None and not write.verify:
        sdo.download(write.index, write.subindex, write.payload)
        return
    held = sdo.upload(write.index, write.subindex)
    if write.unless is not None:
        if held != write.unless:
            sdo.download(write.index, write.subindex, write.payload)
    elif held != write.payload:
        found, said = (int.from_bytes(value, "little") for value in (held, write.payload))
        raise node.settings.fault(
            "MC551",
            f"{object_text(write.index, write.subindex)} holds 0x{found:X}, the EDS says 0x{said:X}",
            "another firmware, or a mapping that was changed: take the EDS of this firmware, or bring "
            "the drive back to its defaults",
        )


def _write_instead(sdo: SdoClient, write: SdoWrite) -> str:
    """Write what serves nearly as well; return what was written, in words.

    Raises:
        DriveError: MC553 for another reason than the value, MC554.
    """
    place = object_text(write.index, write.subindex)
    wanted = int.from_bytes(write.payload, "little")
    for payload in write.instead:
        try:
            sdo.download(write.index, write.subindex, payload)
        except DriveError as error:
            if error.details.get("abort_code") not in OUT_OF_RANGE:
                raise
            continue
        taken = int.from_bytes(payload, "little")
        return f"{place} does not take {wanted} ({write.what}): it has {taken} now"
    return f"{place} takes no value that is of use: no {write.what}"


def _check_mode(settings: DriveSettings, sdo: SdoClient) -> None:
    """Compare the mode with what the drive itself says that it has (6502h)."""
    try:
        supported = int.from_bytes(sdo.upload(0x6502 + settings.offset, 0), "little")
    except DriveError as error:
        if error.details.get("abort_code") is not None:
            return
        raise
    refusal = mode_refusal(settings, supported) if supported else None
    if refusal is not None:
        raise settings.fault("MC551", f"{object_text(0x6502 + settings.offset, 0)}: {refusal[0]}", refusal[1])


def _identify(node: ConfiguredNode, sdo: SdoClient) -> Identity:
    settings = node.settings
    device_type = int.from_bytes(sdo.upload(0x1000, 0)[:4], "little")
    what, profile = ("an I/O node", CIA_401) if settings.kind == "cia401" else ("a drive", CIA_402)
    if device_type & 0xFFFF != profile:
        raise settings.fault(
            "MC551",
            f"it is {device_text(device_type)}, not {what} (CiA {profile}); 1000h = 0x{device_type:08X}",
            "check the node number, or the drive's configured profile",
        )
    vendor, product = (_identity_entry(sdo, subindex) for subindex in (1, 2))
    for subindex, what, wanted, found in (
        (1, "vendor_id", settings.vendor_id, vendor),
        (2, "product_code", settings.product_code, product),
    ):
        if wanted and found != wanted:
            shown = "nothing" if found is None else f"0x{found:08X}"
            raise settings.fault(
                "MC551",
                f"{object_text(0x1018, subindex)} says {shown}, the machine file {what} = 0x{wanted:08X}",
                "another drive has this node number, or the machine file is not of this machine",
            )
    return Identity(device_type, vendor, product)


def _identity_entry(sdo: SdoClient, subindex: int) -> int | None:
    try:
        return int.from_bytes(sdo.upload(0x1018, subindex)[:4], "little")
    except DriveError as error:
        if error.details.get("abort_code") in ABSENT:
            return None
        raise
