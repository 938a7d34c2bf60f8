"""Check axes and positions in requests against the machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mcserver.errors import Refused
from mcserver.machine.axis import Axis
from mcserver.machine.machine_file import Machine


def axes_of(machine: Machine, axes: Sequence[int] | None) -> tuple[int, ...]:
    """Return the axes of a request, ascending and unique; by default all of the machine.

    Raises:
        ServiceError: MC507 the list is empty, or the machine has no such axis.
    """
    known = tuple(axis.index for axis in machine.axes)
    if axes is None:
        return known
    if not axes:
        raise Refused("MC507", "a lease needs an axis", "leave `axes` out for all")
    for axis in axes:
        if axis not in known:
            raise Refused(
                "MC507",
                f"the machine {machine.name} has no axis {axis}",
                f"it has {', '.join(map(str, known))}",
                axis=axis,
            )
    # the two drives of a gantry have one lease
    pairs = {frozenset(pair) for pair in machine.followers.items()}
    both = {each for pair in pairs if pair & set(axes) for each in pair}
    return tuple(sorted(both | set(axes)))


def axis_of(machine: Machine, index: int) -> Axis:
    """Return the axis of a request.

    Raises:
        ServiceError: MC507 no such axis.
    """
    axis = machine.axis(index)
    if axis is None:
        raise Refused("MC507", f"the machine {machine.name} has no axis {index}", "see `info`", axis=index)
    return axis


def positions_in_si(machine: Machine, positions: Mapping[str, float]) -> dict[int, float]:
    """Convert positions [mm, deg] by axis number as text to SI.

    Raises:
        ServiceError: MC507 no such axis.
    """
    found = {}
    for name, value in positions.items():
        axis = machine.axis(int(name)) if name.isdecimal() else None
        if axis is None:
            raise Refused(
                "MC507", f"the machine {machine.name} has no axis {name!r}", "see `info`", axis=name
            )
        found[axis.index] = value * axis.type.si_per_unit
    return found
