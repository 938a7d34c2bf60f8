"""``pressure_advance`` of a printer's axis E: extra filament for the pressure in the nozzle.

K times the flow is added to E's position. The flow is E's speed where E is pushed while X, Y or Z move,
smoothed by a triangular mean over the smooth time. The addition is bounded, and programs get the rest of E's
limits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import msgspec
from msgspec import Meta

from mcserver.machine.constraints import NotNegative, Positive
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.toml_positions import Path
from mcserver.units import MM, AxisType

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis
    from mcserver.machine.dialect_section import Dialect

# numbers of X, Y and Z: filament that is pushed while they stand gets no advance
PATH_AXES = (0, 1, 2)
# the executor keeps accelerations to this multiple of their limits where a rate changes
ACCELERATION_SLACK = 1.01


class PressureAdvanceSection(msgspec.Struct, frozen=True):
    """``pressure_advance`` as written.

    Attributes:
        greatest_s, initial_s: greatest K that programs may set, and K at their start.
        flow: greatest flow of filament that gets the advance [mm/s].
        smooth_time_s: over which the flow is smoothed.
        per_mm: greatest filament per mm of path that gets the advance.
    """

    greatest_s: Annotated[float, Meta(gt=0.0, le=2.0, description="0.02 to 0.1 is usual, 1 with a long tube")]
    flow: Positive
    smooth_time_s: Annotated[float, Meta(ge=0.005, le=0.2, description="0.04 is usual")] = 0.04
    initial_s: NotNegative = 0.0
    per_mm: Annotated[float, Meta(gt=0.0, le=10.0, description="0.27 is Klipper's limit at 0.4 mm")] = 0.27


class PressureAdvance(msgspec.Struct, frozen=True):
    """`PressureAdvanceSection` in SI; ``flow`` [m/s], ``greatest``, ``initial`` and ``smooth_time`` [s]."""

    greatest: float
    initial: float
    flow: float
    smooth_time: float
    per_length: float

    def half(self, cycle_s: float) -> int:
        """Return half the smooth time in whole cycles, rounded up, which stays within the bounds."""
        return math.ceil(0.5 * self.smooth_time / cycle_s - 1e-9)

    @property
    def offset(self) -> float:
        """Greatest addition to E's position [m]."""
        return self.greatest * self.flow

    @property
    def velocity(self) -> float:
        """Greatest addition to E's velocity [m/s]: half of the triangle counts up, half down."""
        return 2.0 * self.offset / self.smooth_time

    @property
    def acceleration(self) -> float:
        """Greatest addition to E's acceleration [m/s²]: two ends less twice the middle."""
        return 8.0 * self.offset / self.smooth_time**2

    def jerk(self, slope: float) -> float:
        """Return the greatest addition to E's jerk [m/s³]; ``slope``: of the flow [m/s²]."""
        return 16.0 * self.greatest * slope / self.smooth_time**2


class Lead(msgspec.Struct, frozen=True):
    """Pressure advance as computed in the cycle.

    Attributes:
        column: of E. path: columns of X, Y and Z. weights: of the flow 0, 1, 2, … cycles ago.
    """

    column: int
    path: tuple[int, ...]
    weights: tuple[float, ...]
    own: PressureAdvance

    @classmethod
    def of(cls, axes: Mapping[int, Axis], delay: int, cycle_s: float) -> Lead | None:
        """Return the pressure advance of a machine; None if no axis has one.

        Args:
            axes: by column. delay: of all axes; the smoothing is centred on it [cycles].
        """
        for column, axis in axes.items():
            own = axis.pressure_advance
            if own is not None:
                half = own.half(cycle_s)
                rising = [(at + 1) / half**2 for at in range(half)]
                weights = (*[0.0] * (delay - half + 1), *rising, *rising[-2::-1])
                path = tuple(n for n, each in axes.items() if each.index in PATH_AXES)
                return cls(column, path, weights, own)
        return None


def check_advance(
    axes: Mapping[Path, Axis],
    sections: Mapping[Path, PressureAdvanceSection | None],
    dialect: Dialect,
    mistakes: Mistakes,
) -> Axis | None:
    """Return E with limits reduced by its advance; None: it has none, or cannot have it.

    Args:
        axes, sections: by the paths of the axes' sections.
    """
    path = next((path for path, section in sections.items() if section is not None), None)
    if path is None:
        return None
    section, axis, place = sections[path], axes[path], (*path, "pressure_advance")
    assert section is not None
    if axis.index != dialect.extruder:
        what = "it is not the axis E of a printer"
        mistakes.add(place, what, f'use [dialect] profile = "printer" and letters = {{ E = {axis.index} }}')
        return None
    others = {each.index: each for each in axes.values()}
    moved = [others[index] for index in PATH_AXES if index in others]
    besides = (axis.shaper, axis.compensation, axis.gantry, axis.follow)
    led = any(each.gantry is not None and each.gantry.leader == axis.index for each in axes.values())
    if axis.profiled or led or any(each is not None for each in besides):
        what = "its drive makes the profiles itself, or it has a shaper, a compensation, a pair or a leader"
        mistakes.add(place, what, "leave the other one out")
        return None
    if (
        axis.type is not AxisType.LINEAR
        or not moved
        or any(each.type is not AxisType.LINEAR for each in moved)
    ):
        mistakes.add(place, "E, X, Y and Z are to be linear, and one of these there", "leave it out")
        return None
    own = PressureAdvance(
        section.greatest_s, section.initial_s, section.flow * MM, section.smooth_time_s, section.per_mm
    )
    if own.initial > own.greatest:
        mistakes.add((*place, "initial_s"), "is above greatest_s", "give a smaller one")
        return None
    acceleration = axis.max_acceleration - own.acceleration
    along = own.per_length * math.hypot(*(each.max_acceleration for each in moved))
    jerk = own.jerk(ACCELERATION_SLACK * max(acceleration, along))
    left = {
        "max_velocity": axis.max_velocity - own.velocity,
        "max_acceleration": acceleration,
        # an infinite limit stays infinite
        "max_jerk": axis.max_jerk - jerk,
        "max_position": axis.max_position - own.offset,
    }
    for key, value in left.items():
        if value <= (axis.min_position if key == "max_position" else 0.0):
            least = (getattr(axis, key) - value) / MM
            what = f"nothing is left of {key} of E: pressure advance needs {least:g} of it"
            mistakes.add(
                place, what, f"give a smaller greatest_s or flow, a longer smooth_time_s or more {key}"
            )
            return None
    return msgspec.structs.replace(axis, pressure_advance=own, **left)
