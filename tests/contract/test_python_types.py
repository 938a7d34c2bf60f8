"""The Python SDK reads the contract's messages, and refuses anything else."""

from __future__ import annotations

import base64
import dataclasses
import inspect
from typing import Any

import mcclient.types
import msgspec
import pytest
from mcclient.errors import ProtocolError
from mcclient.wire import decode

from tests.contract.vectors import GARBAGE, names, read

# what the SDK calls otherwise than the wire
RENAMED = {"WireDiagnostic": "Diagnostic"}
KINDS = {
    name: kind
    for name, kind in vars(mcclient.types).items()
    if inspect.isclass(kind) and dataclasses.is_dataclass(kind)
}
READ = [name for name in names("messages") if RENAMED.get(name, name) in KINDS]


def as_json(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: as_json(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {key: as_json(each) for key, each in value.items()}
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    return [as_json(each) for each in value] if isinstance(value, tuple | list) else value


def test_the_messages_of_a_stream_are_among_those_read() -> None:
    assert {"Ack", "OpenReply", "SubmitReply", "ProgramStatus", "ErrorReply", "Event", "Info"} <= set(READ)


@pytest.mark.parametrize("name", READ)
def test_every_vector_is_read_as_its_value(name: str) -> None:
    kind: type[Any] = KINDS[RENAMED.get(name, name)]
    file = read(f"messages/{name}.json")
    for vector in [*file["vectors"], *file.get("later_words", ())]:
        assert as_json(decode(kind, bytes.fromhex(vector["bytes"]))) == vector["value"], vector["name"]


@pytest.mark.parametrize("name", ["Ack", "OpenReply", "SubmitReply", "ErrorReply"])
def test_what_is_no_message_is_refused(name: str) -> None:
    kind: type[Any] = KINDS[RENAMED.get(name, name)]
    for vector in [*GARBAGE, *read(f"messages/{name}.json")["refused"]]:
        with pytest.raises(ProtocolError):
            decode(kind, bytes.fromhex(vector["bytes"]))


def test_values_are_written_as_the_wire_has_them() -> None:
    for name in names("messages"):
        file = read(f"messages/{name}.json")
        if file["sent_by"] == "client" and not file["array"]:
            for vector in file["vectors"]:
                written = msgspec.msgpack.decode(mcclient.wire.encode(vector["value"]))
                assert written == vector["value"]
