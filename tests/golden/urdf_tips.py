"""Forward kinematics of the tests' own: a URDF's chain walked joint by joint, by nothing of the product."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from importlib import resources

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def tips(model: str, frame: str, joints: Array) -> tuple[Array, Rotation]:
    """Where a link is, shape (N, 3) [m], and how it is turned (N rotations).

    Args:
        model: file name of a built-in URDF. frame: a link of it.
        joints: shape (N, K), the chain's moving joints, base to tip [rad].
    """
    return tips_of(
        resources.files("mckinematics").joinpath("models", model).read_text("utf-8"), frame, joints
    )


def tips_of(text: str, frame: str, joints: Array) -> tuple[Array, Rotation]:
    """As `tips`, of a URDF's text; a joint that slides goes along its axis [m]."""
    into = {_of(joint, "child", "link"): joint for joint in ElementTree.fromstring(text).iter("joint")}
    chain = []
    while frame in into:
        chain.append(into[frame])
        frame = _of(into[frame], "parent", "link")
    place = np.zeros((len(joints), 3))
    turn = Rotation.identity(len(joints))
    column = 0
    for joint in reversed(chain):
        place = place + turn.apply(_numbers(joint, "origin", "xyz"))
        turn = turn * Rotation.from_euler("xyz", _numbers(joint, "origin", "rpy"))
        if joint.get("type") == "fixed":
            continue
        motion = joints[:, column, None] * _numbers(joint, "axis", "xyz")
        if joint.get("type") == "prismatic":
            place = place + turn.apply(motion)
        else:
            turn = turn * Rotation.from_rotvec(motion)
        column += 1
    assert column == joints.shape[1]
    return place, turn


def _of(joint: ElementTree.Element, child: str, key: str) -> str:
    found = joint.find(child)
    return "" if found is None else found.get(key, "")


def _numbers(joint: ElementTree.Element, child: str, key: str) -> Array:
    return np.array([float(word) for word in (_of(joint, child, key) or "0 0 0").split()])
