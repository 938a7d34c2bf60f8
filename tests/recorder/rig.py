"""A recorder on a clock of the test, fed with cycles that the test makes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from mcserver.executor.shm.feedback import (
    CYCLE,
    ESTOP,
    LINE,
    SLOT_RATE,
    TIME,
    AxisCondition,
    FeedbackRing,
    FeedbackRow,
)
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.machine.sections import RecorderSection
from mcserver.recorder.channels import channels
from mcserver.recorder.folder import RecordingFolder
from mcserver.recorder.mcap_file import McapFile
from mcserver.recorder.messages import Command, RecorderStart, Report
from mcserver.recorder.recorder import Recorder
from mcserver.recorder.sink import FileWriter
from mcserver.simulation.tool_poses import ToolPoses

EPOCH = 1_700_000_000.0
MACHINE = "cartesian"


class Rig:
    """Axis 0 moves at 10 mm/s behind its setpoint by 0.25 mm; all others stand."""

    def __init__(self, folder: Path, machine: str = MACHINE, *, min_free: int = 0, **settings: Any) -> None:
        loaded = load_machine(machine)
        self.machine: Machine = _with(loaded, RecorderSection(**settings))
        self.axes = len(self.machine.axes)
        inputs, outputs = len(self.machine.inputs), len(self.machine.outputs)
        self.ring = FeedbackRing(None, self.axes, inputs=inputs, outputs=outputs)
        self.folder = RecordingFolder(folder)
        schemas, topics = channels(self.machine)
        self.writer = FileWriter(
            self.folder,
            lambda stream, metadata: McapFile(stream, schemas, topics, metadata),
            max_waiting=1 << 30,
            min_free=min_free,
        )
        self.clock = EPOCH
        start = RecorderStart(self.machine, -1, -1, EPOCH, "inst", str(folder), str(folder / "journal.db"))
        poses = ToolPoses(self.machine, build_kinematics(self.machine))
        self.recorder = Recorder(
            self.machine, self.ring, start, poses, self.folder, self.writer, lambda: self.clock
        )
        self.row = FeedbackRow(self.axes, inputs, outputs)
        self.row.condition[:] = AxisCondition.HOLDING
        self.cycle = 0
        self.reports: list[Report] = []

    @property
    def t(self) -> float:
        """Executor time of the next cycle [s]."""
        return self.cycle * 1e-3

    def cycles(self, count: int, *, turns: bool = True) -> None:
        """Pass cycles; the recorder looks every 100 of them."""
        for _ in range(count):
            row = self.row
            row.row[TIME], row.row[CYCLE], row.row[LINE] = self.t, self.cycle, 7
            row.setpoint[0] = 0.01 * self.t
            row.actual[0] = 0.01 * self.t - 0.00025
            row.actual_velocity[0] = row.velocity[0] = 0.01
            row.torque[0] = 0.5
            row.set_slot(0, self.cycle, 1.0, 1, 3)
            self.ring.put(row.row)
            self.cycle += 1
            self.clock += 1e-3
            if turns and self.cycle % 100 == 0:
                self.turn()

    def stop(self, *, latched: bool) -> None:
        self.row.row[ESTOP] = float(latched)

    def condition(self, axis: int, value: AxisCondition) -> None:
        self.row.condition[axis] = value

    def give(self, command: Command) -> None:
        self.recorder.handle(command)
        self.turn()

    def turn(self) -> None:
        self.reports += self.recorder.turn()

    def settle(self) -> list[Report]:
        """Wait for the files, and take what was reported."""
        self.writer.close(30.0)
        self.turn()
        return self.reports


def _with(machine: Machine, recorder: RecorderSection) -> Machine:
    import msgspec

    return msgspec.structs.replace(machine, recorder=recorder)


def decoded(path: Path, topic: str | None = None) -> list[tuple[str, int, Any]]:
    """Topic, time [ns] and message of everything in a file, by the library's own reader."""
    topics = None if topic is None else [topic]
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory(), JsonFactory()])
        return [
            (channel.topic, message.log_time, value)
            for _, channel, message, value in reader.iter_decoded_messages(topics=topics)
        ]


class JsonFactory:
    """Decodes messages of encoding ``json``."""

    def decoder_for(self, message_encoding: str, _schema: Any) -> Any:
        import json

        return json.loads if message_encoding == "json" else None


def column(messages: list[tuple[str, int, Any]], name: str) -> np.ndarray[Any, Any]:
    """A field of many messages."""
    return np.array([getattr(message, name) for _, _, message in messages])


__all__ = ["EPOCH", "SLOT_RATE", "Rig", "column", "decoded"]
