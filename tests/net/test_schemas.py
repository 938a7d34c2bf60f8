"""The published schemas are those of the messages."""

from __future__ import annotations

from pathlib import Path

import msgspec

from mcserver.net.messages import OpenRequest, StreamLines
from mcserver.net.schemas import message_types, schemas

PUBLISHED = Path(__file__).parents[2] / "docs" / "schemas"


def test_the_published_schemas_are_current() -> None:
    published = {path.name: path.read_text("utf-8") for path in PUBLISHED.glob("*.json")}
    assert published == schemas(), "run: python -m mcserver.net.schemas docs/schemas"


def test_every_message_of_the_reference_has_a_schema() -> None:
    docs = PUBLISHED.parent
    pages = [docs / "keyspace.md", *(docs / "wire").glob("*.md")]
    reference = "\n".join(page.read_text("utf-8") for page in pages)
    assert [name for name in message_types() if name not in ("Request",) and name not in reference] == []


def test_messages_are_maps_and_streamed_lines_an_array() -> None:
    assert isinstance(msgspec.msgpack.decode(msgspec.msgpack.encode(OpenRequest())), dict)
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(StreamLines(3, ["G90"], 1))) == [3, ["G90"], 1]
    # who does not count rejections leaves the count out
    short = msgspec.msgpack.encode([3, ["G90"]])
    assert msgspec.msgpack.decode(short, type=StreamLines) == StreamLines(3, ["G90"])
