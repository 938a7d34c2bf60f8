"""A drive's own memory of its errors: 1001h, 1003h, 603Fh; and how far it is behind."""

from __future__ import annotations

import msgspec

from mcserver.canopen.desk import STATUSWORD, Desk
from mcserver.canopen.emergency_text import register_text
from mcserver.drives.cia402.emergency_codes import emergency_text
from mcserver.drives.cia402.state import power_state

REGISTER, HISTORY = 0x1001, 0x1003
MOST_ERRORS = 16


class DriveCondition(msgspec.Struct, frozen=True):
    """What a drive says of itself.

    Attributes:
        status: 6041h in words. register: 1001h in words. history: 1003h, newest first; empty strings and None
            where it does not say. line_errors: what its EtherCAT slave controller has counted, by port.
    """

    status: str
    register: str
    history: list[str] | None
    line_errors: dict[str, list[int]]


def condition_of(desk: Desk) -> DriveCondition:
    """Ask a drive for its condition.

    Raises:
        DriveError: MC554. RuntimeFault: MC560.
    """
    word = desk.read_number(STATUSWORD + desk.drive.offset)
    register = desk.read_number(REGISTER)
    count = desk.read_number(HISTORY)
    history = None
    if count is not None:
        entries = [desk.read_number(HISTORY, 1 + at) for at in range(min(count & 0xFF, MOST_ERRORS))]
        history = [_entry(each) for each in entries if each is not None]
    return DriveCondition(
        "" if word is None else power_state(word).name.lower().replace("_", " "),
        "" if register is None else register_text(register),
        history,
        desk.line_errors(),
    )


def _entry(entry: int) -> str:
    """Return the code of an entry in words, and the maker's sixteen bits behind it (CiA 301, 7.5.2.4)."""
    code, own = entry & 0xFFFF, entry >> 16 & 0xFFFF
    return f"{code:04X}h {emergency_text(code)}" + (f" ({own:04X}h)" if own else "")
