"""``[recovery]``: how axes move to the point where a program resumes in its middle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import msgspec
from msgspec import Meta

from mcserver.machine.section_reader import Mistakes

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis

AxisIndex = Annotated[int, Meta(ge=0, le=63, description="an axis of this file")]


class RecoverySection(msgspec.Struct, frozen=True):
    """``[recovery]`` as written.

    Attributes:
        safe_axis, safe_position: this axis moves here first [mm, deg], and to its target last.
        approach_velocity: of the safe axis, and of all moves without one [mm/s]; for rotary axes, and by
            default, a tenth of the axis's limit.
        order: groups of axes, each moved after the one before has arrived; other axes come last.
        settle_s: wait after outputs or the spindle were switched.
    """

    safe_axis: AxisIndex | None = None
    safe_position: float | None = None
    approach_velocity: Annotated[float, Meta(gt=0.0, description="give mm/s above 0")] | None = None
    order: list[Annotated[list[AxisIndex], Meta(min_length=1)]] = []
    settle_s: Annotated[float, Meta(ge=0.0, le=600.0, description="2 is usual")] = 2.0


class Recovery(msgspec.Struct, frozen=True):
    """`RecoverySection` in SI; ``safe_axis`` None: the machine has no safe height."""

    safe_axis: int | None = None
    safe_position: float = 0.0
    approach_velocity: float | None = None
    order: tuple[tuple[int, ...], ...] = ()
    settle_s: float = 2.0


def read_recovery(
    section: RecoverySection | None, axes: Mapping[int, Axis], mistakes: Mistakes
) -> Recovery | None:
    """Return the section in SI, checked against the machine's axes; None if missing or faulty."""
    if section is None:
        return None
    if (section.safe_axis is None) != (section.safe_position is None):
        mistakes.add(
            ("recovery",), "safe_axis and safe_position belong together", "give both, or leave both out"
        )
        return None
    if section.safe_axis is None and not section.order:
        mistakes.add(
            ("recovery",), "names neither a safe height nor an order", "give safe_axis and safe_position"
        )
    named = [axis for group in section.order for axis in group]
    if section.safe_axis is not None:
        named.append(section.safe_axis)
    missing = [str(axis) for axis in named if axis not in axes]
    if missing:
        mistakes.add(("recovery",), f"the machine has no axis {', '.join(missing)}", "name axes of this file")
        return None
    if len(set(named)) < len(named):
        mistakes.add(
            ("recovery",), "names an axis twice", "name each once; the safe axis is not in the order"
        )
    position = 0.0
    if section.safe_axis is not None and section.safe_position is not None:
        axis = axes[section.safe_axis]
        position = section.safe_position * axis.type.si_per_unit
        if not axis.min_position <= position <= axis.max_position:
            mistakes.add(
                ("recovery", "safe_position"),
                f"{section.safe_position:g} is outside the travel of axis {axis.index}",
                "put it between min_position and max_position",
            )
    velocity = section.approach_velocity
    return Recovery(
        safe_axis=section.safe_axis,
        safe_position=position,
        approach_velocity=None if velocity is None else velocity * 1e-3,
        order=tuple(tuple(group) for group in section.order),
        settle_s=section.settle_s,
    )
