"""Rotations: Euler angles in any order of X, Y and Z (D-51), rotation vectors, their inverses.

Matrices take vectors of the tool frame into the base frame. Angles in rad.
"""

from __future__ import annotations

import math

import numpy as np

from mckinematics.pose import Array, Triple

# below this cosine of the middle angle the outer two turn about one line: gimbal lock
GIMBAL_COSINE = 1e-7


def euler_to_matrix(angles: Triple, order: str) -> Array:
    """Rotation matrix, shape (3, 3), of A, B, C about X, Y, Z [rad].

    ``order`` names the factors from left to right: ZYX is Rz(C)·Ry(B)·Rx(A) (D-51).
    """
    matrix = np.eye(3)
    for letter in order:
        axis = "XYZ".index(letter)
        matrix = matrix @ _about(axis, angles[axis])
    return matrix


def matrix_to_euler(matrix: Array, order: str, near: Triple | None = None) -> Triple:
    """A, B, C [rad] of a rotation matrix of shape (3, 3); the inverse of `euler_to_matrix`.

    Without ``near`` the principal values: the middle angle in ±90°, the others in ±180°. With it, of all
    triples that give this orientation the one nearest to ``near``. At gimbal lock (the middle angle ±90°)
    only one combination of the outer angles is determined: C keeps its value of ``near`` (0 without), or
    B where C is itself the middle angle.
    """
    first, middle, last = ("XYZ".index(letter) for letter in order)
    sign = 1.0 if (middle - first) % 3 == 1 else -1.0
    sine = sign * matrix[first, last]
    cosine = math.hypot(matrix[first, first], matrix[first, middle])
    angles = [0.0, 0.0, 0.0]
    angles[middle] = math.atan2(sine, cosine)
    if cosine > GIMBAL_COSINE:
        angles[first] = math.atan2(-sign * matrix[middle, last], matrix[last, last])
        angles[last] = math.atan2(-sign * matrix[first, middle], matrix[first, first])
        if near is None:
            return angles[0], angles[1], angles[2]
        flipped = [angle + math.pi for angle in angles]
        flipped[middle] = math.pi - angles[middle]
        candidates = (_unwrap(angles, near), _unwrap(flipped, near))
        return min(candidates, key=lambda triple: math.dist(triple, near))
    # of the outer angles the later letter is kept: C, or B where C is the middle one
    kept, free = max(first, last), min(first, last)
    angles[kept] = 0.0 if near is None else near[kept]
    if kept == first:
        rest = _about(middle, angles[middle]).T @ _about(first, angles[first]).T @ matrix
    else:
        rest = matrix @ _about(last, angles[last]).T @ _about(middle, angles[middle]).T
    after, beyond = (free + 1) % 3, (free + 2) % 3
    angles[free] = math.atan2(rest[beyond, after], rest[after, after])
    return _unwrap(angles, near) if near is not None else (angles[0], angles[1], angles[2])


def rotation_vectors(matrices: Array) -> Array:
    """Axis times angle of each rotation, shape (n, 3, 3) → (n, 3) [rad]; the angle is in 0 … π."""
    skew = np.empty(matrices.shape[:-1])
    skew[..., 0] = matrices[..., 2, 1] - matrices[..., 1, 2]
    skew[..., 1] = matrices[..., 0, 2] - matrices[..., 2, 0]
    skew[..., 2] = matrices[..., 1, 0] - matrices[..., 0, 1]
    sine = 0.5 * np.sqrt((skew * skew).sum(-1))
    cosine = 0.5 * (matrices[..., 0, 0] + matrices[..., 1, 1] + matrices[..., 2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    # angle / (2 sin), whose series at zero is 1/2 + angle²/12
    small = sine < 1e-4
    scale = np.where(small, 0.5 + angle * angle / 12.0, 0.5 * angle / np.where(small, 1.0, sine))
    vectors: Array = skew * scale[..., None]
    behind = cosine < 0.0
    if behind.any():
        for index in np.argwhere(behind & (sine < 1e-3)):
            place = tuple(index)
            vectors[place] = _near_half_turn(matrices[place], skew[place], float(angle[place]))
    return vectors


def rotation_matrices(vectors: Array) -> Array:
    """Return the inverse of `rotation_vectors`, by Rodrigues' formula: (n, 3) [rad] → (n, 3, 3)."""
    angle = np.sqrt((vectors * vectors).sum(-1))
    safe = np.where(angle < 1e-12, 1.0, angle)
    axis = vectors / safe[..., None]
    cross = cross_matrices(axis)
    sine = np.sin(angle)[..., None, None]
    versine = (2.0 * np.sin(0.5 * angle) ** 2)[..., None, None]
    result: Array = np.eye(3) + sine * cross + versine * (cross @ cross)
    return result


def cross_matrices(vectors: Array) -> Array:
    """Matrices [v] with [v]·u = v × u: (n, 3) → (n, 3, 3)."""
    result = np.zeros((*vectors.shape[:-1], 3, 3))
    result[..., 0, 1] = -vectors[..., 2]
    result[..., 0, 2] = vectors[..., 1]
    result[..., 1, 0] = vectors[..., 2]
    result[..., 1, 2] = -vectors[..., 0]
    result[..., 2, 0] = -vectors[..., 1]
    result[..., 2, 1] = vectors[..., 0]
    return result


def _about(axis: int, angle: float) -> Array:
    cos, sin = math.cos(angle), math.sin(angle)
    second, third = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[second, second] = matrix[third, third] = cos
    matrix[third, second], matrix[second, third] = sin, -sin
    return matrix


def _unwrap(angles: list[float], near: Triple) -> Triple:
    a, b, c = (
        angle + 2.0 * math.pi * round((wanted - angle) / (2.0 * math.pi))
        for angle, wanted in zip(angles, near, strict=True)
    )
    return a, b, c


def _near_half_turn(matrix: Array, skew: Array, angle: float) -> Array:
    # (R + Rᵀ)/2 = cos·1 + (1 - cos)·n·nᵀ keeps the axis n where R - Rᵀ vanishes
    outer = 0.5 * (matrix + matrix.T) - math.cos(angle) * np.eye(3)
    column = int(np.argmax(np.diag(outer)))
    axis = outer[:, column] / np.linalg.norm(outer[:, column])
    if float(axis @ skew) < 0.0:
        axis = -axis
    result: Array = axis * angle
    return result
