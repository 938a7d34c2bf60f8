"""Names of ROS 2 as keys of Zenoh, as the design page of rmw_zenoh has them.

A topic or service is ``DOMAIN/NAME/TYPE/HASH``. Each node, publisher, subscription, service and client has a
liveliness token below ``@ros2_lv``; the graph of ROS is these tokens. Each message and each request has an
attachment: a number, a time, and 16 bytes that tell who sent it.
"""

from __future__ import annotations

import hashlib
import re
import struct
from enum import StrEnum
from typing import NamedTuple

ADMIN = "@ros2_lv"
MAX_DOMAIN = 232


class Kind(StrEnum):
    """What a token tells of."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"
    SERVICE = "SS"
    CLIENT = "SC"


class Qos(NamedTuple):
    """A profile of quality of service: the newest ``depth`` are kept."""

    depth: int = 10
    reliable: bool = True
    transient_local: bool = False

    def encoded(self) -> str:
        """Return it as tokens have it: what is as rmw_zenoh's default is left out."""
        reliability = "" if self.reliable else "2"
        durability = "1" if self.transient_local else ""
        return f"{reliability}:{durability}:,{self.depth}:,:,:,,"


DEFAULT_QOS = Qos()


class Entity(NamedTuple):
    """A publisher, subscription, service or client.

    Attributes:
        name: absolute. type: such as ``std_msgs/msg/String``.
    """

    kind: Kind
    name: str
    type: str
    type_hash: str
    qos: Qos = DEFAULT_QOS


class NodeName(NamedTuple):
    """A node; ``namespace`` begins with a slash, the root's is empty; ``number`` is unique in the session."""

    domain: int
    session: str
    number: int
    namespace: str
    name: str

    def token(self) -> str:
        """Return the key of its token."""
        return f"{self._start(self.number, Kind.NODE)}/{self.name}"

    def token_of(self, entity: Entity, number: int) -> str:
        """Return the key of an entity's token; ``number`` as that of nodes."""
        parts = (mangled(entity.name), dds_type(entity.type), entity.type_hash, entity.qos.encoded())
        return f"{self._start(number, entity.kind)}/{self.name}/{'/'.join(parts)}"

    def key_of(self, entity: Entity) -> str:
        """Return the key of a topic's messages, or of a service's requests."""
        return f"{self.domain}/{entity.name.strip('/')}/{dds_type(entity.type)}/{entity.type_hash}"

    def _start(self, number: int, kind: Kind) -> str:
        return (
            f"{ADMIN}/{self.domain}/{self.session}/{self.number}/{number}/{kind}/%/{mangled(self.namespace)}"
        )


def mangled(name: str) -> str:
    """Return a name as one chunk of a key."""
    return name.replace("/", "%") or "%"


def dds_type(name: str) -> str:
    """Return a type's name as keys have it: ``std_msgs::msg::dds_::String_``."""
    package, middle, last = name.split("/")
    return f"{package}::{middle}::dds_::{last}_"


def ros_name(name: str) -> str:
    """Return a machine's name as ROS may have it: letters, digits and ``_``, no digit first."""
    cleaned = re.sub(r"[^A-Za-z0-9_]", "_", name)
    # two underscores in a row and a leading one are kept for ROS itself
    cleaned = re.sub(r"_+", "_", cleaned).strip("_") or "machine"
    return f"m{cleaned}" if cleaned[0].isdigit() else cleaned


def gid_of(token: str) -> bytes:
    """Return the 16 bytes that stand for an entity in attachments."""
    return hashlib.sha256(token.encode()).digest()[:16]


class Attachment(NamedTuple):
    """What goes with a message, a request and its reply; ``nanoseconds``: Unix time."""

    number: int
    nanoseconds: int
    gid: bytes

    def encoded(self) -> bytes:
        """Return it in Zenoh's serialization: two int64, and the bytes behind their count."""
        return struct.pack("<qqB16s", self.number, self.nanoseconds, 16, self.gid)


def read_attachment(payload: bytes) -> Attachment | None:
    """Return an attachment; None: it is none."""
    if len(payload) != 33:
        return None
    number, nanoseconds, count, gid = struct.unpack("<qqB16s", payload)
    return Attachment(number, nanoseconds, gid) if count == 16 else None
