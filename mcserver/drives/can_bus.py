"""One bus of drives: CiA 402 axes in step with SYNC, and axes that stream telemetry beside them.

On EtherCAT the port has a process image in the place of frames, and SYNC is what sends it.

An exchange drains what has come (the latest value wins), looks at its age, steps the states, and sends:
RPDOs, then SYNC last, which lets every drive act on its RPDO and sample its TPDO at one moment. Nothing is
kept for later: a frame that finds no room is gone, and the next cycle has a newer one.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mcserver.can.cob import SYNC
from mcserver.can.open import open_port
from mcserver.can.port import CanPort, ClockedPort
from mcserver.drives.bus import BusEvent, DriveFault, DriveMode, Feedback, Setpoints
from mcserver.drives.cia402.axes import Cia402Axes
from mcserver.drives.cia402.drive import Cia402Drive
from mcserver.drives.cia402.loop_gains import DELAY_CYCLES
from mcserver.drives.drive_io import DriveIo
from mcserver.drives.io_bus import IoBus
from mcserver.drives.io_nodes import Array, IoNodes
from mcserver.drives.node_watch import NodeWatch, bus_back
from mcserver.drives.streamed import StreamedAxis, StreamedDrive
from mcserver.errors import RuntimeFault
from mcserver.machine.bus_section import BusConfig
from mcserver.machine.drive import CanDrive
from mcserver.machine.machine_file import Machine

# Within this time every drive has to have answered once [s].
BOOT_TIMEOUT_S = 5.0
# Cycles in a row in which no frame could be sent: the bus is down.
UNSENT_CYCLES = 2
# Cycles in which drives are commanded off before the bus is given back.
CLOSING_CYCLES = 5

Opener = Callable[[str], CanPort]


class CanBus:
    """The drives of one bus.

    Args:
        bus: of the machine. columns: of the machine, ascending; all with drives on this bus.
        opener: from an address to a port; called by `boot`.
        wait: lets a time pass [s], while the bus is booted and closed.
        delay_cycles: of a reading behind its setpoint, of a drive that follows without error.

    Attributes:
        port: None before `boot`.
    """

    follows_exactly = False

    def __init__(
        self,
        machine: Machine,
        bus: BusConfig,
        columns: Sequence[int],
        *,
        opener: Opener = open_port,
        wait: Callable[[float], None] = time.sleep,
        delay_cycles: int = DELAY_CYCLES,
    ) -> None:
        self.config = bus
        self.delay_cycles = delay_cycles
        self.port: CanPort | None = None
        # of the port, asked once: a look at what a protocol asks for takes as long as a drive
        self._clocked: ClockedPort | None = None
        self._opener = opener
        self._wait = wait
        self.columns = tuple(columns)
        self._cycle = machine.cycle_s
        axes = [machine.axes[column] for column in columns]
        self._axes = axes
        self._feedback = Feedback.of(len(axes))
        self._feedback.fresh[:] = False
        servo = [index for index, axis in enumerate(axes) if isinstance(axis.drive, Cia402Drive)]
        self._limit = bus.silence_cycles
        own_axes = [axes[index] for index in servo]
        self._servo = Cia402Axes(own_axes, servo, self._cycle, delay_cycles) if servo else None
        # on a bus with another producer of SYNC the drives act at its SYNC
        self._sends_sync = self._servo is not None and bus.sync == "own"
        self._watch: NodeWatch | None = None
        if self._servo is not None:
            own = [columns[index] for index in servo]
            self._watch = NodeWatch(own_axes, own, self._servo, self._cycle)
        self._streamed = [
            (index, axis.drive.axis(axis, self._cycle, bus.silence_cycles))
            for index, axis in enumerate(axes)
            if isinstance(axis.drive, StreamedDrive)
        ]
        io = IoNodes(machine, bus.name, self._cycle, bus.silence_cycles)
        self._io = io if io.numbers else None
        self._drive_io: DriveIo | None = None
        if self._servo is not None:
            self._drive_io = DriveIo(machine, own_axes, self._servo, bus.silence_cycles, self._feedback)
        if self._io is not None and bus.sync == "own":
            self._sends_sync = True
        # inputs and outputs of nodes first, those of drives behind them
        self._io_parts: list[IoBus] = [each for each in (self._io, self._drive_io) if each is not None]
        self._handlers: dict[int, Callable[[bytes], None]] = {}
        self._sync = bytearray()
        self._down = False
        self._unsent = 0
        self._events: list[BusEvent] = []

    # ------------------------------------------------------------------ the bus

    @property
    def inputs(self) -> tuple[int, ...]:
        """Columns of the machine's inputs on this bus."""
        return tuple(column for part in self._io_parts for column in part.inputs)

    @property
    def outputs(self) -> tuple[int, ...]:
        """Columns of the machine's outputs on this bus."""
        return tuple(column for part in self._io_parts for column in part.outputs)

    def write_outputs(self, raw: Array) -> None:
        for part in self._io_parts:
            part.write_outputs(raw[: len(part.outputs)])
            raw = raw[len(part.outputs) :]

    def read_inputs(self, raw: Array, fresh: NDArray[np.bool_]) -> None:
        for part in self._io_parts:
            count = len(part.inputs)
            part.read_inputs(raw[:count], fresh[:count])
            raw, fresh = raw[count:], fresh[count:]

    def read_outputs(self, fresh: NDArray[np.bool_]) -> None:
        for part in self._io_parts:
            part.read_outputs(fresh[: len(part.outputs)])
            fresh = fresh[len(part.outputs) :]

    @property
    def clock_error_ns(self) -> int | None:
        return None if self._clocked is None else self._clocked.clock_error_ns

    @property
    def short(self) -> int:
        """PDOs that came with a wrong length; they count as not come."""
        total = sum(axis.short for _, axis in self._streamed)
        return total + (self._servo.readings.short if self._servo else 0)

    def boot(self) -> Feedback:
        """Open the port and let cycles pass until every drive has answered, all commanded off.

        Raises:
            RuntimeFault: MC424 the bus cannot be opened; MC411 a drive does not answer.
        """
        self.port = port = self._opener(self.config.address)
        self._clocked = port if isinstance(port, ClockedPort) else None
        try:
            self._prepare(port)
            missing = set(range(len(self._axes)))
            for _ in range(max(20, round(BOOT_TIMEOUT_S / self._cycle))):
                self._take(port)
                missing -= self._answered()
                if not missing and not self._io_missing():
                    break
                self._send_off(port)
                self._wait(self._cycle)
            else:
                raise self._no_answer(missing)
            if self._servo is not None:
                self._servo.readings.begin_here()
                self._servo.readings.read(self._feedback)
            if self._watch is not None:
                self._watch.forget()
                self._watch.events.clear()
            for index, axis in self._streamed:
                self._feedback.position[index] = axis.position
        except BaseException:
            port.close()
            raise
        return self._feedback

    def exchange(self, setpoints: Setpoints) -> Feedback:
        port, feedback = self.port, self._feedback
        assert port is not None
        self._take(port)
        servo, watch = self._servo, self._watch
        down = port.counters.down or self._unsent >= UNSENT_CYCLES
        if down or self._down:
            self._note_down(down)
        lost = 0
        if servo is not None and watch is not None:
            servo.readings.read(feedback)
            watch.look()
            if servo.readings.silent_for >= self._limit:
                self._fail_silent(servo)
            servo.step(setpoints, feedback)
            lost += servo.rpdos.send()
        for index, axis in self._streamed:
            lost += not self._exchange_streamed(index, axis, setpoints)
        if self._io is not None:
            lost += self._io.send()
        if self._sends_sync and not port.send_prepared(self._sync):
            lost += 1
        self._unsent = self._unsent + 1 if lost else 0
        return feedback

    def events(self) -> list[BusEvent]:
        watch = self._watch
        if not self._events and (watch is None or not watch.events):
            return []
        events, self._events = self._events, []
        if watch is not None:
            events += watch.events
            watch.events.clear()
        return events

    def close(self) -> None:
        """Tell the drives to be off for some cycles, and close the port."""
        port, self.port, self._clocked = self.port, None, None
        if port is None:
            return
        if self._servo is not None:
            self._servo.silence()
        for _ in range(CLOSING_CYCLES):
            self._send_off(port)
            self._wait(self._cycle)
        port.close()

    # ------------------------------------------------------------------ frames

    def _prepare(self, port: CanPort) -> None:
        self._sync = port.prepare(SYNC, 0)
        for _, axis in self._streamed:
            self._handlers.update(axis.open(port))
        if self._io is not None:
            self._handlers.update(self._io.open(port))
        servo, watch = self._servo, self._watch
        if servo is None or watch is None:
            return
        servo.rpdos.open(port)
        self._handlers.update(watch.handlers())
        self._handlers.update(servo.readings.handlers(self._feedback))

    def _take(self, port: CanPort) -> None:
        """Everything that has come; of each kind the latest value stays."""
        frames = port.drain()
        if self._io is not None:
            self._io.tick()
        if self._servo is not None:
            self._servo.readings.begin()
        for identifier, payload in frames:
            handler = self._handlers.get(identifier)
            if handler is not None:
                handler(payload)
        for _, axis in self._streamed:
            axis.read()

    def _send_off(self, port: CanPort) -> None:
        """A cycle in which nothing is energized; before the first exchange CiA 402 drives get SYNC alone."""
        if self._servo is not None:
            self._servo.rpdos.send()
        if self._io is not None:
            self._io.send()
        for _, axis in self._streamed:
            axis.step(DriveMode.OFF, 0.0, 0.0, 0.0)
        if self._sends_sync:
            port.send_prepared(self._sync)

    def _exchange_streamed(self, index: int, axis: StreamedAxis, setpoints: Setpoints) -> bool:
        if axis.age >= axis.limit:
            axis.fail(DriveFault.COMMUNICATION, axis.age)
        sent = axis.step(
            _MODES[setpoints.mode[index]],
            float(setpoints.position[index]),
            float(setpoints.velocity[index]),
            float(setpoints.torque[index]),
        )
        feedback = self._feedback
        feedback.position[index] = axis.position
        feedback.velocity[index] = axis.velocity
        feedback.state[index] = axis.state
        feedback.fault[index] = axis.fault
        feedback.detail[index] = axis.detail
        feedback.fresh[index] = axis.fresh
        return sent

    # ------------------------------------------------------------------ what goes wrong

    def _answered(self) -> set[int]:
        """Axes that have answered now, as indices of this bus."""
        answered = {index for index, axis in self._streamed if axis.booted}
        if self._servo is not None:
            answered.update(self._servo.readings.answered())
        return answered

    def _io_missing(self) -> bool:
        nodes = self._io is not None and self._io.missing
        return bool(nodes or (self._drive_io is not None and self._drive_io.missing))

    def _no_answer(self, missing: set[int]) -> RuntimeFault:
        if not missing and self._drive_io is not None and self._drive_io.missing:
            assert self._servo is not None
            axis = self._axes[self._servo.local[self._drive_io.missing[0]]]
            return RuntimeFault(
                "MC444",
                f"the drive of axis {axis.index} sends its position, but not its digital inputs (60FDh)",
                "look at its TPDOs in its maker's tool",
                axis=axis.index,
            )
        if not missing:
            nodes = self._io.missing if self._io is not None else []
            return RuntimeFault(
                "MC444",
                f"the I/O node {nodes[0]} on {self.config.name} does not answer SYNC",
                "check its supply, cable, node number and bit rate, and that it has TPDOs for its inputs",
            )
        axis = self._axes[min(missing)]
        assert isinstance(axis.drive, CanDrive)
        complaint = next((each.complaint for index, each in self._streamed if index == min(missing)), None)
        if complaint is not None:
            what, hint = complaint
            return RuntimeFault(
                "MC470",
                f"the drive of axis {axis.index} (node {axis.drive.node} on {self.config.name}) is not set "
                f"up as the machine file says: {what}",
                hint,
                axis=axis.index,
            )
        return RuntimeFault(
            "MC411",
            f"the drive of axis {axis.index} (node {axis.drive.node} on {self.config.name}) does not answer: "
            f"it sent nothing in {BOOT_TIMEOUT_S:g} s",
            "check its supply, cable, node number and bit rate, and that it was booted to operational",
            axis=axis.index,
        )

    def _note_down(self, down: bool) -> None:
        """A bus that is away is a fault of all its axes; that it is back is reported once."""
        if down:
            self._down = True
            if self._servo is not None:
                for number in range(len(self._servo.local)):
                    self._servo.fail(number, DriveFault.BUS_DOWN)
            for _, axis in self._streamed:
                axis.fail(DriveFault.BUS_DOWN)
            return
        self._down = False
        if self._watch is not None:
            self._watch.forget()
        if self.columns:
            self._events.append(bus_back(self.columns[0], self.config.name))

    def _fail_silent(self, servo: Cia402Axes) -> None:
        for number, age in enumerate(servo.readings.ages.tolist()):
            if age >= self._limit:
                servo.fail(number, DriveFault.COMMUNICATION, servo.readings.silence_detail(number, age))


_MODES = tuple(DriveMode)
