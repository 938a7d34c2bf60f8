"""Short lines of a tool on which all joints may go evenly: lines in joint space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mckinematics.next_pose import solve_near
from mckinematics.path_solver import CLEAR_GAIN
from mckinematics.pose import Array, BoolArray
from mckinematics.rotation import euler_to_matrix, rotation_matrices, rotation_vectors
from mckinematics.target_path import START_TOLERANCE
from mckinematics.tool import Targets, ToolModel

# shares of a line at which the tool is compared with it
SAMPLES = np.linspace(0.0, 1.0, 5)
SAMPLES.setflags(write=False)
# how far the end may be off its pose [m], [rad]: what Newton's last step leaves, far below `START_TOLERANCE`
END_TOLERANCE = 1e-7


@dataclass(frozen=True)
class EvenPaths:
    """Consecutive lines, n of them, on each of which all joints go evenly.

    Attributes:
        joints: where the first begins and where each ends, shape (n+1, K).
        fastest: the tool's greatest speed by the share of its line, shape (n,) [m].
        rates: of the tool by those of the joints at both ends of each, shape (n, 2, 3 or 6, K).
        off [m], off_angle [rad]: how far the tool is off each line, shape (n,).
    """

    joints: Array
    fastest: Array
    rates: Array
    off: Array
    off_angle: Array

    def __len__(self) -> int:
        return len(self.fastest)

    @classmethod
    def of(cls, joints: Array, rates: Array, residual: Array) -> EvenPaths:
        """Return the lines between ``joints``, shape (n+1, K).

        Args:
            rates, residual: at `SAMPLES` of each line, the tool's rates, shape (n, 5, rows, K), and what it
                misses its line by, shape (n, 5, rows) [m, rad].
        """
        travels = np.diff(joints, axis=0)
        moved = np.einsum("nsij,nj->nsi", rates[:, :, :3], travels)
        fastest = np.linalg.norm(moved, axis=2).max(axis=1)
        off, off_angle = (
            np.linalg.norm(part, axis=2).max(axis=1) for part in (residual[..., :3], residual[..., 3:])
        )
        return cls(joints, fastest, rates[:, :: len(SAMPLES) - 1], off, off_angle)

    def first(self, count: int) -> EvenPaths:
        """Return the first ``count`` lines."""
        return EvenPaths(
            self.joints[: count + 1],
            self.fastest[:count],
            self.rates[:count],
            self.off[:count],
            self.off_angle[:count],
        )


def leading(sound: BoolArray) -> int:
    """Return the length of the leading run of True."""
    return len(sound) if sound.all() else int(sound.argmin())


def samples_of(joints: Array) -> Array:
    """Return the joints at `SAMPLES` of each line, shape (n·5, K)."""
    starts, travels = joints[:-1, None], np.diff(joints, axis=0)[:, None]
    return np.asarray((starts + SAMPLES[:, None] * travels).reshape(-1, joints.shape[1]))


def solve_even_paths(tool: ToolModel, points: Array, angles: Array | None, joints: Array) -> EvenPaths:
    """Return the joints going evenly along consecutive lines of a tool, from the first on while they may.

    Args:
        points: where the first line begins and where each ends, shape (n+1, 3) [m]. angles: A, B, C there,
            shape (n+1, 3) [rad], of a tool with orientation. joints: at the first, shape (K,).

    Returns:
        Ends before a line whose end is not near or past a limit, or on which joints go wild. No line where
        the joints are not at the first place, or where the chain has too few joints for poses. The tool's
        path solver (`solve_tool_path`) decides then.
    """
    rotations = None if angles is None or not tool.orientation else _matrices(angles, tool.euler)
    targets = Targets(points, rotations)
    found = [joints]
    if tool.rank == tool.rows and _begins(tool, targets, joints):
        for index in range(1, len(points)):
            end = solve_near(tool, targets.rows(slice(index, index + 1)), found[-1])
            if end is None:
                break
            found.append(end)
    followed = np.array(found)
    count = len(followed) - 1
    return _sound(tool, followed, targets.rows(slice(1, count + 1)))


def _begins(tool: ToolModel, targets: Targets, joints: Array) -> bool:
    """Return whether the tool is at the first target."""
    missing = tool.residual(joints[None], targets.rows(slice(0, 1)))
    return bool(np.abs(missing).max() <= START_TOLERANCE)


def _sound(tool: ToolModel, joints: Array, ends: Targets) -> EvenPaths:
    """Return the lines up to the first that misses its end, or on which joints go wild."""
    travels = np.diff(joints, axis=0)
    residual, rates = tool.linearise(samples_of(joints), _along(tool, joints, ends))
    shape = (len(travels), len(SAMPLES), tool.rows)
    residual, rates = residual.reshape(shape), rates.reshape(*shape, joints.shape[1])
    # beside a singular position a short step may be small without closing the gap
    sound = np.abs(residual[:, -1]).max(axis=1, initial=0.0) <= END_TOLERANCE
    missing = tool.residual(joints[:-1], ends)
    sound &= ~(tool.joint_speed(travels) > CLEAR_GAIN * tool.tool_speed(missing))
    return EvenPaths.of(joints, rates, residual).first(leading(sound))


def _along(tool: ToolModel, joints: Array, ends: Targets) -> Targets:
    """Return the targets at `SAMPLES` of lines that begin where the tool is: at joints (n+1, K) but the last.

    The tool turns about one axis, evenly (D-51).
    """
    starts, turned = tool.chain.forward(joints[:-1])
    shares = SAMPLES[:, None]
    positions = (starts[:, None] + shares * (ends.positions - starts)[:, None]).reshape(-1, 3)
    if ends.rotations is None:
        return Targets(positions, None)
    turns = rotation_vectors(ends.rotations @ turned.swapaxes(-1, -2))
    rotations = rotation_matrices(shares * turns[:, None]) @ turned[:, None]
    return Targets(positions, rotations.reshape(-1, 3, 3))


def _matrices(angles: Array, order: str) -> Array:
    """Return the rotations of A, B, C, shape (n, 3) → (n, 3, 3); the same angles mostly stand repeatedly."""
    known: dict[tuple[float, ...], Array] = {}
    rows = [tuple(each) for each in angles.tolist()]
    for a, b, c in rows:
        if (a, b, c) not in known:
            known[a, b, c] = euler_to_matrix((a, b, c), order)
    return np.array([known[each] for each in rows])
