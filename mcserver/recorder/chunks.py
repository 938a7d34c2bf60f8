"""Chunks: half a second of a recording, encoded and compressed once for all files that take it."""

from __future__ import annotations

import struct
import zlib

import msgspec
import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk as ChunkRecord
from mcap.records import ChunkIndex, Message
from numpy.typing import NDArray

COMPRESSION = "zstd"
# The quickest: the next levels save some percent for twice the time.
LEVEL = 1

Times = NDArray[np.uint64]


class Chunk(msgspec.Struct, frozen=True):
    """A chunk as it stands in a file, with its message indexes behind it.

    Attributes:
        data: the chunk's record and the index records. index_offsets: of each channel's index, from the
            beginning of ``data``. record_size: bytes of the chunk's record alone.
        start_ns, end_ns: least and greatest time of its messages. counts: messages by channel.
    """

    data: bytes
    record_size: int
    index_offsets: dict[int, int]
    start_ns: int
    end_ns: int
    compressed_size: int
    uncompressed_size: int
    counts: dict[int, int]

    def index_at(self, offset: int) -> ChunkIndex:
        """Return the chunk's entry in the summary of a file in which it stands at ``offset``."""
        return ChunkIndex(
            chunk_length=self.record_size,
            chunk_start_offset=offset,
            compression=COMPRESSION,
            compressed_size=self.compressed_size,
            message_end_time=self.end_ns,
            message_index_length=len(self.data) - self.record_size,
            message_index_offsets={
                channel: offset + relative for channel, relative in self.index_offsets.items()
            },
            message_start_time=self.start_ns,
            uncompressed_size=self.uncompressed_size,
        )


class ChunkBuilder:
    """Gathers messages until `finish` makes a chunk of them.

    Attributes:
        size: bytes gathered, uncompressed.
    """

    def __init__(self) -> None:
        self.size = 0
        self._parts: list[bytes] = []
        self._index: dict[int, list[tuple[Times, Times]]] = {}
        self._sequences: dict[int, int] = {}
        self._compressor = zstandard.ZstdCompressor(level=LEVEL)

    @property
    def empty(self) -> bool:
        return not self._parts

    def add_block(self, channel: int, log_time: Times, records: bytes) -> None:
        """Message records of one channel, all of the same size; ``log_time``: shape (n,) [ns]."""
        if not len(log_time):
            return
        each = len(records) // len(log_time)
        offsets = np.arange(self.size, self.size + len(records), each, dtype=np.uint64)
        self._index.setdefault(channel, []).append((log_time, offsets))
        self._parts.append(records)
        self.size += len(records)

    def add_message(self, channel: int, log_time_ns: int, payload: bytes) -> None:
        """One message."""
        sequence = self._sequences.get(channel, 0)
        self._sequences[channel] = sequence + 1
        builder = RecordBuilder()
        Message(channel, log_time_ns, payload, log_time_ns, sequence & 0xFFFFFFFF).write(builder)
        self.add_block(channel, np.array([log_time_ns], dtype=np.uint64), builder.end())

    def finish(self) -> Chunk | None:
        """Return the chunk of what was gathered, None where that is nothing; the next one begins empty."""
        if not self._parts:
            return None
        plain = b"".join(self._parts)
        compressed = self._compressor.compress(plain)
        indexes = {
            channel: tuple(np.concatenate(columns) for columns in zip(*blocks, strict=True))
            for channel, blocks in self._index.items()
        }
        start = min(int(times.min()) for times, _ in indexes.values())
        end = max(int(times.max()) for times, _ in indexes.values())
        builder = RecordBuilder()
        ChunkRecord(COMPRESSION, compressed, end, start, zlib.crc32(plain), len(plain)).write(builder)
        parts = [builder.end()]
        record_size = len(parts[0])
        offsets: dict[int, int] = {}
        at = record_size
        for channel, (times, places) in indexes.items():
            order = np.argsort(times, kind="stable")
            pairs = np.stack([times[order], places[order]], axis=1).astype("<u8").tobytes()
            offsets[channel] = at
            parts.append(
                struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(pairs), channel, len(pairs)) + pairs
            )
            at += len(parts[-1])
        chunk = Chunk(
            data=b"".join(parts),
            record_size=record_size,
            index_offsets=offsets,
            start_ns=start,
            end_ns=end,
            compressed_size=len(compressed),
            uncompressed_size=len(plain),
            counts={channel: len(times) for channel, (times, _) in indexes.items()},
        )
        self._parts, self._index, self.size = [], {}, 0
        return chunk
