"""A recording's file: MCAP, written chunk by chunk, with a summary at its end."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import BinaryIO

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from mcserver.recorder.chunks import Chunk

MAGIC = b"\x89MCAP0\r\n"
LIBRARY = "mcserver"


class McapFile:
    """Writes to a stream from its beginning; up to `finish` what is there opens as a truncated file.

    Args:
        stream: nothing is read from it; closed by `close`.
        schemas, channels: of all chunks to come.
        metadata: records of text by name.
    """

    def __init__(
        self,
        stream: BinaryIO,
        schemas: Sequence[Schema],
        channels: Sequence[Channel],
        metadata: Mapping[str, Mapping[str, str]],
    ) -> None:
        self._stream = stream
        self._schemas = list(schemas)
        self._channels = list(channels)
        self._chunks: list[ChunkIndex] = []
        self._counts: Counter[int] = Counter()
        self._metadata: list[MetadataIndex] = []
        self.size = 0
        builder = RecordBuilder()
        Header("", LIBRARY).write(builder)
        for record in (*self._schemas, *self._channels):
            record.write(builder)
        head = MAGIC + builder.end()
        for name, values in metadata.items():
            Metadata(name=name, metadata=dict(values)).write(builder)
            record_bytes = builder.end()
            self._metadata.append(MetadataIndex(len(head), len(record_bytes), name))
            head += record_bytes
        self._write(head)

    def add(self, chunk: Chunk) -> None:
        """Raise OSError where it cannot be written; the file may end in a part of the chunk then."""
        index = chunk.index_at(self.size)
        self._write(chunk.data)
        self._chunks.append(index)
        self._counts.update(chunk.counts)

    def finish(self) -> None:
        """Write the summary. Raises OSError."""
        builder = RecordBuilder()
        DataEnd(0).write(builder)
        self._write(builder.end())
        start = self.size
        offsets: list[SummaryOffset] = []
        groups = (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.METADATA_INDEX, self._metadata),
        )
        for opcode, records in groups:
            at = builder.count
            for record in records:
                record.write(builder)
            if builder.count > at:
                offsets.append(SummaryOffset(opcode, builder.count - at, start + at))
        offsets_start = start + builder.count
        for offset in offsets:
            offset.write(builder)
        summary = builder.end()
        # the checksum covers the footer up to itself
        covered = summary + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_start)
        Footer(start, offsets_start, zlib.crc32(covered)).write(builder)
        self._write(summary + builder.end() + MAGIC)

    def close(self) -> None:
        """Close the stream."""
        self._stream.close()

    def _statistics(self) -> Statistics:
        times = [(index.message_start_time, index.message_end_time) for index in self._chunks]
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=self._counts.total(),
            message_end_time=max((end for _, end in times), default=0),
            message_start_time=min((start for start, _ in times), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _write(self, part: bytes) -> None:
        view = memoryview(part)
        while view:
            # an unbuffered file may take a part only
            view = view[self._stream.write(view) :]
        self.size += len(part)
