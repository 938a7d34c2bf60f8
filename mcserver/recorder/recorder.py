"""What the recorder does with rows, events and commands; free of processes and clocks."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

from mcserver.errors import ServiceError
from mcserver.executor.shm.feedback import CYCLES, GUARD, TIME, FeedbackRing
from mcserver.machine.machine_file import Machine
from mcserver.recorder import messages as wire
from mcserver.recorder.black_box import BlackBox
from mcserver.recorder.channels import EVENTS, LINES, NOTES, LineMark, Note
from mcserver.recorder.chunks import ChunkBuilder
from mcserver.recorder.cycle_encoder import CycleEncoder
from mcserver.recorder.folder import BLACK_BOX, RecordingFolder, check_name, time_stamp
from mcserver.recorder.program_text import ProgramsSeen, text_chunk
from mcserver.recorder.sink import FileWriter, NotWritten, Sink, Written
from mcserver.recorder.triggers import EVENTS as TRIGGERING
from mcserver.recorder.triggers import FaultEdges, Trigger
from mcserver.service.reports import Event
from mcserver.simulation.tool_poses import ToolPoses

# A chunk holds so much, or so many bytes [s].
CHUNK_S = 0.5
CHUNK_BYTES = 4 << 20
# Rows taken from the ring in one go, and goes a turn: a late recorder catches up within a turn.
ROWS_AT_ONCE, GOES = 512, 8
# Between two black boxes that faults write [s]: a fault that comes again and again fills no disk.
LEAST_PAUSE_S = 30.0
# What is kept before a fault in any case [s].
BEFORE_S = 5.0
# Without new cycles for so long the executor is gone, and nothing is waited for [s of the clock].
SILENCE_S = 3.0
RECORDINGS_AT_ONCE = 4


class Recording:
    """A recording that somebody started."""

    def __init__(self, sink: Sink, ends_s: float | None) -> None:
        self.sink = sink
        self.ends_s = ends_s


class Recorder:
    """One machine's recorder.

    Args:
        machine: what is recorded. ring: the executor's feedback.
        start: epoch, instance and journal. poses: of the tools.
        folder, writer: where files go. clock: Unix time [s].
    """

    def __init__(
        self,
        machine: Machine,
        ring: FeedbackRing,
        start: wire.RecorderStart,
        poses: ToolPoses,
        folder: RecordingFolder,
        writer: FileWriter,
        clock: Callable[[], float],
    ) -> None:
        settings = machine.recorder
        self._machine = machine
        self._settings = settings
        self._ring = ring
        self._start = start
        self._folder = folder
        self._writer = writer
        self._clock = clock
        self._encoder = CycleEncoder(machine, ring, start.epoch, poses)
        self._edges = FaultEdges(ring)
        self._builder = ChunkBuilder()
        self._box = BlackBox(60.0 * settings.minutes, settings.max_mb << 20)
        self._programs = ProgramsSeen()
        # the ring's last seconds are there before the recorder is
        self._next = max(0, ring.written - CYCLES + 2 * GUARD)
        self._chunk_since = 0.0
        self._time = 0.0
        self._rows_at = clock()
        self._trigger: Trigger | None = None
        # a short box would have lost the fault by the end of a long pause
        self._pause_s = min(LEAST_PAUSE_S, 30.0 * settings.minutes)
        self._saved_at = -self._pause_s
        self._missed = 0
        self._recordings: dict[str, Recording] = {}
        self._tickets: dict[str, int] = {}
        self._reasons: dict[str, str] = {}
        self._reports: list[wire.Report] = []

    # ------------------------------------------------------------ in

    def turn(self) -> list[wire.Report]:
        """Take what the ring has, write what is due; give what the server should know."""
        self._catch_up()
        self._check_trigger()
        for name, recording in list(self._recordings.items()):
            if recording.ends_s is not None and self._time >= recording.ends_s:
                self._finish_recording(name)
        self._take_outcomes()
        reports, self._reports = self._reports, []
        return reports

    def handle(self, command: wire.Command) -> None:
        """Carry out a command; its answer comes with the reports."""
        # what has passed by now lies before it
        self._catch_up()
        if isinstance(command, wire.ServiceEvents):
            if command.lost:
                self._note("events_lost", count=command.lost)
            for event in command.events:
                self._take_event(event)
        elif isinstance(command, wire.AskStatus):
            self._reports.append(wire.Answer(command.ticket, status=self._status()))
        elif not isinstance(command, wire.Quit):
            try:
                self._carry_out(command)
            except ServiceError as error:
                self._reports.append(
                    wire.Answer(command.ticket, code=error.code, message=error.message, hint=error.hint)
                )

    def server_lost(self) -> None:
        """The server has gone without a word: a black box is due."""
        self._on_cause(self._time, "server-lost")

    def finish(self) -> None:
        """Write what is due, and end the recordings."""
        if self._trigger is not None:
            self._save_triggered(self._trigger)
        for name in list(self._recordings):
            self._finish_recording(name)

    @property
    def waiting(self) -> bool:
        """Whether the seconds behind a fault are still to be recorded."""
        return self._trigger is not None

    # ------------------------------------------------------------ cycles and events

    def _catch_up(self) -> None:
        for _ in range(GOES):
            if not self._take_rows():
                return

    def _take_rows(self) -> bool:
        first, rows = self._ring.since(self._next, ROWS_AT_ONCE)
        if not len(rows):
            return False
        missed = first - self._next
        if missed > 0:
            self._missed += missed
            self._note("gap", count=missed, t=float(rows[0, TIME]))
        self._next = first + len(rows)
        self._rows_at = self._clock()
        self._time = float(rows[-1, TIME])
        if self._builder.empty:
            self._chunk_since = float(rows[0, TIME])
        for channel, times, records in self._encoder.blocks(rows):
            self._builder.add_block(channel, times, records)
        edge = self._edges.first(rows)
        if edge is not None:
            self._on_cause(*edge)
        if self._time - self._chunk_since >= CHUNK_S or self._builder.size >= CHUNK_BYTES:
            self._close_chunk()
        return len(rows) == ROWS_AT_ONCE

    def _take_event(self, event: Event) -> None:
        self._programs.note(event)
        if event.kind == "lines.ended" and event.program is not None:
            for line in event.lines:
                mark = LineMark(event.program, **msgspec.structs.asdict(line))
                self._builder.add_message(LINES, self._ns(line.end_s), msgspec.json.encode(mark))
        elif event.kind != "lines.started":
            self._builder.add_message(EVENTS, self._ns(event.t), msgspec.json.encode(event))
        if event.kind in TRIGGERING:
            code = event.fault.code if event.fault is not None else event.kind
            self._on_cause(event.t, code)

    def _on_cause(self, t: float, reason: str) -> None:
        if self._trigger is not None:
            self._trigger.add(reason)
            return
        self._trigger = Trigger(t, reason, self._settings.after_s)
        self._trigger.due_s = max(self._trigger.due_s, self._saved_at + self._pause_s)

    def _check_trigger(self) -> None:
        trigger = self._trigger
        if trigger is None:
            return
        silent = self._clock() - self._rows_at > SILENCE_S
        # where memory is short the box may be about to let go of what was before the fault
        going = self._box.start_ns > self._ns(trigger.t - BEFORE_S)
        over = self._time >= trigger.t + self._settings.after_s
        if silent or self._time >= trigger.due_s or (going and over):
            self._save_triggered(trigger)

    def _note(self, kind: str, *, count: int = 0, t: float | None = None, text: str = "") -> None:
        at = self._time if t is None else t
        self._builder.add_message(NOTES, self._ns(at), msgspec.json.encode(Note(kind, at, count, text)))

    def _close_chunk(self) -> None:
        chunk = self._builder.finish()
        if chunk is None:
            return
        self._box.add(chunk)
        for recording in self._recordings.values():
            self._writer.add(recording.sink, [chunk])
        self._chunk_since = self._time

    def _ns(self, t: float) -> int:
        return int(self._encoder.log_time(np.array([max(t, 0.0)]))[0])

    # ------------------------------------------------------------ files

    def _save_triggered(self, trigger: Trigger) -> None:
        self._trigger = None
        self._saved_at = self._time
        self._save(trigger.reason)

    def _save(self, reason: str, ticket: int | None = None) -> None:
        self._note("trigger", text=reason)
        self._close_chunk()
        name = self._free_name(f"{BLACK_BOX}{time_stamp(self._clock())}-{_word(reason)}")
        sink = self._begin(name, reason, ticket)
        self._writer.add(sink, self._box.chunks)
        self._end(sink)

    def _carry_out(self, command: wire.StartRecording | wire.StopRecording | wire.SaveBlackBox) -> None:
        if isinstance(command, wire.SaveBlackBox):
            self._save(command.reason, command.ticket)
        elif isinstance(command, wire.StartRecording):
            if len(self._recordings) >= RECORDINGS_AT_ONCE:
                raise ServiceError("MC586", f"{RECORDINGS_AT_ONCE} recordings run", "stop one of them first")
            name = check_name(command.name) if command.name else self._free_name(time_stamp(self._clock()))
            if self._folder.taken(name) or name in self._recordings or name.startswith(BLACK_BOX):
                raise ServiceError("MC584", f"there is a recording {name!r} already", "give another name")
            # what was before belongs to the black box alone
            self._close_chunk()
            sink = self._begin(name, "asked", None)
            ends_s = None if command.max_s is None else self._time + command.max_s
            self._recordings[name] = Recording(sink, ends_s)
            self._reports.append(wire.Answer(command.ticket, name=name))
        else:
            if not self._recordings or (not command.name and len(self._recordings) > 1):
                there = ", ".join(self._recordings) or "nothing"
                raise ServiceError("MC585", f"being recorded now: {there}", "name one of these")
            name = command.name or next(iter(self._recordings))
            if name not in self._recordings:
                raise ServiceError(
                    "MC585", f"{name!r} is not being recorded", "mcctl record list shows what is"
                )
            self._tickets[name] = command.ticket
            self._finish_recording(name)

    def _finish_recording(self, name: str) -> None:
        self._close_chunk()
        self._end(self._recordings.pop(name).sink)

    def _begin(self, name: str, reason: str, ticket: int | None) -> Sink:
        self._reasons[name] = reason
        if ticket is not None:
            self._tickets[name] = ticket
        return self._writer.begin(name, metadata_of(self._machine, self._start, reason))

    def _end(self, sink: Sink) -> None:
        journal, programs = Path(self._start.journal), self._programs.snapshot()
        at_ns = self._ns(self._time)
        self._writer.add_made(sink, lambda: text_chunk(journal, programs, at_ns))
        self._writer.finish(sink)

    def _take_outcomes(self) -> None:
        while not self._writer.outcomes.empty():
            outcome = self._writer.outcomes.get()
            ticket = self._tickets.pop(outcome.name, None)
            reason = self._reasons.pop(outcome.name, "")
            if isinstance(outcome, Written):
                self._folder.prune(self._settings.keep, self._settings.keep_mb << 20)
                self._reports.append(wire.Saved(outcome.name, reason, outcome.size))
                if outcome.lost:
                    message = f"the disk was too slow: {outcome.lost} pieces of {outcome.name} are missing"
                    self._reports.append(wire.Trouble("MC583", message))
                if ticket is not None:
                    self._reports.append(wire.Answer(ticket, name=outcome.name))
            else:
                self._on_failure(outcome, ticket)

    def _on_failure(self, outcome: NotWritten, ticket: int | None) -> None:
        kept = "; what was written before is kept" if outcome.kept else ""
        message = f"the recording {outcome.name} could not be written: {outcome.message}{kept}"
        self._reports.append(wire.Trouble("MC582", message))
        if ticket is not None:
            hint = f"make room in {self._folder.path}, or let the server write there"
            self._reports.append(wire.Answer(ticket, code="MC582", message=message, hint=hint))

    def _free_name(self, name: str) -> str:
        found, number = name, 1
        while self._folder.taken(found) or found in self._reasons:
            number += 1
            found = f"{name}-{number}"
        return found

    def _status(self) -> wire.RecorderStatus:
        return wire.RecorderStatus(self._box.span_s, self._box.size, self._missed, list(self._recordings))


def _word(reason: str) -> str:
    """Return a reason as a part of a file's name."""
    return "".join(each if each.isascii() and each.isalnum() else "-" for each in reason)[:40] or "asked"


def metadata_of(machine: Machine, start: wire.RecorderStart, reason: str) -> dict[str, dict[str, str]]:
    """Return the metadata of a file: text for people, and the whole machine for programs (MessagePack,
    base64).
    """
    return {
        "mcserver": {
            "machine": machine.name,
            "instance": start.instance,
            "epoch": repr(start.epoch),
            "cycle_s": repr(machine.cycle_s),
            "reason": reason,
            "axes": ",".join(str(axis.index) for axis in machine.axes),
            "units": ",".join(axis.type.unit for axis in machine.axes),
            "model": base64.b64encode(msgspec.msgpack.encode(machine)).decode(),
        }
    }
