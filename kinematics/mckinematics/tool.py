"""One tool: its chain, what of the pose it follows, and the Jacobian's generic rank."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mckinematics.chain import Chain
from mckinematics.errors import ModelError
from mckinematics.pose import Array, BoolArray, Pose
from mckinematics.rotation import euler_to_matrix, rotation_vectors
from mckinematics.text import joint_text

# joint positions tried from when the one asked for leads nowhere; deterministic
SEED_COUNT = 96
# a singular value below this share counts as zero when the generic rank is judged
RANK_THRESHOLD = 1e-6
# how quickly joints to spare go to their posture: while the tool travels its reach, or turns by a radian,
# what is left to it falls to exp(-this)
POSTURE_PULL = 1.0
# how near counts as reached [m], [rad]: beside a singular position Newton's method leaves some 5e-9
REACHED = 1e-8
# share of the tolerance that a chain with too few joints may stay off
LOOSE_SHARE = 0.5


@dataclass(frozen=True)
class Targets:
    """Poses to reach: ``positions`` (n, 3) [m]; ``rotations`` (n, 3, 3), or None for position alone."""

    positions: Array
    rotations: Array | None

    def rows(self, chosen: slice | NDArray[np.intp] | BoolArray) -> Targets:
        """Return the poses of these rows."""
        rotations = None if self.rotations is None else self.rotations[chosen]
        return Targets(self.positions[chosen], rotations)


@dataclass(frozen=True)
class ToolModel:
    """A tool that can be solved for.

    Attributes:
        number: the word T. frame: name in the URDF.
        orientation: whether A B C are followed. euler: order of the factors (D-51).
        rank: rank of the Jacobian at generic positions, at most min(rows, K): fewer than ``rows`` where the
            chain has too few joints, or joints that all lie in one plane.
        seeds: shape (SEED_COUNT, K), positions within the joint limits to restart from.
        residual_tolerance: [m], and residual_tolerance_angle [rad]: how near counts as reached.
        tolerance [m], tolerance_angle [rad]: how far the tool may be off its path (D-54).
        posture: shape (K,), where the joints of a chain with some to spare had best be; None: anywhere.
    """

    number: int
    frame: str
    chain: Chain
    orientation: bool
    euler: str
    rank: int
    seeds: Array
    residual_tolerance: float
    residual_tolerance_angle: float
    tolerance: float
    tolerance_angle: float
    posture: Array | None = None

    @property
    def rows(self) -> int:
        """Numbers that a pose has for this tool: 6 with orientation, else 3."""
        return 6 if self.orientation else 3

    @property
    def square(self) -> bool:
        """Whether a pose determines the joints but for a few configurations: as many joints as numbers."""
        return self.rows == self.chain.size == self.rank

    @cached_property
    def unit(self) -> Array:
        """What each joint's travel is measured in, shape (K,): 1 rad, or the reach [m]."""
        return np.where(self.chain.revolute, 1.0, self.chain.reach)

    @cached_property
    def row_unit(self) -> Array:
        """What the tool's own rates are measured in, shape (rows,): the reach [m], then 1 rad."""
        return np.array([self.chain.reach] * 3 + [1.0] * (self.rows - 3))

    def target(self, pose: Pose) -> Targets:
        """Return a single pose as targets of length 1."""
        rotations = euler_to_matrix(pose.angles, self.euler)[None] if self.orientation else None
        return Targets(np.array([pose.position], dtype=float), rotations)

    def residual(self, joints: Array, targets: Targets) -> Array:
        """Return what is missing to the targets, (n, rows): a vector [m], with orientation also a turn
        [rad].
        """
        positions, rotations = self.chain.forward(joints)
        return _residual(targets, positions, rotations)

    def linearise(self, joints: Array, targets: Targets) -> tuple[Array, Array]:
        """As `residual`, and the Jacobians, shape (n, rows, K)."""
        positions, rotations, jacobians = self.chain.jacobian(joints, self.rows)
        return _residual(targets, positions, rotations), jacobians

    def reached(self, residual: Array) -> BoolArray:
        """Return which residuals of shape (n, rows) count as reached, shape (n,)."""
        near: BoolArray = np.linalg.norm(residual[:, :3], axis=1) <= self.residual_tolerance
        if self.orientation:
            near &= np.linalg.norm(residual[:, 3:], axis=1) <= self.residual_tolerance_angle
        return near

    def conditioning(self, jacobians: Array) -> Array:
        """Smallest singular value that a generic position has, shape (n,) [1].

        Of the Jacobian without units: lengths are divided by the chain's reach. 0 where the chain is
        singular; about 0.1 … 1 far from that.
        """
        return singular_values(self.chain, jacobians)[:, self.rank - 1]

    def joint_gain(self, jacobians: Array, rates: Array) -> Array:
        """How much faster than the tool its joints move, shape (n,) [1], where the tool moves at ``rates``.

        Both without units: lengths are divided by the chain's reach. 1 / `conditioning` at most; less where
        the tool does not move in the direction that the chain loses.
        """
        left, values, _ = np.linalg.svd(without_units(self.chain, jacobians), full_matrices=False)
        scaled = rates / self.row_unit
        along = (left.swapaxes(-1, -2) @ scaled[..., None])[..., : self.rank, 0]
        speed = np.linalg.norm(along / np.maximum(values[:, : self.rank], 1e-12), axis=1)
        fastest = float(self.tool_speed(rates).max())
        return np.asarray(speed / fastest if fastest > 0.0 else np.zeros(len(rates)), dtype=np.float64)

    def limit_gradient(self, joints: Array) -> Array:
        """Return where to move joints (n, K) away from their limits, shape (n, K) [rad or m].

        Zero in the middle half of a joint's range and without limits, half the range at a limit.
        """
        chain = self.chain
        half = 0.5 * (chain.upper - chain.lower)
        limited = np.isfinite(half)
        middle = np.where(limited, 0.5 * (chain.upper + chain.lower), 0.0)
        half = np.where(limited, half, 0.0)
        share = np.where(limited, (joints - middle) / np.where(limited, half, 1.0), 0.0)
        beyond = np.clip(2.0 * np.abs(share) - 1.0, 0.0, 1.5)
        return np.asarray(-np.sign(share) * half * beyond, dtype=np.float64)

    def spare_goal(self, joints: Array, aside: float) -> Array | None:
        """Where to move joints (n, K) that are to spare, by the tool's travel over its reach, shape (n, K).

        Towards the posture, and ``aside`` from limits (Liégeois); None: nowhere.
        """
        if self.posture is None:
            return None if aside == 0.0 else aside * self.limit_gradient(joints)
        goal: Array = POSTURE_PULL * (self.posture - joints)
        return goal + aside * self.limit_gradient(joints) if aside else goal

    def tool_speed(self, rates: Array) -> Array:
        """Sizes of rates of the tool (n, rows) without units, shape (n,) [1]: lengths over the reach."""
        return np.asarray(np.linalg.norm(rates / self.row_unit, axis=1), dtype=np.float64)

    def joint_speed(self, slopes: Array) -> Array:
        """Sizes of rates of the joints (n, K) without units, shape (n,) [1]: lengths over the reach."""
        return np.asarray(np.linalg.norm(slopes / self.unit, axis=1), dtype=np.float64)


