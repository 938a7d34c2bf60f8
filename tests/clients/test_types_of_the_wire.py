"""The client's types are its own, and name what the server sends."""

from __future__ import annotations

import dataclasses
import inspect

import mcclient.types
import pytest

from mcserver.net.schemas import message_types

# What only one side has: the client's own views of replies, gathered from several messages.
OWN = {"SdoObject", "CheckResult", "EventPage", "OpenedProgram"}
TYPES = {
    name: kind
    for name, kind in vars(mcclient.types).items()
    if inspect.isclass(kind) and kind.__module__ == mcclient.types.__name__ and name not in OWN
}


@pytest.mark.parametrize("name", sorted(TYPES))
def test_a_type_of_the_client_has_the_fields_that_the_server_sends(name: str) -> None:
    known = message_types()
    # what the server calls a diagnostic on the wire
    server = known.get(name) or known[f"Wire{name}"]
    fields = {field.name for field in dataclasses.fields(TYPES[name])}
    assert fields == set(server.__struct_fields__)
