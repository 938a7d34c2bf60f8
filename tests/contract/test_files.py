"""The published contract is what the server's code makes, and the server's decoders keep it."""

from __future__ import annotations

import msgspec
import pytest

from mcserver.contract.files import contract
from mcserver.contract.vectors import plain
from mcserver.contract.wide import encode_wide
from mcserver.errors import ServiceError
from mcserver.net.decoding import MessageDecoder
from mcserver.net.schemas import message_types
from tests.contract.vectors import FOLDER, GARBAGE, names, read

KINDS = message_types()


def test_the_published_contract_is_current() -> None:
    made = contract()
    published = {
        str(path.relative_to(FOLDER)): path.read_text("utf-8")
        for path in FOLDER.rglob("*.json")
        if path.parent.name != "schemas"
    }
    stale = sorted(name for name in made.keys() | published.keys() if made.get(name) != published.get(name))
    assert stale == [], "run: python -m mcserver.contract clients/contract"


def test_every_message_has_vectors_and_a_schema() -> None:
    assert names("messages") == sorted(KINDS.keys() - {"Request"})
    for name in names("messages"):
        assert (FOLDER / read(f"messages/{name}.json")["schema"]).is_file()


@pytest.mark.parametrize("name", names("messages"))
def test_the_server_reads_every_vector_as_its_value(name: str) -> None:
    kind = KINDS[name]
    file = read(f"messages/{name}.json")
    decode = msgspec.msgpack.Decoder(kind).decode
    for vector in file["vectors"]:
        message = decode(bytes.fromhex(vector["bytes"]))
        assert plain(message) == vector["value"], vector["name"]
        # what the server writes of it means the same
        assert decode(msgspec.msgpack.encode(message)) == message


@pytest.mark.parametrize("name", names("messages"))
def test_the_server_refuses_what_has_to_be_refused_with_its_code(name: str) -> None:
    decode = MessageDecoder(KINDS[name])
    for vector in [*GARBAGE, *read(f"messages/{name}.json")["refused"]]:
        with pytest.raises(ServiceError) as refused:
            decode(bytes.fromhex(vector["bytes"]))
        assert refused.value.code == vector["code"], vector["name"]


@pytest.mark.parametrize("name", names("messages"))
def test_a_field_that_is_left_out_has_the_default_that_the_file_names(name: str) -> None:
    file = read(f"messages/{name}.json")
    required = next(each for each in file["vectors"] if each["name"] == "required fields alone")
    given = msgspec.msgpack.decode(bytes.fromhex(required["bytes"]))
    if not file["array"]:
        for field, default in file["defaults"].items():
            assert field not in given
            assert required["value"][field] == default


@pytest.mark.parametrize("value", [None, True, -1, 7, 2**63, -0.0, "ß", b"\0", [1, ["x"]], {"a": {}}])
def test_the_widest_form_means_the_same(value: object) -> None:
    assert msgspec.msgpack.decode(encode_wide(value)) == value
