"""The well-known channels: topics, message types, and their schemas as files and sockets have them."""

from __future__ import annotations

import struct
from typing import NamedTuple

from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp

NS = 1_000_000_000


class WellKnown(NamedTuple):
    """A channel: its topic, the encoding of its messages, and its schema with name and encoding."""

    topic: str
    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes


def _protobuf(topic: str, message: type[Message]) -> WellKnown:
    found: dict[str, FileDescriptorProto] = {}
    _gather(message.DESCRIPTOR.file, found)
    schema = FileDescriptorSet(file=found.values()).SerializeToString()
    return WellKnown(topic, "protobuf", message.DESCRIPTOR.full_name, "protobuf", schema)


def _gather(file: FileDescriptor, found: dict[str, FileDescriptorProto]) -> None:
    """Add a file behind all that it imports."""
    for each in file.dependencies:
        if each.name not in found:
            _gather(each, found)
    described = FileDescriptorProto()
    file.CopyToProto(described)
    found[file.name] = described


FRAMES = _protobuf("/tf", FrameTransforms)
# apart, so that a viewer that jumps into the middle of a file finds them as its last message
STANDING_FRAMES = _protobuf("/tf_static", FrameTransforms)
JOINTS = _protobuf("/joint_states", JointStates)
SCENE = _protobuf("/scene", SceneUpdate)
PATH = _protobuf("/path", PointCloud)
LOG = _protobuf("/log", Log)
# the one form of a URDF on a topic that Foxglove and Rerun both read is that of ROS 2
ROBOT = WellKnown("/robot_description", "cdr", "std_msgs/msg/String", "ros2msg", b"string data")


def robot_description(urdf: str) -> bytes:
    """Write a URDF as ``std_msgs/String``: CDR, little-endian, the string's length with its final zero."""
    text = urdf.encode() + b"\0"
    return b"\x00\x01\x00\x00" + struct.pack("<I", len(text)) + text


def timestamp(time_ns: int) -> Timestamp:
    """Write Unix time [ns]."""
    return Timestamp(seconds=time_ns // NS, nanos=time_ns % NS)
