"""What passes over the WebSocket, subprotocol ``mc.v1``: MessagePack maps, the field ``op`` says which.

The messages inside (``params``, ``value``, ``error``, ``message``) are those of the key space, byte for byte
(docs/schemas).
"""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
from msgspec import Meta

SUBPROTOCOL = "mc.v1"
TOKEN_PREFIX = "mc.token."

Id = Annotated[int, Meta(ge=0, le=2**53)]
Name = Annotated[str, Meta(max_length=63)]


class Call(msgspec.Struct, frozen=True, tag_field="op", tag="call"):
    """A remote method.

    ``request``: its number, the same again after a lost connection; None: it is never repeated.
    """

    id: Id
    machine: Name
    method: Name
    params: dict[str, Any] = {}
    request: Id | None = None


class Subscribe(msgspec.Struct, frozen=True, tag_field="op", tag="subscribe"):
    """``id`` names the subscription from now on.

    ``topic``: ``state``, ``samples``, ``events``, ``presence`` or ``ack/{program}``.
    """

    id: Id
    machine: Name
    topic: Annotated[str, Meta(max_length=80)]


class Unsubscribe(msgspec.Struct, frozen=True, tag_field="op", tag="unsubscribe"):
    """Ends a subscription."""

    id: Id


class Estop(msgspec.Struct, frozen=True, tag_field="op", tag="estop"):
    """Emergency stop; answered with a reply once the server has confirmed it.

    Attributes:
        request: a random number from 2^32 on that all copies of one stop have, on each connection.
    """

    id: Id
    machine: Name
    reason: Annotated[str, Meta(max_length=200)] = ""
    request: Annotated[int, Meta(ge=0, le=2**63 - 1)] | None = None


class Machines(msgspec.Struct, frozen=True, tag_field="op", tag="machines"):
    """Which machines are there; the reply's value is a list of names."""

    id: Id


class Targets(msgspec.Struct, frozen=True, tag_field="op", tag="targets"):
    """Targets of a program in servo mode, the message `StreamTargets`; without an answer.

    What cannot be sent now is dropped: the next one is newer, and the server counts what is missing.
    """

    machine: Name
    program: Annotated[str, Meta(max_length=80)]
    message: msgspec.Raw


Request = Call | Subscribe | Unsubscribe | Estop | Machines | Targets


class Hello(msgspec.Struct, frozen=True, tag_field="op", tag="hello"):
    """The first frame: ``client`` is this session's id, ``session`` the secret that takes it up again."""

    client: str
    session: str
    role: str
    resumed: bool
    grace_s: float
    protocol: int = 1


class Reply(msgspec.Struct, frozen=True, tag_field="op", tag="reply"):
    """The answer to a call: ``value``, or ``error`` as an `ErrorReply`."""

    id: int
    ok: bool
    value: Any = None
    error: Any = None


class Message(msgspec.Struct, frozen=True, tag_field="op", tag="message"):
    """A message of a subscription; ``missed`` counts those that a slow reader has lost before it."""

    id: int
    message: msgspec.Raw
    missed: int = 0
