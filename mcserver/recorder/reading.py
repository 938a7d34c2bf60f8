"""Recordings as arrays: MCAP files of the recorder, and NPZ files of ``mcctl`` or a simulation."""

from __future__ import annotations

import base64
import contextlib
import json
import zipfile
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass
from mcap.records import Channel, Message, Metadata, Schema
from numpy.typing import NDArray

from mcserver.errors import UsageFault
from mcserver.machine.machine_file import Machine
from mcserver.recorder.channels import CYCLES_TOPIC, EVENTS_TOPIC, LINES_TOPIC, PROGRAM_TOPIC, LineMark
from mcserver.recorder.repair import whole_records
from mcserver.service.reports import Event
from mcserver.simulation.recorder import Recorded

Array = NDArray[np.float64]

SUFFIXES = (".mcap", ".npz")
# What a message raises that is not of the schema that its topic has here.
_NOT_UNDERSTOOD = (msgspec.MsgspecError, DecodeError, AttributeError, ValueError, KeyError)


class RecordedRun(msgspec.Struct, frozen=True):
    """A recording of cycles.

    Attributes:
        name: of the file. cycles: one row a cycle from 0 s on; the line of each.
        start_unix: of the first row [s]; 0 where it is not known.
        machine: as it was recorded; None where the file does not say.
        events: of the service. lines: those that have ended, their times counted as the rows'.
        text: lines of the program that ran most, by number from 1; empty where it is not in the file.
        velocity, torque: shape (N, K), None where they were not recorded.
    """

    name: str
    cycles: Recorded
    start_unix: float
    machine: Machine | None
    events: list[Event]
    lines: list[LineMark]
    text: dict[int, str]
    velocity: Array | None = None
    torque: Array | None = None


def is_recording(path: str) -> bool:
    """Return whether a file's name is that of a recording."""
    return Path(path).suffix.lower() in SUFFIXES


def read_recording(path: Path) -> RecordedRun:
    """Return a recording; of a truncated MCAP file as much as is whole.

    Raises:
        UsageFault: MC581 it cannot be read, or has no cycles in it.
    """
    try:
        with path.open("rb") as stream:
            run = _read_npz(path, stream) if path.suffix.lower() == ".npz" else _read_mcap(path, stream)
    except OSError as error:
        raise UsageFault(
            "MC581", f"{path} cannot be read: {error.strerror or error}", "name a .mcap or .npz file"
        ) from error
    if not len(run.cycles.time_s):
        raise UsageFault("MC581", f"{path} has no cycles in it", "mcserver recordings show FILE lists it")
    return run


def _read_npz(path: Path, stream: BinaryIO) -> RecordedRun:
    try:
        with np.load(stream, allow_pickle=False) as archive:
            arrays = {name: np.asarray(archive[name], dtype=np.float64) for name in archive.files}
        time_s, line, axes = arrays["time_s"], arrays["line"], arrays["axes"]
        setpoint, actual = arrays["setpoint"], arrays["actual"]
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise UsageFault(
            "MC581", f"{path} is no recording: {error}", "time_s, line, axes, setpoint and actual are needed"
        ) from error
    shape = (len(time_s), len(axes))
    if time_s.ndim != 1 or line.shape != time_s.shape or setpoint.shape != shape or actual.shape != shape:
        raise UsageFault("MC581", f"{path}: its arrays do not fit each other", "is the file whole?")
    recorded = Recorded(time_s - (time_s[0] if len(time_s) else 0.0), line, axes, setpoint, actual)
    return RecordedRun(path.name, recorded, 0.0, None, [], [], {})


