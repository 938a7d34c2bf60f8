"""A machine's parts for the browser: a robot of a URDF and its meshes, or a portal of the axes 0, 1 and 2."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import math
import shutil
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any
from xml.etree.ElementTree import ParseError

import numpy as np
from mcclient import Machine, MotionError
from mcclient.types import ModelBody, ModelReply
from mckinematics.rotation import euler_to_matrix

from mcserver.view.bodies import BODY, ZONE, body_solids
from mcserver.view.gantry import gantry_parts
from mcserver.view.meshes import load_mesh
from mcserver.view.robot import robot_parts
from mcserver.view.solids import Array, Part, Solid
from mcserver.view.stage import Tool, Up, tip_links, tree_up, up_of, work_links
from mcserver.view.urdf import Joint, read_tree

MM_PER_M = 1000.0
MAX_MODEL_BYTES = 256 * 1024 * 1024
# Of what is kept: one that an earlier version of the page has kept is made anew.
FORMAT = 2


async def fetch_model(machine: Machine, folder: Path) -> bytes:
    """Ask a machine what it looks like, once for each state of its files.

    Args:
        folder: keeps the answers between starts of the page; those of older models are deleted.

    Returns:
        JSON for static/space.js: ``up``; ``parts``, each a link with its joint and its ``solids``, then
        frames, bodies and zones; by tool ``bases``, the links in whose frames poses are, and ``ends``, those
        at its tip.

    Raises:
        MotionError: the machine does not answer, or its files cannot be read.
    """
    found = await machine.model()
    digest = found.digest or "none"
    if not (digest.isascii() and digest.isalnum()):
        raise MotionError("MC587", "the model's digest is no digest", "is the server of another version?")
    tools = zlib.crc32(repr((FORMAT, machine.info.tools)).encode())
    kept = folder / f"{digest}-{tools:08x}.json"
    with contextlib.suppress(OSError):
        return kept.read_bytes()
    work = folder / "meshes"
    try:
        shutil.rmtree(folder, ignore_errors=True)
        work.mkdir(parents=True, exist_ok=True)
        meshes = await fetch_meshes(machine, found, work)
        joints = {int(axis): name for axis, name in found.joints.items()}
        # large meshes take seconds, and who jogs meanwhile has to be heard
        content = await asyncio.to_thread(
            model_json, found.urdf, joints, meshes, machine.info.tools, bodies=found.bodies
        )
        kept.write_bytes(content)
    except OSError as error:
        raise MotionError("MC061", f"the model cannot be kept: {error.strerror}", "make room") from error
    except (ParseError, ValueError) as error:
        raise MotionError("MC587", f"the URDF cannot be drawn: {error}", "look at the URDF") from error
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return content


async def fetch_meshes(machine: Machine, found: ModelReply, folder: Path) -> dict[str, Path]:
    """Take a model's meshes over into a folder; return them by the names that the URDF has for them.

    Raises:
        MotionError: the machine does not answer. OSError.
    """
    meshes: dict[str, Path] = {}
    if sum(mesh.size for mesh in found.meshes) <= MAX_MODEL_BYTES:
        for number, mesh in enumerate(found.meshes):
            if mesh.size:
                path = folder / f"{number}{Path(mesh.name).suffix.lower()}"
                path.write_bytes(await machine.read_mesh(number))
                meshes[mesh.name] = path
    return meshes


def model_json(
    urdf: str,
    joints: Mapping[int, str],
    meshes: Mapping[str, Path],
    tools: Iterable[Tool],
    up: Up = Up.AUTO,
    bodies: Sequence[ModelBody] = (),
) -> bytes:
    """Return a robot as JSON, see `fetch_model`; of a machine without a URDF no parts but bodies and zones.

    Args:
        joints: names by axis number. meshes: files by the names that the URDF has for them.
    """
    extra = [part for body in bodies for part in _body_parts(body, meshes)]
    if not urdf:
        return _json(up_of(up, (), ()), extra)
    tree = read_tree(urdf)
    axes = {name: axis for axis, name in joints.items()}
    by_child = {joint.child: joint for joint in tree.joints}
    shapes = {part.name: part for part in robot_parts(tree, meshes)}
    # parents come first
    names = [tree.root, *(joint.child for joint in tree.joints)]
    parts = [_part(shapes[name], by_child.get(name), axes) for name in names if name in shapes]
    tools = list(tools)
    links = {"bases": work_links(tree, tools), "ends": tip_links(tree, tools)}
    return _json(tree_up(tree, joints, tools, up), [*parts, *extra], links)


def _body_parts(body: ModelBody, meshes: Mapping[str, Path]) -> list[dict[str, Any]]:
    """Return a body's or zone's part, behind the frames of the axes that carry it."""
    found, parent = [], body.link or None
    for axis, direction in zip(body.carried_by, body.directions, strict=True):
        child, sense = f"{body.name} on {axis}", -1.0 if body.opposite else 1.0
        slide = Joint(child, "prismatic", parent or "", child, np.eye(4), np.eye(3)[direction], child, sense)
        found.append(_part(Part(child, ()), slide, {child: axis}))
        parent = child
    pose = np.eye(4)
    a, b, c = np.radians(body.turned_deg)
    pose[:3, :3] = euler_to_matrix((a, b, c), "ZYX")
    pose[:3, 3] = np.array(body.at_mm) / MM_PER_M
    name = f"body {body.name}"
    solids: Sequence[Solid] = body_solids(body.shape, body.size_mm, ZONE if body.zone else BODY)
    if body.shape == "mesh" and name in meshes:
        scale = np.diag([*[1.0 / MM_PER_M] * 3, 1.0])
        solids = [solid.moved(scale) for solid in load_mesh(meshes[name], BODY)]
    joint = Joint(name, "fixed", parent or "", name, pose, np.eye(3)[0])
    part = _part(Part(name, tuple(solids)), joint, {})
    part |= {"tool": body.tool, "cutter": body.shape == "cutter"}
    part |= {"zone": body.zone, "input": body.input, "high": body.high}
    return [*found, part]


def portal_json(axes: Iterable[int], low: Array, high: Array, up: Up = Up.AUTO) -> bytes:
    """Return a machine without a URDF as a portal, see `fetch_model`.

    Args:
        axes: which of 0, 1 and 2 are linear axes; the others stay at 0.
        low, high: shape (3,), the space that its tip uses [m].
    """
    present, parts = set(axes), []
    by_name, parent = {part.name: part for part in gantry_parts(low, high)}, ""
    for name, axis in (("rails", None), ("bridge", 1), ("carriage", 0), ("quill", 2)):
        joint = None
        if axis is not None:
            joint = Joint(str(axis), "prismatic", parent, name, np.eye(4), np.eye(3)[axis])
        parts.append(_part(by_name[name], joint, {str(each): each for each in present}))
        parent = name
    return _json(up_of(up, (), ()), parts)


def _json(
    up: Array, parts: list[dict[str, Any]], links: Mapping[str, Mapping[int, str]] = MappingProxyType({})
) -> bytes:
    named = {name: {f"T{tool}": link for tool, link in found.items()} for name, found in links.items()}
    return json.dumps({"up": up.tolist(), "parts": parts, **named}).encode()


def _part(part: Part, joint: Joint | None, axes: Mapping[str, int]) -> dict[str, Any]:
    shown: dict[str, Any] = {
        "name": part.name,
        "parent": None,
        "pose": None,
        "driver": None,
        "solids": [_solid(solid) for solid in part.solids],
    }
    if joint is None:
        return shown
    pose = joint.pose.copy()
    pose[:3, 3] *= MM_PER_M
    driver = axes.get(joint.leader or joint.name)
    moves = joint.kind in ("revolute", "continuous", "prismatic")
    offset = joint.offset * (MM_PER_M if joint.kind == "prismatic" else 180.0 / math.pi)
    return shown | {
        "parent": joint.parent,
        "pose": np.round(pose, 9).ravel().tolist(),
        "driver": driver if moves else None,
        "kind": joint.kind,
        "axis": joint.axis.tolist(),
        "ratio": joint.ratio if joint.leader else 1.0,
        "offset": offset if joint.leader else 0.0,
    }


def _solid(solid: Solid) -> dict[str, Any]:
    vertices = np.ascontiguousarray(solid.vertices * MM_PER_M, dtype="<f4")
    faces = np.ascontiguousarray(solid.faces, dtype="<u4")
    return {
        "colour": list(solid.colour),
        "vertices": base64.b64encode(vertices.tobytes()).decode(),
        "faces": base64.b64encode(faces.tobytes()).decode(),
    }
