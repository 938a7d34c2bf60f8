"""Payloads about work coordinate systems and the tool table, as `mcserver.net.messages`."""

from __future__ import annotations

import msgspec

from mcserver.net.messages import Request, WorkOffset
from mcserver.service.work_offsets import TableChange as TableChange


class TablesRequest(Request, frozen=True, kw_only=True):
    """The tables that programs start with."""


class ToolRow(msgspec.Struct, frozen=True):
    """A line of the tool table [mm], for G43; ``changed``: by G10 L1, not as the machine file has it."""

    number: int
    length: float
    diameter: float
    changed: bool = False


class Tables(msgspec.Struct, frozen=True):
    """What programs start with, and who changed it.

    Attributes:
        offsets: systems that were set; the others read zero at the machine's zero.
        tool_table: whether the machine's programs have one: G43 and G10 L1 exist.
        tools: in the order of their numbers.
        changes: the newest first.
    """

    offsets: list[WorkOffset]
    tool_table: bool
    tools: list[ToolRow]
    changes: list[TableChange]
