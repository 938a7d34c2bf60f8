"""``compensation`` of an axis: backlash and errors of its pitch, taken away at the setpoint.

Corrections move the drive besides what is programmed. So that both together keep the axis's limits, a share
of these is kept from programs: what the table needs at these limits, and the rest for taking up backlash.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
from msgspec import Meta

from mcserver.machine.constraints import LEAST_STEP, ascending
from mcserver.machine.coupled_errors import CURVATURE, SLOPE, THIRD, Error, Limits, Mesh, square_errors_in_si
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.toml_positions import Path

# Share of velocity, acceleration and jerk that taking up backlash needs at the least.
LEAST_FOR_BACKLASH = 0.02


class CompensationSection(msgspec.Struct, frozen=True):
    """``compensation`` as written.

    Attributes:
        backlash: by which a motor turns on a reversal before the load follows [mm, deg].
        pitch_errors: position, and how much further than programmed the load is there, as a laser or a ball
            bar measures it [mm, deg].
        square_errors: another axis, and how much further the load is for 1000 mm of that one [mm].
        mesh: errors over two other axes, such as those of a bed.
        reserve: share of velocity, acceleration and jerk that is kept from programs for corrections.
    """

    backlash: Annotated[
        float, Meta(ge=0.0, le=10.0, description="0 to 10; leave the key out if it is not known")
    ] = 0.0
    pitch_errors: Annotated[
        list[tuple[float, Error]], Meta(description="points [position, error], of 10 mm or deg at most")
    ] = []
    square_errors: Annotated[list[tuple[int, float]], Meta(description="[axis, error for 1000 mm]")] = []
    mesh: Mesh | None = None
    reserve: Annotated[float, Meta(ge=0.02, le=0.5, description="0.1 is usual")] = 0.1


class Compensation(msgspec.Struct, frozen=True):
    """The same in SI; ``pitch_errors`` ascend, ``square_errors`` are slopes [m/m] by axis number.

    share: of the limits in the file that backlash gets. beside_pitch: that errors of pitch leave.
    """

    backlash: float
    pitch_errors: tuple[tuple[float, float], ...]
    reserve: float
    share: float
    square_errors: tuple[tuple[int, float], ...] = ()
    mesh: Mesh | None = None
    # recordings of before are without
    beside_pitch: float = 0.0


def read_compensation(
    section: CompensationSection | None, limits: Limits, scale: float, path: Path, mistakes: Mistakes
) -> Compensation | None:
    """Return the section in SI; None where it is missing or cannot be.

    Args:
        limits: of the axis, as in the file. scale: SI of a mm or degree.
    """
    if section is None:
        return None
    if not ascending([at for at, _ in section.pitch_errors]):
        what = f"the positions do not ascend by {LEAST_STEP} or more"
        mistakes.add((*path, "pitch_errors"), what, "sort them, each once")
        return None
    if section.mesh is not None and section.mesh.wrong:
        hint = "one position for each column and each row"
        mistakes.add((*path, "mesh"), section.mesh.wrong, hint, "MC092")
        return None
    if len({axis for axis, _ in section.square_errors}) < len(section.square_errors):
        mistakes.add((*path, "square_errors"), "an axis is there twice", "add its errors up", "MC092")
        return None
    errors = [(at * scale, error * scale) for at, error in section.pitch_errors]
    needed = max((_need(errors[n], errors[n + 1], limits) for n in range(len(errors) - 1)), default=0.0)
    left = section.reserve - needed
    if left < (LEAST_FOR_BACKLASH if section.backlash > 0.0 else 0.0):
        mistakes.add(
            (*path, "pitch_errors"),
            f"they change too fast: at the axis's limits they take {100 * needed:.1f} % of these",
            f"{100 * section.reserve:g} % are kept for it: put points further apart, or raise reserve",
        )
        return None
    return Compensation(
        section.backlash * scale,
        tuple(errors),
        section.reserve,
        left,
        square_errors_in_si(section.square_errors),
        None if section.mesh is None else section.mesh.scaled(scale),
        left,
    )


def _need(here: tuple[float, float], there: tuple[float, float], limits: Limits) -> float:
    """Return which share of the limits a step between two points takes, at these limits."""
    width, height = there[0] - here[0], abs(there[1] - here[1])
    velocity, acceleration, jerk = limits
    slope, curvature = SLOPE * height / width, CURVATURE * height / width**2
    third = THIRD * height / width**3
    shares = [slope, slope + curvature * velocity**2 / acceleration]
    if math.isfinite(jerk):
        shares.append(slope + (3.0 * curvature * velocity * acceleration + third * velocity**3) / jerk)
    return max(shares)
