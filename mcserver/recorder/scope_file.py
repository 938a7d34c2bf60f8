"""A scope's trace as MCAP: one Protobuf message a cycle, a field for each signal."""

from __future__ import annotations

import re
from typing import BinaryIO

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from mcap.records import Channel, Schema

from mcserver.canopen.scope import ScopeTrace
from mcserver.recorder.channels import message_descriptor
from mcserver.recorder.chunks import ChunkBuilder
from mcserver.recorder.fixed_records import Field, FixedRecords, Kind
from mcserver.recorder.mcap_file import McapFile

CHANNEL, SCHEMA = 1, 1
# Messages of a chunk.
BLOCK = 4096


def write_scope(stream: BinaryIO, trace: ScopeTrace, machine: str, trigger_unix: float) -> None:
    """Write a trace into a stream.

    Args:
        machine: its name. trigger_unix: Unix time of the trigger [s].
    """
    names = field_names(trace)
    fields = [Field("time", 1, Kind.DOUBLE)]
    fields += [Field(name, number, Kind.DOUBLE) for number, name in enumerate(names, start=2)]
    file = FileDescriptorProto(
        name="mcserver/scope.proto",
        package="mcserver",
        syntax="proto3",
        message_type=[message_descriptor("Scope", fields)],
    )
    described = FileDescriptorSet(file=[file]).SerializeToString()
    metadata = {
        "names": "\n".join(trace.names),
        "units": "\n".join(trace.units),
        "objects": "\n".join(trace.objects),
        "machine": machine,
    }
    recording = McapFile(
        stream,
        [Schema(SCHEMA, described, "protobuf", "mcserver.Scope")],
        [Channel(CHANNEL, f"/scope/axis_{trace.axis}", "protobuf", metadata, SCHEMA)],
        {},
    )
    records, builder = FixedRecords(CHANNEL, fields), ChunkBuilder()
    log_time = (round(trigger_unix * 1e9) + np.round(trace.time_s * 1e9).astype(np.int64)).astype(np.uint64)
    for first in range(0, len(log_time), BLOCK):
        rows = slice(first, first + BLOCK)
        values = {name: trace.values[rows, at] for at, name in enumerate(names)}
        encoded = records.encode(log_time[rows], first, {"time": trace.time_s[rows], **values})
        builder.add_block(CHANNEL, log_time[rows], encoded)
        chunk = builder.finish()
        assert chunk is not None
        recording.add(chunk)
    recording.finish()


def field_names(trace: ScopeTrace) -> list[str]:
    """Names of the signals as Protobuf's fields have them, each once."""
    found: list[str] = []
    for name, place in zip(trace.names, trace.objects, strict=True):
        plain = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
        plain = plain if plain[:1].isalpha() else f"signal_{plain}"
        if plain in found or plain == "time":
            plain += "_" + re.sub(r"[^0-9a-z]+", "_", place.lower())
        found.append(plain)
    return found
