"""Payloads about what a machine looks like, as `mcserver.net.messages`."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from mcserver.net.messages import Request

MAX_PART_BYTES = 1 << 20


class ModelRequest(Request, frozen=True, kw_only=True):
    """What the machine looks like: a `ModelReply`."""


class MeshInfo(msgspec.Struct, frozen=True):
    """A mesh that the URDF names: ``name`` as written there; ``size`` in bytes, 0: it is not available."""

    name: str
    size: int


class ModelBody(msgspec.Struct, frozen=True):
    """A body or zone of ``[clearance]``.

    Attributes:
        shape: ``box`` (of a zone too), ``cylinder``, ``capsule``, ``sphere``, ``mesh`` or ``cutter``.
        size_mm: edges of a box, radius and length of a round shape.
        mesh: its index in `ModelReply.meshes`; the file is in mm.
        at_mm, turned_deg: in the frame of its carrier, Rz(C)·Ry(B)·Rx(A).
        link: of the URDF that carries it. carried_by: axes that carry it instead; directions: of these, 0 to
            2 for X to Z. opposite: in their negative direction. Neither: it is fixed.
        tool: with which it is mounted; None: it is always there.
        zone: ``keep_out``, ``keep_in`` or ``slow``; empty: a body. input: name of the input that switches it
            on; empty: it is always on. high: the input's level then.
    """

    name: str
    shape: str
    size_mm: list[float]
    at_mm: list[float]
    turned_deg: list[float]
    mesh: int | None = None
    link: str = ""
    carried_by: list[int] = []
    directions: list[int] = []
    opposite: bool = False
    tool: int | None = None
    zone: str = ""
    input: str = ""
    high: bool = False


class ModelReply(msgspec.Struct, frozen=True):
    """A robot's URDF, and the bodies and zones of a machine.

    Attributes:
        urdf: its text; empty: the machine has none. digest: of the text and the meshes.
        joints: the joint that each axis moves, by axis number.
        meshes: of the visuals, followed by those of bodies, in the order of `ModelMeshRequest.mesh`.
    """

    urdf: str
    digest: str
    joints: dict[str, str]
    meshes: list[MeshInfo]
    bodies: list[ModelBody] = []


class ModelMeshRequest(Request, frozen=True, kw_only=True):
    """Part of a mesh's file: ``mesh`` counts from 0 in `ModelReply.meshes`."""

    mesh: Annotated[int, Meta(ge=0)]
    offset: Annotated[int, Meta(ge=0)] = 0
    size: Annotated[int, Meta(ge=1, le=MAX_PART_BYTES)] = MAX_PART_BYTES


class ModelPart(msgspec.Struct, frozen=True):
    """``data`` from ``offset`` on; ``size`` of the whole file."""

    offset: int
    size: int
    data: bytes
