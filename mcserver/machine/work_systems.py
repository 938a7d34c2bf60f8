"""Work coordinate systems: their codes, numbered from 1, and the angle by which one is turned."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, get_args

WorkSystem = Literal["G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3"]
WORK_SYSTEMS: tuple[WorkSystem, ...] = get_args(WorkSystem)
SYSTEM_NUMBERS: Mapping[str, int] = MappingProxyType(
    {code: number for number, code in enumerate(WORK_SYSTEMS, start=1)}
)
# in place of an axis: the angle about Z by which X and Y of a work system are turned (G10 L2 R) [rad]
ANGLE = -1
