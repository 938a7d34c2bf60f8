"""Remote methods for a machine's model."""

from __future__ import annotations

import asyncio
import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import msgspec
from mckinematics.errors import ModelError
from mckinematics.model import read_urdf

from mcserver.errors import Refused
from mcserver.machine.clearance_section import Body, MeshBody, Zone, measures
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.machine.mesh_files import find_mesh, mesh_names
from mcserver.net import model_messages as wire

# Extensions of mesh files that a URDF may name; other files are not sent.
SUFFIXES = frozenset({".stl", ".obj", ".dae", ".glb", ".ply"})
MAX_MESH_BYTES = 64 * 1024 * 1024
# Environment variables with folders of packages, and the packages' subfolder there.
PACKAGE_PATHS = MappingProxyType({"AMENT_PREFIX_PATH": "share", "ROS_PACKAGE_PATH": ""})


class ModelMethods:
    """Sends a machine's URDF and meshes, which are read on first request."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._found: tuple[wire.ModelReply, list[Path | None]] | None = None

    async def model(self, _client: str, _request: wire.ModelRequest) -> wire.ModelReply:
        return (await self._look())[0]

    async def model_mesh(self, _client: str, request: wire.ModelMeshRequest) -> wire.ModelPart:
        _, paths = await self._look()
        path = paths[request.mesh] if request.mesh < len(paths) else None
        if path is None:
            raise Refused("MC587", f"there is no mesh {request.mesh}", "`model` lists those that are there")
        try:
            return await asyncio.to_thread(_part, path, request.offset, request.size)
        except OSError as error:
            raise Refused(
                "MC587", f"{path.name} cannot be read: {error.strerror}", "look at the URDF's folder"
            ) from error

    async def _look(self) -> tuple[wire.ModelReply, list[Path | None]]:
        if self._found is None:
            self._found = await asyncio.to_thread(look, self._machine)
        return self._found


def look(machine: Machine) -> tuple[wire.ModelReply, list[Path | None]]:
    """Return the model of a machine, and the files of its meshes.

    Raises:
        Refused: MC587 its URDF cannot be read.
    """
    kinematics = build_kinematics(machine)
    text, joints = "", dict[str, str]()
    found: list[tuple[str, Path | None]] = []
    if machine.urdf is not None and kinematics is not None:
        try:
            text = read_urdf(machine.urdf)
        except ModelError as error:
            raise Refused("MC587", str(error), "look at the machine file's [kinematics]") from error
        for tool in kinematics.tools:
            chain = kinematics.tool(tool).chain
            joints |= {str(axis): name for axis, name in zip(chain.axes, chain.joint_names, strict=True)}
        roots = [
            Path(folder) / below
            for name, below in PACKAGE_PATHS.items()
            for folder in os.environ.get(name, "").split(":")
            if folder
        ]
        found = [(name, find_mesh(name, Path(machine.urdf), roots)) for name in mesh_names(text)]
    bodies = []
    if machine.clearance is not None:
        for body in machine.clearance.bodies:
            mesh = None
            if isinstance(body, MeshBody):
                mesh = len(found)
                found.append((f"body {body.name}", Path(body.file)))
            bodies.append(_body(body, mesh, machine.clearance.letters))
        names = {each.number: each.name for each in machine.inputs if each.digital}
        bodies += [_zone(zone, names) for zone in machine.clearance.zones if zone.fixed]
    if not text and not bodies:
        return wire.ModelReply("", "", {}, []), []
    digest = hashlib.sha256(text.encode() + msgspec.json.encode(bodies))
    meshes, paths = [], []
    for name, path in found:
        size = 0
        if path is not None and path.suffix.lower() in SUFFIXES and path.is_file():
            size = path.stat().st_size
        if not 0 < size <= MAX_MESH_BYTES:
            size, path = 0, None
        changed = 0 if path is None else path.stat().st_mtime_ns
        digest.update(f"{name} {size} {changed}".encode())
        meshes.append(wire.MeshInfo(name, size))
        paths.append(path)
    return wire.ModelReply(text, digest.hexdigest()[:32], joints, meshes, bodies), paths


def _body(body: Body, mesh: int | None, letters: Mapping[int, int]) -> wire.ModelBody:
    shape, size = measures(body)
    return wire.ModelBody(
        body.name,
        shape,
        list(size),
        list(body.at_mm),
        list(body.turned_deg),
        mesh=mesh,
        link=body.link or "",
        carried_by=body.carried_by,
        directions=[letters[axis] for axis in body.carried_by],
        opposite=body.opposite,
        tool=body.tool,
    )


def _zone(zone: Zone, inputs: Mapping[int, str]) -> wire.ModelBody:
    return wire.ModelBody(
        zone.name,
        "box",
        list(zone.size_mm),
        list(zone.at_mm),
        list(zone.turned_deg),
        zone=zone.kind,
        input="" if zone.input is None else inputs[zone.input],
        high=zone.active == "high",
    )


def _part(path: Path, offset: int, size: int) -> wire.ModelPart:
    with path.open("rb") as file:
        file.seek(offset)
        return wire.ModelPart(offset, path.stat().st_size, file.read(size))
