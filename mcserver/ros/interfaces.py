"""Types of ROS 2 Jazzy: their hashes (RIHS01, REP 2016) and their CDR payloads.

Services and actions are made of messages as the interface generators make them: a service has the types
``_Request``, ``_Response`` and ``_Event``, an action the services ``_SendGoal`` and ``_GetResult`` and the
message ``_FeedbackMessage``.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mcserver.ros.definitions import ACTIONS, EVENT_INFO, MESSAGES, SERVICES

# Payloads beyond are not looked into: a trajectory of 64 joints and 10 000 points with velocities has 11 MB.
MAX_PAYLOAD_BYTES = 16 * 1024 * 1024

Types = dict[str, Any]
_UUID = "unique_identifier_msgs/msg/UUID"
_EVENT_INFO = "service_msgs/msg/ServiceEventInfo"
_TIME = "builtin_interfaces/msg/Time"


class MalformedPayload(ValueError):
    """A payload that is no message of its type."""


class Interfaces:
    """The types that are spoken here.

    Args:
        messages, services, actions: definitions besides those of the library, by full name.
    """

    def __init__(
        self,
        messages: Mapping[str, str] = MESSAGES,
        services: Mapping[str, tuple[str, str]] = SERVICES,
        actions: Mapping[str, tuple[str, str, str]] = ACTIONS,
    ) -> None:
        self._store = get_typestore(Stores.ROS2_JAZZY)
        # the generators take `char` for uint8, which the library's hashes do not: it is part of each service
        self._store.fielddefs |= _message(_EVENT_INFO, EVENT_INFO)
        types: Types = {}
        for name, text in messages.items():
            types |= _message(name, text)
        for name, (request, response) in services.items():
            types |= _message(f"{name}_Request", request) | _message(f"{name}_Response", response)
            types |= _service(name)
        for name, parts in actions.items():
            types |= _action(name, *parts)
        self._store.register(types)
        self._hashes: dict[str, str] = {}

    def type_hash(self, name: str) -> str:
        """Return a type's hash as ``RIHS01_`` and 64 hexadecimal digits; of messages and services."""
        if name not in self._hashes:
            self._hashes[name] = self._store.hash_rihs01(name)
        return self._hashes[name]

    def make(self, name: str, /, **fields: Any) -> Any:
        """Return a message; fields that are left out are zero or empty."""
        empty = {
            field: self._empty(kind) for field, kind in self._store.fielddefs[name][1] if field not in fields
        }
        return self._store.types[name](**empty, **fields)

    def encode(self, name: str, message: Any) -> bytes:
        """Return a message's CDR payload, little endian."""
        return bytes(self._store.serialize_cdr(message, name, little_endian=True))

    def decode(self, name: str, payload: bytes) -> Any:
        """Read a payload.

        Raises:
            MalformedPayload: it is none of this type, or longer than `MAX_PAYLOAD_BYTES`.
        """
        if len(payload) > MAX_PAYLOAD_BYTES:
            raise MalformedPayload(f"{len(payload)} bytes, {MAX_PAYLOAD_BYTES} at most")
        try:
            return self._store.deserialize_cdr(payload, name)
        except (SerdeError, IndexError, OverflowError, struct.error, TypeError, ValueError) as error:
            raise MalformedPayload(str(error)) from error

    def _empty(self, kind: Any) -> Any:
        form, inner = kind
        if form == Nodetype.NAME:
            return self.make(inner)
        if form == Nodetype.BASE:
            return "" if inner[0] == "string" else False if inner[0] == "bool" else 0
        (element, name), count = inner
        if element == Nodetype.BASE and name[0] != "string":
            return _array(name[0], count if form == Nodetype.ARRAY else 0)
        return [self._empty((element, name)) for _ in range(count if form == Nodetype.ARRAY else 0)]


@cache
def interfaces() -> Interfaces:
    """Return the types that this project speaks; made once a process, in some 50 ms."""
    return Interfaces()


def _array(kind: str, count: int) -> Any:
    return np.zeros(count, "uint8" if kind in ("char", "byte") else kind)


def _message(name: str, text: str) -> Types:
    # the library reads names of messages alone: the middle of a service's or action's is put back
    package, _, last = name.split("/")
    ((_, read),) = get_types_from_msg(text, f"{package}/msg/{last}").items()
    return {name: read}


def _named(name: str) -> tuple[Nodetype, str]:
    return Nodetype.NAME, name


def _service(name: str) -> Types:
    request, response, event = f"{name}_Request", f"{name}_Response", f"{name}_Event"
    at_most_one = [(Nodetype.SEQUENCE, (_named(each), 1)) for each in (request, response)]
    info = _named(_EVENT_INFO)
    return {
        event: ([], [("info", info), ("request", at_most_one[0]), ("response", at_most_one[1])]),
        name: (
            [],
            [
                ("request_message", _named(request)),
                ("response_message", _named(response)),
                ("event_message", _named(event)),
            ],
        ),
    }


def _action(name: str, goal: str, result: str, feedback: str) -> Types:
    parts = {f"{name}_Goal": goal, f"{name}_Result": result, f"{name}_Feedback": feedback}
    types: Types = {}
    for each, text in parts.items():
        types |= _message(each, text)
    id_field = ("goal_id", _named(_UUID))
    status = ("status", (Nodetype.BASE, ("int8", 0)))
    accepted = ("accepted", (Nodetype.BASE, ("bool", 0)))
    types[f"{name}_SendGoal_Request"] = ([], [id_field, ("goal", _named(f"{name}_Goal"))])
    types[f"{name}_SendGoal_Response"] = ([], [accepted, ("stamp", _named(_TIME))])
    types[f"{name}_GetResult_Request"] = ([], [id_field])
    types[f"{name}_GetResult_Response"] = ([], [status, ("result", _named(f"{name}_Result"))])
    types[f"{name}_FeedbackMessage"] = ([], [id_field, ("feedback", _named(f"{name}_Feedback"))])
    return types | _service(f"{name}_SendGoal") | _service(f"{name}_GetResult")
