"""Bodies, zones and paths of a machine as entities of a scene, and its paths as points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from google.protobuf.timestamp_pb2 import Timestamp

from mcserver.foxglove.channels import PATH, WellKnown, timestamp
from mcserver.foxglove.shape import Shape
from mcserver.view.solids import Array, Part, Solid

PATH_COLOUR = (0, 119, 187)
ZONE_ALPHA = 0.25
LINE_PIXELS = 2.0


def scene_update(shape: Shape, time_ns: int, paths: Mapping[int | None, Array]) -> bytes:
    """Write one ``foxglove.SceneUpdate`` of all bodies, zones and paths; it holds from then on.

    Args:
        paths: points (N, 3) in the frame of the tool's work [m], by tool; None: of the axes 0, 1 and 2.
    """
    stamp = timestamp(time_ns)
    entities = [
        *(_entity(f"{number} {part.name}", part, stamp, 1.0) for number, part in enumerate(shape.parts)),
        *(
            _entity(f"zone {number}", part, stamp, ZONE_ALPHA)
            for number, part in enumerate(shape.zones, start=1)
        ),
    ]
    for tool, points in paths.items():
        line = LinePrimitive(
            type=LinePrimitive.LINE_STRIP,
            thickness=LINE_PIXELS,
            scale_invariant=True,
            points=_points(points),
            color=_colour(PATH_COLOUR, 1.0),
        )
        entities.append(
            SceneEntity(
                timestamp=stamp,
                frame_id=_base(shape, tool),
                id="path" if tool is None else f"path T{tool}",
                frame_locked=True,
                lines=[line],
            )
        )
    written: bytes = SceneUpdate(entities=entities).SerializeToString()
    return written


def path_clouds(
    shape: Shape, time_ns: int, paths: Mapping[int | None, Array]
) -> list[tuple[WellKnown, bytes]]:
    """Write the points of the paths as ``foxglove.PointCloud``, for viewers that know no scene.

    Returns:
        One for each frame, with its channel: another frame than the root's has a topic of its own.
    """
    frames: dict[str, list[Array]] = {}
    for tool, points in paths.items():
        frames.setdefault(_base(shape, tool), []).append(points)
    return [
        (
            PATH if frame == shape.tree.root else PATH._replace(topic=f"{PATH.topic}/{frame}"),
            _cloud(frame, time_ns, np.concatenate(found)),
        )
        for frame, found in frames.items()
    ]


def _base(shape: Shape, tool: int | None) -> str:
    return shape.tree.root if tool is None else shape.bases.get(tool, shape.tree.root)


def _cloud(frame: str, time_ns: int, points: Array) -> bytes:
    fields = [
        PackedElementField(name=name, offset=4 * at, type=PackedElementField.FLOAT32)
        for at, name in enumerate("xyz")
    ]
    written: bytes = PointCloud(
        timestamp=timestamp(time_ns),
        frame_id=frame,
        point_stride=12,
        fields=fields,
        data=np.ascontiguousarray(points, dtype="<f4").tobytes(),
    ).SerializeToString()
    return written


def _entity(name: str, part: Part, stamp: Timestamp, alpha: float) -> SceneEntity:
    return SceneEntity(
        timestamp=stamp,
        frame_id=part.name,
        id=name,
        frame_locked=True,
        triangles=[_triangles(solid, alpha) for solid in part.solids],
    )


def _triangles(solid: Solid, alpha: float) -> TriangleListPrimitive:
    return TriangleListPrimitive(
        points=_points(solid.vertices),
        indices=solid.faces.ravel().tolist(),
        color=_colour(solid.colour, alpha),
    )


def _points(points: Array) -> Sequence[Point3]:
    return [Point3(x=x, y=y, z=z) for x, y, z in points.tolist()]


def _colour(colour: tuple[int, int, int], alpha: float) -> Color:
    red, green, blue = colour
    return Color(r=red / 255.0, g=green / 255.0, b=blue / 255.0, a=alpha)
