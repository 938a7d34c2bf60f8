"""The server's client of the executor, which runs in a process of its own."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from collections.abc import Mapping

from mcserver.drives.registry import create_buses
from mcserver.errors import RuntimeFault
from mcserver.executor.faces import ExecutorFaces
from mcserver.executor.process_start import ExitCode, Start, StoredReference
from mcserver.executor.shm.shared_memory import SharedParts, create_block, map_block
from mcserver.machine.machine_file import Machine
from mcserver.processes import start_child

# Longest start: the first one after an installation compiles the executor's kernels, beside the planner's
# [s].
START_TIMEOUT_S = 300.0
STOP_TIMEOUT_S = 12.0
# An executor without a beat for this time does not run [s].
BEAT_TIMEOUT_S = 2.0
_POLL_S = 0.002


class ExecutorProcess(ExecutorFaces):
    """Starts, watches and ends the executor's process.

    It gets a fresh interpreter, without the server's state. The shared memory has no name; it is freed with
    the last of the two processes, however they end.

    Args:
        references: of axes, from an earlier start, by axis number. tool: in the spindle since then, 0: none.

    Attributes:
        mailboxes: client for objects of drives on EtherCAT, once launched; None: the machine has no such bus.
    """

    def __init__(
        self,
        machine: Machine,
        *,
        references: Mapping[int, StoredReference] | None = None,
        tool: int = 0,
    ) -> None:
        # finds the same configuration errors as the process would, but here they can be reported
        create_buses(machine)
        self.machine = machine
        self._references = dict(references or {})
        self._tool = tool
        self._process: subprocess.Popen[bytes] | None = None
        self._parts: SharedParts | None = None
        self._memory = -1
        self.mailboxes: socket.socket | None = None
        self._beat_seen = (-1, 0.0)

    # ------------------------------------------------------------------ life

    def start(self, timeout_s: float = START_TIMEOUT_S) -> None:
        """Launch the process and wait for it; raises as `wait`."""
        self.launch()
        self.wait(timeout_s)

    def launch(self) -> None:
        """Make the memory and start the process, without waiting for it."""
        if self._process is not None:
            raise RuntimeError("the executor has been started already")
        self._memory = create_block(self.machine)
        self._parts = map_block(self._memory, self.machine)
        self._parts.mailbox.initialise()
        descriptors = [self._memory]
        theirs: socket.socket | None = None
        if any(bus.kind == "ethercat" for bus in self.machine.buses):
            from mcserver.ethercat.mailbox_relay import socket_pair

            self.mailboxes, theirs = socket_pair()
            descriptors.append(theirs.fileno())
        start = Start(
            self.machine,
            self._memory,
            os.getpid(),
            self._references,
            -1 if theirs is None else theirs.fileno(),
            self._tool,
        )
        self._process = start_child("mcserver.executor.process", start, descriptors)
        if theirs is not None:
            theirs.close()

    def wait(self, timeout_s: float = START_TIMEOUT_S) -> None:
        """Wait until cycles run.

        Raises:
            RuntimeFault: MC422 it ended, or did not come up in time.
        """
        process = self._process
        if process is None:
            raise RuntimeError("the executor has not been started")
        deadline = time.monotonic() + timeout_s
        while self.mailbox.executor_beat == 0:
            code = process.poll()
            if code is not None or time.monotonic() > deadline:
                self.kill()
                what, why = f"ended with code {code}", "see what it wrote to standard error"
                if code is None:
                    what = f"did not come up in {timeout_s:g} s"
                    why = (
                        "the computer is busy, or still compiles for its first start: start the server "
                        "again, what has been compiled is kept"
                    )
                elif code == ExitCode.DRIVES:
                    why = "the line above says which drive, and why"
                raise RuntimeFault("MC422", f"the executor's process {what}", why)
            time.sleep(_POLL_S)

    def stop(self, timeout_s: float = STOP_TIMEOUT_S) -> int | None:
        """Bring motion to rest, de-energize the axes and end the process.

        Returns:
            Its exit code; None if it was never started.
        """
        if self._process is None:
            return None
        self.mailbox.quit()
        try:
            return self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return self.kill()
        finally:
            self._forget_memory()

    def kill(self) -> int | None:
        """End the process at once; its drives time out by themselves."""
        if self._process is None:
            return None
        if self._process.poll() is None:
            self._process.kill()
        self._forget_memory()
        return self._process.wait()

    def _forget_memory(self) -> None:
        """Close the descriptor: the memory stays mapped here, but no further process can map it."""
        if self.mailboxes is not None:
            self.mailboxes.close()
        memory, self._memory = self._memory, -1
        if memory >= 0:
            os.close(memory)

    @property
    def alive(self) -> bool:
        """Whether the process exists and its cycles go on; to be read regularly, to notice a missing beat."""
        process = self._process
        if process is None or process.poll() is not None:
            return False
        beat, now = self.mailbox.executor_beat, time.monotonic()
        if beat != self._beat_seen[0]:
            self._beat_seen = (beat, now)
            return True
        return now - self._beat_seen[1] <= BEAT_TIMEOUT_S

    @property
    def ending(self) -> str:
        """Return in words how the process ended; empty while it runs."""
        code = self.exit_code
        if code is None:
            return "" if self.alive else f"it has run no cycle for {BEAT_TIMEOUT_S:g} s"
        if code < 0:
            return f"it was ended by signal {-code}"
        if code == ExitCode.SERVER_LOST:
            return "it stopped all axes because the server did not beat"
        return f"it ended with code {code}"

    @property
    def exit_code(self) -> int | None:
        """Exit code of the process (negative: a signal), None while it runs."""
        return None if self._process is None else self._process.poll()

    @property
    def memory(self) -> int:
        """Descriptor of the shared memory, for another process to map.

        Raises:
            RuntimeError: the executor does not run.
        """
        if self._memory < 0:
            raise RuntimeError("the executor does not run")
        return self._memory

    @property
    def pid(self) -> int | None:
        """Id of the process."""
        return None if self._process is None else self._process.pid

    # ------------------------------------------------------------------ its faces

    @property
    def parts(self) -> SharedParts:
        if self._parts is None:
            raise RuntimeError("the executor has not been started")
        return self._parts

    def beat(self) -> None:
        """Signal that the server lives; to be called at least every 50 ms from the first call on."""
        self.mailbox.beat()

    @property
    def epoch(self) -> float:
        """Unix time of executor time 0 [s]."""
        return self.mailbox.epoch
