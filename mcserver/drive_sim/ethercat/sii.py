"""The EEPROM of a slave: identity, mailboxes, names, FMMUs and sync managers (ETG.2010)."""

from __future__ import annotations

import struct

from mcserver.drive_sim.described import Identity
from mcserver.drive_sim.ethercat.registers import PROCESS_MEMORY

MAILBOX_BYTES = 128
MAILBOX_OUT_AT = PROCESS_MEMORY
MAILBOX_IN_AT = PROCESS_MEMORY + MAILBOX_BYTES
OUTPUTS_AT, INPUTS_AT = 0x1400, 0x1800
_COE = 0x04
# SDO, PDO assignment, PDO configuration
_COE_DETAILS = 0x0D
_STRINGS, _GENERAL, _FMMUS, _SYNC_MANAGERS, _END = 10, 30, 40, 41, 0xFFFF
_MAILBOX_OUT_CONTROL, _MAILBOX_IN_CONTROL, _OUTPUTS_CONTROL, _INPUTS_CONTROL = 0x26, 0x22, 0x64, 0x20


def eeprom_of(identity: Identity, name: str) -> bytes:
    """Return the bytes of the EEPROM of a slave with CoE, two mailboxes, outputs and inputs."""
    image = bytearray(0x80)
    numbers = (identity.vendor_id, identity.product_code, identity.revision, identity.serial_number)
    struct.pack_into("<4I", image, 2 * 0x08, *numbers)
    mailboxes = (MAILBOX_OUT_AT, MAILBOX_BYTES, MAILBOX_IN_AT, MAILBOX_BYTES)
    struct.pack_into("<4HH", image, 2 * 0x18, *mailboxes, _COE)
    struct.pack_into("<HH", image, 2 * 0x3E, 0x000F, 1)
    text = name.encode("ascii")[:40]
    general = bytearray(32)
    general[2] = general[3] = 1
    general[5] = _COE_DETAILS
    managers = (
        (MAILBOX_OUT_AT, MAILBOX_BYTES, _MAILBOX_OUT_CONTROL, 1),
        (MAILBOX_IN_AT, MAILBOX_BYTES, _MAILBOX_IN_CONTROL, 2),
        (OUTPUTS_AT, 0, _OUTPUTS_CONTROL, 3),
        (INPUTS_AT, 0, _INPUTS_CONTROL, 4),
    )
    for kind, content in (
        (_STRINGS, bytes((1, len(text))) + text),
        (_GENERAL, bytes(general)),
        (_FMMUS, bytes((1, 2))),
        (
            _SYNC_MANAGERS,
            b"".join(
                struct.pack("<HHBBBB", start, length, control, 0, 1, role)
                for start, length, control, role in managers
            ),
        ),
    ):
        padded = content + b"\x00" * (len(content) % 2)
        image += struct.pack("<HH", kind, len(padded) // 2) + padded
    return bytes(image + struct.pack("<H", _END) + b"\xff" * 16)
