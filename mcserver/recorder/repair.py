"""Repair of files that were not written to their end: what is whole is kept, and gets a summary."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import msgspec
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer

from mcserver.errors import UsageFault
from mcserver.recorder.folder import SUFFIX, RecordingFolder

# What a damaged file makes a reader of it raise.
DAMAGE = (McapError, struct.error, zstandard.ZstdError, ValueError, EOFError, OverflowError, MemoryError)
# No record of ours is larger; a damaged length must not ask for the computer's memory.
MAX_RECORD_BYTES = 256 << 20


class RepairReport(msgspec.Struct, frozen=True):
    """What was kept of a file.

    Attributes:
        messages: how many. start_ns, end_ns: of the first and the last. whole: nothing was missing.
    """

    messages: int
    start_ns: int
    end_ns: int
    whole: bool


def whole_records(stream: BinaryIO) -> Iterator[McapRecord]:
    """Records of a file from its beginning to its end or to its first damage; chunks are opened.

    Raises:
        UsageFault: MC581 it is no MCAP file at all.
    """
    reader = StreamReader(stream, emit_chunks=True, record_size_limit=MAX_RECORD_BYTES)
    records = reader.records
    first = True
    while True:
        try:
            record = next(records, None)
            opened = breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else None
        except DAMAGE as error:
            if first:
                raise UsageFault("MC581", "this is no MCAP file", "was the right file named?") from error
            return
        if record is None:
            return
        first = False
        if opened is None:
            yield record
        else:
            yield from opened


def repair(source: Path, target: Path) -> RepairReport:
    """Copy what is whole of ``source``, which may be ``target`` too, into a file with a summary.

    Raises:
        UsageFault: MC581 it is no MCAP file. OSError.
    """
    temporary = target.with_name(f"{target.name}.{os.getpid()}.new")
    try:
        with source.open("rb") as stream, temporary.open("wb") as output:
            writer = new_writer(output)
            found = copy_whole(stream, writer)
            writer.finish()
            os.fsync(output.fileno())
        os.replace(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return found


def new_writer(output: BinaryIO) -> Writer:
    """Begin a file."""
    writer = Writer(output, compression=CompressionType.ZSTD)
    writer.start(library="mcserver")
    return writer


def copy_whole(stream: BinaryIO, writer: Writer) -> RepairReport:
    """Copy what is whole of a file, and say what that was.

    Raises:
        UsageFault: MC581 it is no MCAP file. OSError.
    """
    schemas: dict[int, int] = {0: 0}
    topics: dict[int, int] = {}
    count, start, end, whole = 0, 0, 0, False
    for record in whole_records(stream):
        if isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in topics and record.schema_id in schemas:
            topics[record.id] = writer.register_channel(
                record.topic, record.message_encoding, schemas[record.schema_id], record.metadata
            )
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
        elif isinstance(record, Message) and record.channel_id in topics:
            writer.add_message(
                topics[record.channel_id],
                record.log_time,
                record.data,
                record.publish_time,
                record.sequence,
            )
            start = min(start, record.log_time) if count else record.log_time
            end = max(end, record.log_time)
            count += 1
        elif type(record).__name__ == "Footer":
            whole = True
    return RepairReport(count, start, end, whole)


def repair_unfinished(folder: RecordingFolder) -> list[str]:
    """Repair what a killed recorder left behind.

    Returns:
        A sentence for each file that could not be repaired; it stays as it is.
    """
    problems = []
    for entry in folder.entries():
        if entry.state != "unfinished":
            continue
        path = folder.unfinished(entry.name)
        try:
            repair(path, folder.finished(entry.name))
            path.unlink()
        except (OSError, UsageFault) as error:
            problems.append(f"{path.name} was left unfinished and cannot be repaired: {error}")
    return problems


def repaired_name(path: Path) -> Path:
    """Return where a repaired file goes unless something else is asked for: beside it, under a new name."""
    stem = path.name.removesuffix(".part").removesuffix(SUFFIX)
    return path.with_name(f"{stem}-repaired{SUFFIX}")