def _read_mcap(path: Path, stream: BinaryIO) -> RecordedRun:
    gathered = _Gathered()
    for record in whole_records(stream):
        gathered.take(record)
    times = np.array(gathered.times)
    order = np.argsort(times, kind="stable")
    axes = gathered.axes
    columns: dict[str, Array | None] = {}
    for name, rows in gathered.columns.items():
        # rows of other widths, or none: this was not recorded
        fits = len(rows) == len(times) and all(len(row) == len(axes) for row in rows)
        columns[name] = np.array(rows, dtype=np.float64)[order] if fits and rows else None
    setpoint, actual = columns["setpoint"], columns["position"]
    if setpoint is None or actual is None or not len(times):
        raise UsageFault(
            "MC581", f"{path} has no cycles in it that fit its axes", "record with mcctl record start"
        )
    times = times[order]
    start = float(times[0])
    lines = [
        msgspec.structs.replace(mark, start_s=mark.start_s - start, end_s=mark.end_s - start)
        for mark in gathered.lines
    ]
    recorded = Recorded(
        time_s=times - start,
        line=np.array(gathered.line, dtype=np.float64)[order],
        axes=np.array(axes, dtype=np.float64),
        setpoint=setpoint,
        actual=actual,
    )
    return RecordedRun(
        name=path.name,
        cycles=recorded,
        start_unix=gathered.epoch + start if gathered.epoch else 0.0,
        machine=gathered.machine,
        events=gathered.events,
        lines=lines,
        text=gathered.longest_text(),
        velocity=columns["velocity"],
        torque=columns["torque"],
    )


class _Gathered:
    """What the records of a file hold, record after record."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.line: list[int] = []
        self.columns: dict[str, list[list[float]]] = {
            name: [] for name in ("setpoint", "position", "velocity", "torque")
        }
        self.axes: list[int] = []
        self.events: list[Event] = []
        self.lines: list[LineMark] = []
        self.machine: Machine | None = None
        self.epoch = 0.0
        self._texts: dict[str, dict[int, str]] = {}
        self._schemas: dict[int, Schema] = {}
        self._topics: dict[int, str] = {}
        self._cycle: Any = None
        self._reads = {
            EVENTS_TOPIC: self._take_event,
            LINES_TOPIC: self._take_line,
            PROGRAM_TOPIC: self._take_text,
            CYCLES_TOPIC: self._take_cycle,
        }

    def take(self, record: object) -> None:
        """Look at a record; a message that cannot be understood is left out."""
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            self._take_channel(record)
        elif isinstance(record, Metadata) and record.name == "mcserver":
            self._take_metadata(record.metadata)
        elif isinstance(record, Message):
            read = self._reads.get(self._topics.get(record.channel_id, ""))
            if read is not None:
                with contextlib.suppress(*_NOT_UNDERSTOOD):
                    read(record.data)

    def longest_text(self) -> dict[int, str]:
        return max(self._texts.values(), key=len, default={})

    def _take_channel(self, channel: Channel) -> None:
        self._topics[channel.id] = channel.topic
        schema = self._schemas.get(channel.schema_id)
        if channel.topic != CYCLES_TOPIC or schema is None or schema.encoding != "protobuf":
            return
        try:
            pool = DescriptorPool()
            for file in FileDescriptorSet.FromString(schema.data).file:
                pool.Add(file)
            self._cycle = GetMessageClass(pool.FindMessageTypeByName(schema.name))
            self.axes = [int(axis) for axis in channel.metadata.get("axes", "").split(",") if axis]
        except (DecodeError, KeyError, TypeError, ValueError):
            self._cycle = None

    def _take_metadata(self, values: dict[str, str]) -> None:
        with contextlib.suppress(ValueError, msgspec.MsgspecError):
            self.epoch = float(values.get("epoch", "0"))
            if "model" in values:
                self.machine = msgspec.msgpack.decode(base64.b64decode(values["model"]), type=Machine)

    def _take_cycle(self, data: bytes) -> None:
        if self._cycle is None:
            return
        message = self._cycle.FromString(data)
        self.times.append(message.time)
        self.line.append(message.line)
        for name, rows in self.columns.items():
            rows.append(list(getattr(message, name)))

    def _take_event(self, data: bytes) -> None:
        self.events.append(msgspec.json.decode(data, type=Event))

    def _take_line(self, data: bytes) -> None:
        self.lines.append(msgspec.json.decode(data, type=LineMark))

    def _take_text(self, data: bytes) -> None:
        part = json.loads(data)
        lines = self._texts.setdefault(str(part["program"]), {})
        for number, line in enumerate(part["lines"], start=int(part["first"])):
            lines[number] = str(line)
