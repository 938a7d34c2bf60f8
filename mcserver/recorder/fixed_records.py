"""Many Protobuf messages of one size at once, each as an MCAP message record, by NumPy.

A message whose fields are all of a fixed size has every byte at a fixed place: a block of messages is an
array of records whose tags and lengths stand in a template, and whose values are columns.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

_HEADER = (
    ("opcode", "u1"),
    ("length", "<u8"),
    ("channel", "<u2"),
    ("sequence", "<u4"),
    ("log_time", "<u8"),
    ("publish_time", "<u8"),
)
_HEADER_BYTES = 9
_VARINT, _FIXED64, _PACKED, _FIXED32 = 0, 1, 2, 5


class Kind(enum.Enum):
    """Type of a field: its NumPy type and its wire type in Protobuf."""

    UINT64 = ("<u8", _FIXED64)
    DOUBLE = ("<f8", _FIXED64)
    UINT32 = ("<u4", _FIXED32)
    FLOAT = ("<f4", _FIXED32)
    # one byte: values below 128
    SMALL = ("u1", _VARINT)

    def __init__(self, dtype: str, wire: int) -> None:
        self.dtype = dtype
        self.wire = wire


class Field(msgspec.Struct, frozen=True):
    """One field of a message.

    Attributes:
        number: in the schema. count: of a packed repeated field; None: a single value.
    """

    name: str
    number: int
    kind: Kind
    count: int | None = None


def varint(value: int) -> bytes:
    """Protobuf's variable-length form of a number that is not negative."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


class FixedRecords:
    """Encodes blocks of messages of one channel.

    Args:
        channel: its id in the file. fields: in the order of their numbers.

    Attributes:
        size: bytes of one record, its MCAP header included.
    """

    def __init__(self, channel: int, fields: Sequence[Field]) -> None:
        columns: list[tuple[str, str] | tuple[str, str, tuple[int, ...]]] = list(_HEADER)
        tags: dict[str, bytes] = {}
        for field in fields:
            if field.count == 0:
                continue
            tag = varint(field.number << 3 | (field.kind.wire if field.count is None else _PACKED))
            if field.count is None:
                columns += [(f"{field.name}.tag", "u1", (len(tag),)), (field.name, field.kind.dtype)]
            else:
                tag += varint(field.count * np.dtype(field.kind.dtype).itemsize)
                columns += [
                    (f"{field.name}.tag", "u1", (len(tag),)),
                    (field.name, field.kind.dtype, (field.count,)),
                ]
            tags[f"{field.name}.tag"] = tag
        self._template = np.zeros(1, dtype=columns)
        self.size = self._template.dtype.itemsize
        self._template["opcode"] = Opcode.MESSAGE
        self._template["length"] = self.size - _HEADER_BYTES
        self._template["channel"] = channel
        for name, tag in tags.items():
            self._template[name] = np.frombuffer(tag, "u1")

    def encode(
        self, log_time: NDArray[np.uint64], sequence: int, values: Mapping[str, NDArray[np.generic]]
    ) -> bytes:
        """Records of n messages.

        Args:
            log_time: shape (n,) [ns, Unix]. sequence: number of the first one in its channel.
            values: by field, shape (n,) or (n, count); a field that is left out, or has no room, is 0.
        """
        block = np.repeat(self._template, len(log_time))
        block["log_time"] = log_time
        block["publish_time"] = log_time
        block["sequence"] = (sequence + np.arange(len(log_time))) & 0xFFFFFFFF
        for name, column in values.items():
            if name in (self._template.dtype.names or ()):
                block[name] = column
        return block.tobytes()
