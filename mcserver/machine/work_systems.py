"""Work coordinate systems: codes, numbers from 1, and the angle of a rotated one."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, get_args

WorkSystem = Literal["G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3"]
WORK_SYSTEMS: tuple[WorkSystem, ...] = get_args(WorkSystem)
SYSTEM_NUMBERS: Mapping[str, int] = MappingProxyType(
    {code: number for number, code in enumerate(WORK_SYSTEMS, start=1)}
)
# key instead of an axis: angle about Z by which a work system is rotated (G10 L2 R) [rad]
ANGLE = -1
