"""A line of simulated drives on a veth pair in a network namespace of its own, and the cycle on it."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path

from mcserver.canopen.coe import agreed_on_ethercat
from mcserver.drive_sim.control import Control
from mcserver.drives.bus import DriveMode, DriveState, Feedback, Setpoints
from mcserver.drives.can_bus import CanBus
from mcserver.drives.registry import on_buses
from mcserver.ethercat.mailbox_relay import MailboxServer, socket_pair
from mcserver.ethercat.open import open_ethercat
from mcserver.ethercat.operator_line import OperatorLine
from mcserver.machine.machine_file import Machine, parse_machine
from tests.network_namespace import entered

LIMIT_S = 30.0
CYCLE_HZ = 100
# what runs here has no realtime priority
SILENCE_CYCLES = 10


def line_of(count: int, *, silence_cycles: int = SILENCE_CYCLES, drive: str = "", bus: str = "") -> str:
    """A machine file of so many axes on one line; ``drive``, ``bus``: more lines of each, and of it."""
    text = (
        f'[machine]\nname = "line"\ncycle_hz = {CYCLE_HZ}\n'
        f'[[bus]]\nname = "line"\nkind = "ethercat"\ninterface = "ec0"\nsilence_cycles = {silence_cycles}\n'
        f"appear_timeout_s = 1.0\n{bus}\n"
    )
    for index in range(count):
        text += (
            f'[[axis]]\nindex = {index}\ntype = "linear"\nmax_velocity = 200.0\nmax_acceleration = 2000.0\n'
            f"units_per_motor_rev = 10.0\nmax_following_error = 5.0\n"
            f'[axis.drive]\nkind = "cia402"\nbus = "line"\nposition = {index}\ncounts_per_motor_rev = 65536\n'
            f"initial_position = {10.0 * index}\ncommand_timeout_ms = 2000\n{drive}\n"
        )
    return text


class Namespace:
    """A network namespace with the two ends of a cable, ec0 and ec1, and those of another, ec2 and ec3."""

    def __init__(self, name: str) -> None:
        self.name = name
        _ip("netns", "add", name)
        _ip("-n", name, "link", "set", "lo", "up")
        for one, other in (("ec0", "ec1"), ("ec2", "ec3")):
            _ip("-n", name, "link", "add", one, "type", "veth", "peer", "name", other)
            for end in (one, other):
                _ip("-n", name, "link", "set", end, "up")

    def close(self) -> None:
        _ip("netns", "delete", self.name)

    def entered(self) -> AbstractContextManager[None]:
        """What this thread opens inside belongs to the namespace, and stays in it."""
        return entered(self.name)


class SimulatedLine:
    """`mcserver drive-sim` at the end ec1; of a ring at ec3, too."""

    def __init__(self, namespace: Namespace, file: Path) -> None:
        self.namespace = namespace
        command = [sys.executable, "-m", "mcserver", "drive-sim", "--machine", str(file)]
        command += ["--interface", "ec1"]
        command += ["--interface", "ec3"] if "redundant_interface" in file.read_text() else []
        self._process = subprocess.Popen(
            [
                "ip",
                "netns",
                "exec",
                namespace.name,
                *command,
                "--realtime",
                "40",
                "--control",
                "127.0.0.1:0",
            ],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], LIMIT_S)
        words = self._process.stdout.readline().split() if ready else []
        assert words[:1] == ["READY"], words
        with namespace.entered():
            self.control = Control("127.0.0.1", int(words[-1].rpartition(":")[2]))

    def kill(self) -> None:
        self._process.kill()

    def close(self) -> None:
        self.control.close()
        self._process.terminate()
        self._process.wait(10.0)
        assert self._process.stdout is not None
        self._process.stdout.close()


class Cycle:
    """The executor's end: exchanges at the cycle's rate."""

    def __init__(self, namespace: Namespace, text: str) -> None:
        self.machine: Machine = agreed_on_ethercat(parse_machine(text))
        columns = list(range(len(self.machine.axes)))
        self._socket, theirs = socket_pair()
        self._mailboxes = MailboxServer(theirs.detach())
        opener = partial(open_ethercat, mailboxes=self._mailboxes)
        (bus,) = on_buses({"ethercat": opener})(self.machine, self.machine.axes, columns)
        assert isinstance(bus, CanBus)
        self.bus = bus
        try:
            with namespace.entered():
                self.feedback: Feedback = bus.boot()
        except BaseException:
            self._close_sockets()
            raise
        self.line = OperatorLine(self.machine, self._socket)
        self._mailboxes.start()
        self.setpoints = Setpoints.of(len(columns))
        self.setpoints.position[:] = self.feedback.position

    def run(self, cycles: int) -> None:
        for _ in range(cycles):
            self._exchange()

    def until(self, reached: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + LIMIT_S
        while not reached():
            if time.monotonic() > deadline:
                raise AssertionError(f"not {what}: {self.feedback.state} {self.feedback.fault}")
            self._exchange()

    def run_beside(self, work: Callable[[], int], wanted: int) -> None:
        """Exchange until some work in another thread has ended with a code."""
        codes: list[int] = []
        thread = threading.Thread(target=lambda: codes.append(work()))
        thread.start()
        self.until(lambda: not thread.is_alive(), "the end of the work beside")
        thread.join()
        assert codes == [wanted]

    def command(self, mode: DriveMode, state: DriveState, *columns: int) -> None:
        """Command axes (none named: all) and wait for their state."""
        chosen = list(columns) or list(range(len(self.machine.axes)))
        self.setpoints.mode[chosen] = mode
        self.until(lambda: bool((self.feedback.state[chosen] == state).all()), state.name)

    def energize(self) -> None:
        """G1000 and G1010 on all axes."""
        self.command(DriveMode.RESET, DriveState.OFF)
        self.command(DriveMode.POSITION, DriveState.ENERGIZED)

    def close(self) -> None:
        self._close_sockets()
        self.bus.close()

    def _close_sockets(self) -> None:
        self._mailboxes.close()
        self._socket.close()

    def _exchange(self) -> None:
        time.sleep(self.machine.cycle_s)
        free = self.feedback.state != DriveState.ENERGIZED
        self.setpoints.position[free] = self.feedback.position[free]
        self.bus.exchange(self.setpoints)


def missing_means() -> str:
    """What this computer lacks for such a line; empty: nothing."""
    if os.geteuid() != 0:
        return "a network namespace needs root"
    try:
        import pysoem
    except ModuleNotFoundError:
        return "pysoem is not installed"
    del pysoem
    try:
        _ip("netns", "list")
    except (OSError, subprocess.CalledProcessError) as error:
        return f"no network namespaces: {error}"
    return ""


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)
