"""A CANopen node without an application (CiA 301): dictionary, NMT, SDO, PDOs, SYNC, EMCY, heartbeats.

It has no clock and no bus of its own: frames and times come in by `receive` and `poll`, frames leave by the
function that it was made with. An application overrides the methods at the end of the class.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from mcserver.can.cob import NMT, Function, NmtState
from mcserver.drive_sim.dictionary import ObjectStore
from mcserver.drive_sim.emergency import Emergencies
from mcserver.drive_sim.fault_injection import Misbehaviour
from mcserver.drive_sim.nmt import HeartbeatConsumer, NmtSlave
from mcserver.drive_sim.pdo import Rpdo, Tpdo
from mcserver.drive_sim.sdo_server import SdoServer

NEVER = math.inf
MAX_DELAYED_ANSWERS = 64
COMMUNICATION_ERROR = 0x8100
HEARTBEAT_LOST = 0x8130
RPDO_TIMED_OUT = 0x8250

Transmit = Callable[[int, bytes], None]


class CanopenNode:
    """One node.

    Attributes:
        wake: when `poll` wants to be called, on the clock of the times that it is given.
        routes: goes up when `identifiers` has changed.
        wrong: what it does wrong, on demand.
    """

    def __init__(self, node: int, transmit: Transmit, store: ObjectStore | None = None) -> None:
        self.node = node
        self.wake = 0.0
        self.routes = 0
        self.wrong = Misbehaviour()
        self._transmit_frame = transmit
        self.store = store = ObjectStore(node) if store is None else store
        self.emergencies = Emergencies(store, self._transmit_emergency)
        self.sdo = SdoServer(store, self._answer)
        self.consumer = HeartbeatConsumer(store, self._reroute)
        self.rpdos = [Rpdo(store, number, self._reroute) for number in range(1, 5)]
        self.tpdos = [Tpdo(store, number, self._reroute) for number in range(1, 5)]
        self.nmt = NmtSlave(node, store, self._transmit, self._reset, self._state_changed)
        self._sync = store.entry(0x1005)
        self._sync.action = lambda _value: self._reroute()
        self._error_behaviour = store.entry(0x1029, 1)
        self._answers: deque[tuple[float, bytes]] = deque(maxlen=MAX_DELAYED_ANSWERS)
        self._now = 0.0

    @property
    def booted(self) -> bool:
        """Whether the boot-up message was sent."""
        return self.nmt.state is not None

    def switch_on(self, now: float) -> None:
        """Power comes: the node boots."""
        self._now = now
        self.nmt.reset(now)
        self.wake = now

    def identifiers(self) -> set[int]:
        """COB-IDs that the node listens to now."""
        wanted = {NMT, self._sync.value & 0x7FF, Function.SDO_REQUEST + self.node}
        wanted |= {rpdo.identifier for rpdo in self.rpdos if rpdo.valid}
        wanted |= {Function.HEARTBEAT + other for other in self.consumer.times()}
        return wanted

    def receive(self, identifier: int, payload: bytes, now: float) -> None:
        """One frame of the bus."""
        self._now = now
        state = self.nmt.state
        if state is None:
            return
        if identifier == self._sync.value & 0x7FF:
            if self.nmt.talks:
                self._at_sync(now)
        elif state is NmtState.OPERATIONAL and self._to_rpdo(identifier, payload, now):
            pass
        elif identifier == NMT:
            self.nmt.command(payload, now)
            self.wake = now
        elif identifier == Function.SDO_REQUEST + self.node:
            if self.nmt.talks:
                self.sdo.request(payload)
                self.obey(now)
                self.wake = now
        elif identifier > Function.HEARTBEAT and payload:
            self.consumer.heard(identifier - Function.HEARTBEAT, now)
            self.emergencies.end_error(HEARTBEAT_LOST)
            self.wake = min(self.wake, self.consumer.poll(now)[1])

    def poll(self, now: float) -> None:
        """Do what time alone brings; set `wake`."""
        self._now = now
        while self._answers and self._answers[0][0] <= now:
            self._transmit(Function.SDO_RESPONSE + self.node, self._answers.popleft()[1])
        wake = self._answers[0][0] if self._answers else NEVER
        wake = min(wake, self.nmt.poll(now))
        if self.nmt.state is not None:
            lost, again = self.consumer.poll(now)
            if lost is not None:
                self._heartbeat_lost()
            wake = min(wake, again)
        wake = min(wake, self.tick(now))
        if self.nmt.operational:
            # behind the application, whose changes are sent at once
            wake = min(wake, self._poll_pdos(now))
        self.wake = wake

    # ------------------------------------------------------------------ process data

    def _at_sync(self, now: float) -> None:
        if self.wrong.deaf_syncs:
            self.wrong.deaf_syncs -= 1
            return
        self.sample(now)
        if self.nmt.state is not NmtState.OPERATIONAL:
            return
        for tpdo in self.tpdos:
            payload = tpdo.at_sync()
            if payload is not None:
                self._transmit_tpdo(tpdo, payload)
        for rpdo in self.rpdos:
            rpdo.sync()
        self.obey(now)

    def _to_rpdo(self, identifier: int, payload: bytes, now: float) -> bool:
        for rpdo in self.rpdos:
            if rpdo.valid and rpdo.identifier == identifier:
                changed, code = rpdo.receive(payload, now)
                if code:
                    # an error of a moment: reported, and over
                    self.emergencies.raise_error(code)
                    self.emergencies.end_error(code)
                else:
                    self.emergencies.end_error(RPDO_TIMED_OUT)
                if changed:
                    self.obey(now)
                    self.wake = now
                elif rpdo.event_s:
                    self.wake = min(self.wake, now + rpdo.event_s)
                return True
        return False

    def _poll_pdos(self, now: float) -> float:
        wake = NEVER
        for rpdo in self.rpdos:
            expired, again = rpdo.poll(now)
            if expired:
                self.emergencies.raise_error(RPDO_TIMED_OUT)
                self.connection_lost(RPDO_TIMED_OUT)
            wake = min(wake, again)
        for tpdo in self.tpdos:
            payload, again = tpdo.poll(now)
            if payload is not None:
                self._transmit_tpdo(tpdo, payload)
            wake = min(wake, again)
        return wake

    def _transmit_tpdo(self, tpdo: Tpdo, payload: bytes) -> None:
        sent = self.wrong.tpdo(tpdo.identifier, payload)
        if sent is not None:
            self._transmit(tpdo.identifier, sent)

    def _transmit(self, identifier: int, payload: bytes) -> None:
        if not self.wrong.mute:
            self._transmit_frame(identifier, payload)

    def _transmit_emergency(self, identifier: int, payload: bytes) -> None:
        if self.nmt.talks:
            self._transmit(identifier, payload)

    def _answer(self, message: bytes) -> None:
        if self.wrong.sdo_delay_s > 0.0:
            self._answers.append((self._now + self.wrong.sdo_delay_s, message))
        else:
            self._transmit(Function.SDO_RESPONSE + self.node, message)

    # ------------------------------------------------------------------ network

    def _reset(self, whole: bool) -> None:
        self.sdo.reset()
        self.consumer.forget()
        self._answers.clear()
        self.emergencies.forget()
        if whole:
            self.store.reset()
        else:
            self.store.reset(0x1000, 0x1FFF)
        for pdo in (*self.rpdos, *self.tpdos):
            pdo.compile()
        self.reset_application(whole)
        self._reroute()

    def _state_changed(self, old: NmtState | None, new: NmtState | None) -> None:
        if new is NmtState.OPERATIONAL:
            for rpdo in self.rpdos:
                rpdo.start()
            for tpdo in self.tpdos:
                tpdo.start()
        elif old is NmtState.OPERATIONAL:
            # a drive that gets no setpoints any more has lost its connection (CiA 402-2, 6007h)
            self.connection_lost(COMMUNICATION_ERROR)
        self._touch()

    def _heartbeat_lost(self) -> None:
        self.emergencies.raise_error(HEARTBEAT_LOST)
        self.connection_lost(HEARTBEAT_LOST)
        behaviour = self._error_behaviour.value
        if behaviour == 0 and self.nmt.operational:
            self.nmt.enter(NmtState.PRE_OPERATIONAL)
        elif behaviour == 2:
            self.nmt.enter(NmtState.STOPPED)

    def _touch(self) -> None:
        self.wake = self._now

    def _reroute(self) -> None:
        self.routes += 1
        self._touch()

    # ------------------------------------------------------------------ the application

    def sample(self, now: float) -> None:
        """A SYNC: brings the values up to date that are about to be transmitted."""

    def obey(self, now: float) -> None:
        """Values of the dictionary may have changed."""

    def tick(self, now: float) -> float:
        """Do what time alone brings; when to call again."""
        del now
        return NEVER

    def reset_application(self, whole: bool) -> None:
        """The dictionary was reset: all of it, or its communication part."""

    def connection_lost(self, code: int) -> None:
        """The master is silent, or the node has left OPERATIONAL; ``code`` of the EMCY that may tell it."""
