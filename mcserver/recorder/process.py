"""The recorder's process: ``python -m mcserver.recorder.process``, with its machine on standard input.

It reads the executor's feedback by a mapping that it cannot write, and nobody waits for it. When it is late
it has missed cycles, which it counts; when it is killed, what it held is gone and its files still open.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import select
import signal
import socket
import sys
import time
from pathlib import Path

import msgspec

from mcserver.executor.shm.shared_memory import map_feedback
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.planning.message_pipe import MessagePipe
from mcserver.processes import log_to_stderr
from mcserver.recorder.channels import channels
from mcserver.recorder.folder import RecordingFolder
from mcserver.recorder.mcap_file import McapFile
from mcserver.recorder.messages import Command, Quit, RecorderStart, Report, Trouble
from mcserver.recorder.recorder import Recorder
from mcserver.recorder.repair import repair_unfinished
from mcserver.recorder.sink import FileWriter
from mcserver.simulation.tool_poses import ToolPoses

log = logging.getLogger(__name__)

# Time between two looks at the ring, which holds 2 s at 1 kHz.
TURN_MS = 100
# Below everybody: motion and service come first.
NICENESS = 10
# Where memory runs out it is the first to go.
KILLED_FIRST = b"500"
# For the last files, when the server ends [s].
CLOSE_LIMIT_S = 20.0
# For the server's own end, after SIGTERM [s].
TERMINATE_LIMIT_S = 15.0
# For the seconds behind a lost server's last cycle [s].
LOST_LIMIT_S = 20.0


def main() -> int:
    """Run until the server ends; returns the exit code."""
    start = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=RecorderStart)
    log_to_stderr(logging.WARNING)
    # a keyboard's interrupt goes to the server too, which ends this process in order
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    terminated: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _frame: terminated.append(number))
    _step_back()
    ring = map_feedback(start.memory, start.machine)
    os.close(start.memory)
    folder = RecordingFolder(Path(start.folder))
    schemas, topics = channels(start.machine)
    settings = start.machine.recorder
    writer = FileWriter(
        folder,
        lambda stream, metadata: McapFile(stream, schemas, topics, metadata),
        # a whole box, and recordings beside it
        max_waiting=2 * settings.max_mb << 20,
        min_free=settings.min_free_mb << 20,
    )
    poses = ToolPoses(start.machine, build_kinematics(start.machine))
    recorder = Recorder(start.machine, ring, start, poses, folder, writer, time.time)
    link = Link(start.pipe)
    for problem in repair_unfinished(folder):
        link.send([Trouble("MC582", problem)])
    quitting = False
    # asked to end together with the server, it ends when that does
    deadline = math.inf
    while not (quitting or link.lost or time.monotonic() > deadline):
        quitting = link.serve(recorder, TURN_MS)
        link.send(recorder.turn())
        if terminated:
            deadline = min(deadline, time.monotonic() + TERMINATE_LIMIT_S)
    if link.lost:
        recorder.server_lost()
        deadline = time.monotonic() + LOST_LIMIT_S
        while recorder.waiting and time.monotonic() < deadline:
            time.sleep(TURN_MS / 1000.0)
            recorder.turn()
    recorder.finish()
    writer.close(CLOSE_LIMIT_S)
    link.send(recorder.turn())
    return 0


class Link:
    """The pipe to the server.

    Attributes:
        lost: the server has closed it, or is gone.
    """

    def __init__(self, descriptor: int) -> None:
        self._pipe = MessagePipe(socket.socket(fileno=descriptor))
        self._poller = select.poll()
        self._poller.register(self._pipe, select.POLLIN)
        self._encode = msgspec.msgpack.Encoder().encode
        self._decode = msgspec.msgpack.Decoder(Command).decode
        self.lost = False

    def serve(self, recorder: Recorder, timeout_ms: int) -> bool:
        """Wait for commands so long, and carry out what has come; True: it is to end."""
        self._poller.poll(timeout_ms)
        try:
            received = self._pipe.receive()
        except EOFError:
            self.lost = True
            return False
        for payload in received:
            try:
                command = self._decode(payload)
            except msgspec.MsgspecError as error:
                log.warning("a command was not understood: %s", error)
                continue
            if isinstance(command, Quit):
                return True
            recorder.handle(command)
        return False

    def send(self, reports: list[Report]) -> None:
        """Report to the server; where it is gone they go nowhere."""
        with contextlib.suppress(OSError):
            for report in reports:
                self._pipe.send(self._encode(report))
            self._pipe.flush()


def _step_back() -> None:
    with contextlib.suppress(OSError):
        os.nice(NICENESS)
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_bytes(KILLED_FIRST)


if __name__ == "__main__":
    sys.exit(main())
