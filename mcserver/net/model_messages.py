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
    """A mesh that the URDF names: ``name`` as it stands there; ``size`` in bytes, 0: it is not to be had."""

    name: str
    size: int


class ModelReply(msgspec.Struct, frozen=True):
    """A robot's URDF.

    Attributes:
        urdf: its text; empty: the machine has none. digest: of the text and the meshes.
        joints: the joint that each axis moves, by axis number.
        meshes: of the visuals, in the order of `ModelMeshRequest.mesh`.
    """

    urdf: str
    digest: str
    joints: dict[str, str]
    meshes: list[MeshInfo]


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