def singular_values(chain: Chain, jacobians: Array) -> Array:
    """Singular values of Jacobians (n, rows, K) whose lengths are divided by the reach, falling, (n, min)."""
    values = np.linalg.svd(without_units(chain, jacobians), compute_uv=False)
    return np.asarray(values, dtype=np.float64)


def build_tool(
    number: int,
    frame: str,
    chain: Chain,
    *,
    orientation: bool,
    euler: str,
    tolerance: float,
    tolerance_angle: float,
    posture: tuple[float, ...] | None = None,
) -> ToolModel:
    """Return a tool over its chain; ``tolerance`` [m] and ``tolerance_angle`` [rad] as in D-54.

    Raises:
        ModelError: the chain cannot move the tool at all, or it cannot take the posture.
    """
    seeds = _seeds(chain)
    rows = 6 if orientation else 3
    jacobians = chain.jacobian(seeds)[2][:, :rows]
    values = singular_values(chain, jacobians)
    rank = int((values > RANK_THRESHOLD * values[:, :1]).sum(axis=1).max())
    if rank == 0:
        raise ModelError(
            f"tool {number}: no joint of its chain moves the point of {frame!r}",
            "give the tool an offset from its joints' axes, or another frame",
            tool=number,
        )
    if posture is not None:
        _refuse_posture(number, chain, rank, np.array(posture))
    # a chain that cannot move freely meets a pose typed with a few decimals only nearly
    loose = rank < rows
    return ToolModel(
        number=number,
        frame=frame,
        chain=chain,
        orientation=orientation,
        euler=euler,
        rank=rank,
        seeds=seeds,
        residual_tolerance=LOOSE_SHARE * tolerance if loose else REACHED,
        residual_tolerance_angle=LOOSE_SHARE * tolerance_angle if loose else REACHED,
        tolerance=tolerance,
        tolerance_angle=tolerance_angle,
        posture=None if posture is None else np.array(posture, dtype=float),
    )


