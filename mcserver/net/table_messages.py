"""Payloads about work coordinate systems and the tool table, as `mcserver.net.messages`."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from mcserver.net.messages import Request
from mcserver.service.reports import WorkOffset
from mcserver.service.work_offsets import TableChange as TableChange


class TablesRequest(Request, frozen=True, kw_only=True):
    """The tables that programs start with."""


Minutes = Annotated[float, Meta(ge=0.0, le=1e6)]


class SetTableRowRequest(Request, frozen=True, kw_only=True):
    """Names a row of the tables, or sets how long a tool may cut; what is nil stays.

    Attributes:
        row: ``G54`` to ``G59.3``, or ``T3``. name: for people; empty removes it.
        life_min: how long the tool may cut; 0: no limit.
        used_min: how long it has cut, 0 when a new one is fitted.
        by: the person, if a client serves several.
    """

    row: Annotated[str, Meta(max_length=10)]
    name: Annotated[str, Meta(max_length=60)] | None = None
    life_min: Minutes | None = None
    used_min: Minutes | None = None
    by: Annotated[str, Meta(max_length=100)] = ""


class ToolRow(msgspec.Struct, frozen=True):
    """A line of the tool table [mm], for G43.

    Attributes:
        changed: by G10 L1, so that it differs from the machine file.
        life_min: how long it may cut; 0: not set. used_min: how long it has cut, counted in G01 to G03
            while its spindle turns.
    """

    number: int
    length: float
    diameter: float
    changed: bool = False
    name: str = ""
    life_min: float = 0.0
    used_min: float = 0.0


class Tables(msgspec.Struct, frozen=True):
    """The tables that programs start with, and who changed them.

    Attributes:
        offsets: systems that were set; the others read zero at the machine's zero.
        names: of systems, by system.
        tool_table: whether the machine's programs have one, with G43 and G10 L1.
        tools: in the order of their numbers.
        changes: the newest first.
    """

    offsets: list[WorkOffset]
    tool_table: bool
    tools: list[ToolRow]
    changes: list[TableChange]
    names: dict[str, str] = {}
