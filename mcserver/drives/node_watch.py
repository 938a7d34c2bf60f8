"""What the executor watches of CANopen nodes besides PDOs: boot-ups, NMT states, heartbeats, emergencies."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

from mcserver.can.cob import Function, NmtState
from mcserver.drives.bus import BusEvent, BusEventKind, DriveFault
from mcserver.drives.cia402.axes import Cia402Axes
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.drives.cia402.emergency_codes import (
    NO_ERROR,
    EmergencyRule,
    emergency_text,
    is_error,
    unpack_emergency,
)
from mcserver.machine.axis import Axis

# A heartbeat that is late by this factor has stopped (CiA 301 leaves it to the consumer).
HEARTBEAT_PATIENCE = 2.5
# Heartbeats are looked at in every so many cycles.
LOOK_CYCLES = 4
# At most so many events wait to be fetched.
EVENTS = 64


class NodeWatch:
    """The nodes of one bus.

    Args:
        axes: the machine's axes with a node each. columns: of the machine. target: latches what stops an
            axis.
    """

    def __init__(
        self, axes: Sequence[Axis], columns: Sequence[int], target: Cia402Axes, cycle_s: float
    ) -> None:
        self._columns = tuple(columns)
        drives = [cia402_drive(axis) for axis in axes]
        self._nodes = tuple(drive.node for drive in drives)
        self._target = target
        self._patience = [
            max(1, round(HEARTBEAT_PATIENCE * drive.heartbeat_ms / 1e3 / cycle_s)) for drive in drives
        ]
        self._beating = [drive.heartbeat_ms > 0 for drive in drives]
        self._rules = [EmergencyRule.of(drive.stop_on, drive.warn_on) for drive in drives]
        self._watched = [False] * len(axes)
        self._beats = [0] * len(axes)
        self._states = [int(NmtState.OPERATIONAL)] * len(axes)
        self._reported = [NO_ERROR] * len(axes)
        self._cycle = 0
        self.events: deque[BusEvent] = deque(maxlen=EVENTS)

    def handlers(self) -> dict[int, Callable[[bytes], None]]:
        """Return what to call for which COB-ID."""
        handlers: dict[int, Callable[[bytes], None]] = {}
        for node in self._nodes:
            handlers[Function.EMCY + node] = partial(self._on_emergency, node)
            handlers[Function.HEARTBEAT + node] = partial(self._on_heartbeat, node)
        return handlers

    def forget(self) -> None:
        """The past does not count: the bus has just been booted, or is back."""
        self._watched = [False] * len(self._nodes)
        self._states = [int(NmtState.OPERATIONAL)] * len(self._nodes)
        self._reported = [NO_ERROR] * len(self._nodes)

    def look(self) -> None:
        """Once a cycle: heartbeats that have stopped."""
        self._cycle += 1
        if self._cycle % LOOK_CYCLES:
            return
        now = self._cycle
        for index, watched in enumerate(self._watched):
            if watched and now - self._beats[index] > self._patience[index]:
                self._target.fail(index, DriveFault.HEARTBEAT, now - self._beats[index])

    def _axes_of(self, node: int) -> list[int]:
        """Return the axes of a node: what it says concerns all of them."""
        return [index for index, each in enumerate(self._nodes) if each == node]

    def _on_emergency(self, node: int, payload: bytes) -> None:
        message = unpack_emergency(payload)
        if message is None:
            return
        code, _register = message
        for index in self._axes_of(node):
            if not is_error(code):
                # the drive's error is gone, which is no news: the axis stays latched until it is reset
                self._reported[index] = NO_ERROR
                continue
            news = code != self._reported[index]
            self._reported[index] = code
            if self._rules[index].stops(code) and self._target.fail(index, DriveFault.EMERGENCY, code):
                continue
            if news:
                self.events.append(BusEvent(self._columns[index], code, emergency_text(code)))

    def _on_heartbeat(self, node: int, payload: bytes) -> None:
        if len(payload) != 1:
            return
        state = payload[0] & 0x7F
        for index in self._axes_of(node):
            self._beats[index] = self._cycle
            self._watched[index] = self._beating[index]
            if state == NmtState.BOOT_UP:
                self._states[index] = state
                self._reported[index] = NO_ERROR
                self._target.restart(index)
                self._target.fail(index, DriveFault.REBOOTED)
            elif state != self._states[index]:
                started = self._states[index] == NmtState.BOOT_UP
                self._states[index] = state
                if state != NmtState.OPERATIONAL and not started:
                    self._target.fail(index, DriveFault.NOT_OPERATIONAL, state)


def bus_back(column: int, name: str) -> BusEvent:
    """Return the event of a bus that is there again."""
    return BusEvent(column, 0, f"bus {name} is back", BusEventKind.BUS_BACK)