def _refuse_posture(number: int, chain: Chain, rank: int, posture: Array) -> None:
    count = len(posture)
    if count != chain.size:
        raise ModelError(
            f"tool {number}: its posture has {count} positions, its chain {chain.size} joints",
            "give one position for each of its axes, in their order",
            tool=number,
        )
    if chain.size == rank:
        raise ModelError(
            f"tool {number} has a posture, but none of its {chain.size} joints is to spare",
            "leave posture out: a pose determines these joints",
            tool=number,
        )
    outside = np.flatnonzero((posture < chain.lower) | (posture > chain.upper))
    if len(outside):
        column = int(outside[0])
        axis = chain.axes[column]
        raise ModelError(
            f"tool {number}: its posture has axis {axis} at {joint_text(chain, column, posture[column])},"
            f" outside {joint_text(chain, column, chain.lower[column])} to"
            f" {joint_text(chain, column, chain.upper[column])}",
            "give positions within the joints' limits",
            tool=number,
            axis=axis,
        )


def pose_difference(targets: Targets, others: Targets) -> Array:
    """From the first of some poses to that of others, shape (rows,): a vector [m], then a turn [rad]."""
    difference: Array = _residual(targets, others.positions, others.rotations)[0]
    return difference


def without_units(chain: Chain, jacobians: Array) -> Array:
    """Jacobians (n, rows, K) with lengths divided by the chain's reach."""
    scaled = jacobians.copy()
    scaled[:, :3] /= chain.reach
    scaled[:, :, ~chain.revolute] *= chain.reach
    return scaled


def _residual(targets: Targets, positions: Array, rotations: Array | None) -> Array:
    missing = targets.positions - positions
    if targets.rotations is None or rotations is None:
        return missing
    return np.concatenate([missing, rotation_vectors(targets.rotations @ rotations.swapaxes(-1, -2))], axis=1)


def _seeds(chain: Chain) -> Array:
    # joints without limits: a turn for revolute ones, the reach for sliding ones
    span = np.where(chain.revolute, np.pi, chain.reach)
    top = np.where(np.isfinite(chain.upper), chain.upper, span)
    lower = np.where(np.isfinite(chain.lower), chain.lower, top - 2.0 * span)
    upper = np.where(np.isfinite(chain.upper), chain.upper, lower + 2.0 * span)
    # the additive recurrence of Roberts covers a box evenly with any number of points
    golden = 2.0
    for _ in range(32):
        golden = (1.0 + golden) ** (1.0 / (chain.size + 1))
    steps = golden ** -np.arange(1.0, chain.size + 1.0)
    shares = (0.5 + np.arange(1, SEED_COUNT + 1)[:, None] * steps) % 1.0
    seeds: Array = lower + shares * (upper - lower)
    seeds.setflags(write=False)
    return seeds
