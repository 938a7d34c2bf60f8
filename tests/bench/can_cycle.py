"""One exchange with CiA 402 drives over a datagram socket, beside packing and sending as many frames."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType

from mcserver.can.cob import SYNC, Function
from mcserver.can.frame import FRAME_SIZE, HEADER, PAYLOAD_OFFSET, filled_frame, prepare_frame
from mcserver.can.pdo_layout import RPDO1, TPDO1, TPDO2
from mcserver.can.port import MAX_DRAINED, Frame, PortCounters
from mcserver.drives.bus import DriveMode, DriveState, Setpoints
from mcserver.drives.can_bus import CanBus
from mcserver.executor.entries import Control, ControlKind
from mcserver.executor.shm.feedback import AxisCondition
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.motion.canonical import AxisOperation
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.bench.figures import Figure, percentiles
from tests.machine_text import axes_text

CYCLES = 2000
WARM_UP = 200
COUNTS_PER_M = 1e6
CAPTURE = list(AxisOperation).index(AxisOperation.CAPTURE)
GOALS = {8: "≤ 100 µs", 32: "≤ 350 µs"}
ENABLED = 0x0227


def measure() -> list[Figure]:
    """8 and 32 axes in position mode and moving, each on one bus; 8 whose loops are closed here (cst)."""
    against = "packing and sending as many frames, receiving as many"
    figures = []
    for axes, goal in GOALS.items():
        floor = frames(axes)
        figures += percentiles(f"{axes} axes, exchange", exchanges(axes), floor, against, {0.5: goal})
        figures += percentiles(
            f"{axes} axes, whole cycle of the executor", cycles(axes), floor, against, shares=[0.5]
        )
        if axes == min(GOALS):
            taken = exchanges(axes, "cst")
            figures += percentiles(f"{axes} axes, exchange, cst", taken, floor, against, shares=[0.5])
    return figures


class DatagramPort:
    """Frames as ``struct can_frame`` over a pair of datagram sockets: the system calls of SocketCAN."""

    payload_offset = PAYLOAD_OFFSET

    def __init__(self) -> None:
        self.counters = PortCounters()
        self._own, self.other = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        for end in (self._own, self.other):
            end.setblocking(False)
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)

    def __enter__(self) -> DatagramPort:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._own.close()
        self.other.close()

    def fileno(self) -> int:
        return self._own.fileno()

    def prepare(self, identifier: int, length: int) -> bytearray:
        return prepare_frame(identifier, length)

    def send(self, identifier: int, payload: bytes) -> bool:
        return self.send_prepared(filled_frame(identifier, payload))

    def send_prepared(self, buffer: bytearray) -> bool:
        try:
            self._own.send(buffer)
        except BlockingIOError:
            return False
        return True

    def drain(self) -> list[Frame]:
        frames: list[Frame] = []
        receive = self._own.recv
        for _ in range(MAX_DRAINED):
            try:
                frame = receive(FRAME_SIZE)
            except BlockingIOError:
                break
            identifier, length = HEADER.unpack_from(frame)
            frames.append((identifier, frame[8 : 8 + length]))
        return frames

    def close(self) -> None:
        """The bench closes both ends."""


class Answers:
    """Drives that are where they were commanded to be: their TPDOs, prepared before the clock runs."""

    def __init__(self, axes: int, other: socket.socket) -> None:
        self._other = other
        self._nodes = range(1, axes + 1)
        self._last = {node: RPDO1.packing.pack(0, 0, 0) for node in self._nodes}
        self._syncs = 0

    def answer(self) -> None:
        """Takes what the master has sent, and answers every SYNC."""
        while True:
            try:
                frame = self._other.recv(FRAME_SIZE)
            except BlockingIOError:
                return
            identifier, length = HEADER.unpack_from(frame)
            if identifier == SYNC:
                self._sync()
            elif identifier & 0x780 == Function.RPDO1:
                self._last[identifier & 0x7F] = frame[8 : 8 + length]
            elif identifier & 0x780 == Function.RPDO2:
                # a controlword, and a speed and a torque that they are not interested in
                node = identifier & 0x7F
                self._last[node] = frame[8:10] + self._last[node][2:]

    def _sync(self) -> None:
        self._syncs += 1
        for node in self._nodes:
            controlword, mode, target = RPDO1.packing.unpack(self._last[node])
            low = controlword & 0x0F
            state = {0x06: 0x0221, 0x07: 0x0223, 0x0F: ENABLED}.get(low, 0x0240)
            self._send(Function.TPDO1 + node, TPDO1.packing.pack(state, mode, target))
            if self._syncs % 10 == 0:
                self._send(Function.TPDO2 + node, TPDO2.packing.pack(0, 0))

    def _send(self, identifier: int, payload: bytes) -> None:
        frame = filled_frame(identifier, payload)
        self._other.send(frame)


def machine_text(axes: int, mode: str = "csp") -> str:
    """Axes on one bus, at a rate at which they fit."""
    keys = "units_per_motor_rev = 10.0\nmax_following_error = 1000.0"
    drive = f'bus = "can0"\ncounts_per_motor_rev = 10000\nmode = "{mode}"\n'
    drive += "rated_torque = 1.0\ninertia = 1e-4\n" if mode == "cst" else ""
    limits = {"velocity": 1000.0, "acceleration": 1000.0, "keys": keys, "drive": "cia402"}
    nodes = (f"{drive}node = {index + 1}" for index in range(axes))
    text = "".join(axes_text([index], **limits, drive_keys=node) for index, node in enumerate(nodes))
    return f'[machine]\nname = "bench"\ncycle_hz = 50\n{text}'


@contextmanager
def answered_bus(machine: Machine) -> Iterator[tuple[CanBus, Answers]]:
    """A bus of all axes, and the drives that answer on it."""
    axes = len(machine.axes)
    with DatagramPort() as port:
        answers = Answers(axes, port.other)
        yield (
            CanBus(
                machine,
                machine.buses[0],
                list(range(axes)),
                opener=lambda _address: port,
                wait=lambda _seconds: answers.answer(),
            ),
            answers,
        )


def exchanges(axes: int, mode: str = "csp") -> list[float]:
    """Time of each exchange [µs]: drain, states, scaling, RPDOs, SYNC."""
    machine = parse_machine(machine_text(axes, mode))
    taken = []
    with answered_bus(machine) as (bus, answers):
        feedback = bus.boot()
        setpoints = Setpoints.of(axes)
        setpoints.mode[:] = DriveMode.POSITION
        for number in range(CYCLES + WARM_UP):
            if (feedback.state == DriveState.ENERGIZED).all():
                setpoints.position[:] += 1e-5
                setpoints.velocity[:] = 1e-5 / machine.cycle_s
            else:
                setpoints.position[:] = feedback.position
            start = time.perf_counter_ns()
            bus.exchange(setpoints)
            bus.events()
            taken.append((time.perf_counter_ns() - start) / 1000.0)
            answers.answer()
            if number == WARM_UP and not (feedback.state == DriveState.ENERGIZED).all():
                raise RuntimeError("the drives are not energized")
    return taken[WARM_UP:]


def cycles(axes: int) -> list[float]:
    """Time of each cycle of an executor that holds all axes [µs]."""
    machine = parse_machine(machine_text(axes))
    mask = (1 << axes) - 1
    taken = []
    with answered_bus(machine) as (bus, answers):
        virtual = VirtualExecutor(machine, buses=[bus])
        ring = virtual.open_slot(0, mask)
        ring.put_control(Control(ControlKind.AXIS, 0.0, 1, axes=mask, operation=CAPTURE))
        for number in range(CYCLES + WARM_UP):
            start = time.perf_counter_ns()
            virtual.executor.cycle(number * machine.cycle_s)
            taken.append((time.perf_counter_ns() - start) / 1000.0)
            answers.answer()
        if (virtual.feedback.condition != AxisCondition.HOLDING).any():
            raise RuntimeError("the drives are not energized")
    return taken[WARM_UP:]


def frames(axes: int) -> list[float]:
    """The floor [µs]: an RPDO packed and sent for each axis, a SYNC, and a TPDO1 received from each."""
    taken = []
    with DatagramPort() as port:
        buffers = [port.prepare(Function.RPDO1 + node, 7) for node in range(1, axes + 1)]
        sync = port.prepare(SYNC, 0)
        answer = prepare_frame(Function.TPDO1 + 1, 7)
        own, other = port._own, port.other
        for number in range(CYCLES):
            for _ in buffers:
                other.send(answer)
            start = time.perf_counter_ns()
            for _ in buffers:
                own.recv(FRAME_SIZE)
            for buffer in buffers:
                RPDO1.packing.pack_into(buffer, PAYLOAD_OFFSET, 0x0F, 8, number)
                own.send(buffer)
            own.send(sync)
            taken.append((time.perf_counter_ns() - start) / 1000.0)
            for _ in range(axes + 1):
                other.recv(FRAME_SIZE)
    return taken
