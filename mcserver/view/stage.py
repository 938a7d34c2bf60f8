"""How a picture of a machine stands: which way is up, and the links of each tool's work and tip."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

import numpy as np

from mcserver.view.solids import Array
from mcserver.view.urdf import Tree


class Tool(Protocol):
    """A tool of a machine file, or of a machine's answer: frames of the URDF, and its chain's axes."""

    @property
    def number(self) -> int: ...
    @property
    def work(self) -> str | None: ...
    @property
    def frame(self) -> str: ...
    @property
    def axes(self) -> Sequence[int]: ...


class Up(enum.Enum):
    """Which axis of the G-code's frame points up in the picture."""

    AUTO = "auto"
    X = "x"
    Y = "y"
    Z = "z"
    MINUS_X = "-x"
    MINUS_Y = "-y"
    MINUS_Z = "-z"


def up_of(wanted: Up, tips: Sequence[Array], hips: Sequence[Array]) -> Array:
    """Return the unit vector that points up, shape (3,).

    Args:
        wanted: ``AUTO``: a machine of several tools stands on them, one with a single tool has Z up.
        tips: points of the tools, shape (3,). hips: points where their chains begin.
    """
    if wanted is not Up.AUTO:
        sign, axis = -1.0 if wanted.value[0] == "-" else 1.0, "xyz".index(wanted.value[-1])
    elif len(tips) < 2:
        sign, axis = 1.0, 2
    else:
        upwards = np.mean(np.array(hips) - np.array(tips), axis=0)
        axis = int(np.argmax(np.abs(upwards)))
        sign = float(np.sign(upwards[axis]))
    up: Array = sign * np.eye(3)[axis]
    return up


def tree_up(tree: Tree, joints: Mapping[int, str], tools: Iterable[Tool], wanted: Up) -> Array:
    """Return the unit vector that points up in a robot's root, shape (3,); ``joints``: names by axis."""
    placed = tree.poses({})
    hips_of = {joint.name: placed[joint.child][:3, 3] for joint in tree.joints if joint.child in placed}
    tips, hips = [], []
    for tool in tools:
        first = joints.get(tool.axes[0], "") if tool.axes else ""
        if tool.frame in placed and first in hips_of:
            tips.append(placed[tool.frame][:3, 3])
            hips.append(hips_of[first])
    return up_of(wanted, tips, hips)


def work_links(tree: Tree, tools: Iterable[Tool]) -> dict[int, str]:
    """Return the link in whose frame the poses of each tool are, by its number: of its work, or the root."""
    return {tool.number: _link_of(tree, tool.work or "") or tree.root for tool in tools}


def tip_links(tree: Tree, tools: Iterable[Tool]) -> dict[int, str]:
    """Return the link at the tip of each tool, by its number."""
    return {tool.number: _link_of(tree, tool.frame) for tool in tools}


def _link_of(tree: Tree, frame: str) -> str:
    """Return the link of a frame; a joint stands for the link behind it."""
    return next((joint.child for joint in tree.joints if joint.name == frame), frame)
