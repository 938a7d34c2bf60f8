"""Tool paths for tests, and what a joint path makes the tool do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from mckinematics.pose import Array, JointPath, ToolPath, Triple
from mckinematics.solver import MachineKinematics

Point = Sequence[float] | Array


def line(
    start: Point,
    end: Point,
    start_angles: Triple | None = None,
    end_angles: Triple | None = None,
) -> ToolPath:
    """A straight line [m], with the orientation going from one triple to the other [rad]."""
    first, last = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    return ToolPath(
        lambda s: first + s[:, None] * (last - first),
        lambda s: np.tile(last - first, (len(s), 1)),
        start_angles,
        end_angles,
    )


def circle(
    centre: Point,
    first: Point,
    second: Point,
    sweep: float,
    start_angles: Triple | None = None,
    end_angles: Triple | None = None,
) -> ToolPath:
    """An arc from centre + first through centre + second (a quarter on), ``sweep`` rad long."""
    c, u, v = (np.asarray(part, dtype=float) for part in (centre, first, second))

    def position(s: Array) -> Array:
        angle = sweep * s[:, None]
        points: Array = c + np.cos(angle) * u + np.sin(angle) * v
        return points

    def derivative(s: Array) -> Array:
        angle = sweep * s[:, None]
        rates: Array = sweep * (np.cos(angle) * v - np.sin(angle) * u)
        return rates

    return ToolPath(position, derivative, start_angles, end_angles)


def joints_at(path: JointPath, s: Array) -> Array:
    """The spline at s, shape (n, K), written out anew."""
    cell = np.clip(np.searchsorted(path.knots, s, side="right") - 1, 0, len(path.knots) - 2)
    x = (s - path.knots[cell])[:, None]
    result = np.zeros((len(s), len(path.axes)))
    for row in path.coefficients:
        result = result * x + row[cell]
    return result


def ends_at(path: JointPath) -> dict[int, float]:
    """Axis positions at the path's end."""
    return dict(zip(path.axes, joints_at(path, np.ones(1))[0].tolist(), strict=True))


def tool_points(kinematics: MachineKinematics, tool: int, path: JointPath, s: Array) -> Array:
    """Where the tool is at s, shape (n, 3) [m]."""
    return np.array([kinematics.pose(tool, _named(path, row)).position for row in joints_at(path, s)])


def tool_angles(kinematics: MachineKinematics, tool: int, path: JointPath, s: Array) -> list[Triple]:
    """A B C of the tool at s [rad]."""
    return [kinematics.pose(tool, _named(path, row)).angles for row in joints_at(path, s)]


def largest_error(kinematics: MachineKinematics, tool: int, wanted: ToolPath, path: JointPath) -> float:
    """Largest distance of the tool from where it should be at the same s, at 800 places [m]."""
    s = np.linspace(0.0, 1.0, 801)
    points = tool_points(kinematics, tool, path, s)
    return float(np.linalg.norm(points - wanted.position(s), axis=1).max())


def follow(
    kinematics: MachineKinematics, tool: int, wanted: ToolPath, joints: Mapping[int, float]
) -> JointPath:
    """The joint path from these joints; holds that the tool is nowhere 10 µm off."""
    path = kinematics.solve_path(tool, wanted, joints)
    assert largest_error(kinematics, tool, wanted, path) < 1e-5
    return path


def _named(path: JointPath, row: Array) -> Mapping[int, float]:
    return dict(zip(path.axes, row.tolist(), strict=True))
