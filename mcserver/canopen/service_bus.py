"""One CAN bus of the service path: its thread, its master's heartbeat, its nodes' supervision.

Threads: one that receives, beats and watches, and never waits for a node; workers that boot nodes, each of
which waits for its own node only.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from mcserver.can.cob import NMT, Function, NmtCommand, NmtState
from mcserver.can.port import CanPort
from mcserver.canopen.boot import NodeBoot
from mcserver.canopen.bus_frames import ROUND_S, wait_for_frames
from mcserver.canopen.canopen_errors import DriveError, Stopped
from mcserver.canopen.drive_events import CanopenEvent, CanopenEventKind
from mcserver.canopen.listening import MASTER
from mcserver.canopen.network import PortNetwork
from mcserver.canopen.node import Node, NodeAxis, Phase
from mcserver.canopen.node_configuration import configure_node
from mcserver.canopen.sdo import NodeSdo
from mcserver.canopen.settings import NO_AXIS
from mcserver.errors import McError

log = logging.getLogger(__name__)

HEARTBEAT_S = 0.05
# Process data of the cycle come by the thousand; where nobody waits for an answer they are taken in lumps.
LUMP_S = 0.01
WORKERS = 32
FIRST_RETRY_S = 1.0
LONGEST_RETRY_S = 30.0
# Nodes that are silent are asked so often whether they are there.
SEEK_S = 1.0
# A drive that speaks only when it is spoken to is asked so long before its silence would count [s].
ASKED_BEFORE_S = 0.5
# Emergency messages of a node are reported at most so often.
EMERGENCY_S = 0.1
JOIN_S = 2.0
# A node that reboots while it is configured is configured again, so often at most.
CONFIGURATIONS = 3
GOODBYE_WATCH = (0x1016, 1)

OnEvent = Callable[[CanopenEvent], None]


class CanopenBus:
    """The nodes of one bus.

    Args:
        name: as the machine file has it. port: open; it is closed by `close`.
        plans: its axes, each with what is written into its drive.
        on_event: called in a thread of the bus; must not wait.
    """

    def __init__(
        self,
        name: str,
        port: CanPort,
        plans: Sequence[NodeAxis],
        on_event: OnEvent,
    ) -> None:
        self.name = name
        self._network = PortNetwork(port)
        self._on_event = on_event
        self._stopping = threading.Event()
        self._boot = NodeBoot(self._network, self._stopping)
        self.nodes: list[Node] = []
        for number in dict.fromkeys(axis.settings.node for axis in plans):
            own = [axis for axis in plans if axis.settings.node == number]
            own.sort(key=lambda axis: axis.settings.node_axis)
            self.nodes.append(Node(own, self._network, NodeSdo(self._network, own[0].settings)))
        self._workers = ThreadPoolExecutor(
            min(WORKERS, max(1, len(self.nodes))), thread_name_prefix=f"canopen {name} node"
        )
        self._under_way: dict[int, Future[None]] = {}
        self._known_boot_ups: dict[int, int] = {}
        self._down = False
        self._foreign_beats = 0
        self._foreign_reported = False
        self._network.handle(Function.HEARTBEAT + MASTER, self._on_foreign_beat)
        self._next_beat = 0.0
        self._next_watch = 0.0
        self._booted = False
        self._thread = threading.Thread(target=self._run, name=f"canopen {name}", daemon=True)
        self._network.try_send(Function.HEARTBEAT + MASTER, bytes((NmtState.BOOT_UP,)))
        self._thread.start()

    # ------------------------------------------------------------ life

    def boot(self) -> list[tuple[Node, Future[None]]]:
        """Begin to boot all nodes at once; a future ends when its node is operational, or has failed."""
        return [(node, self._workers.submit(self._bring_up, node, True)) for node in self.nodes]

    def supervise(self) -> None:
        """From now on nodes that reboot are configured again."""
        for node in self.nodes:
            self._known_boot_ups[node.settings.node] = node.boot_ups
        self._booted = True

    def close(self) -> None:
        """Take the nodes out of operation, end the threads and give the port back."""
        self._say_goodbye()
        self._stopping.set()
        for node in self.nodes:
            node.wake()
            node.phase = Phase.CLOSED
        self._workers.shutdown(wait=True, cancel_futures=True)
        self._thread.join(JOIN_S)
        self._network.disconnect()

    # ------------------------------------------------------------ the bus's thread

    def _run(self) -> None:
        reported = False
        while not self._stopping.is_set():
            try:
                self._wait_for_frames()
                self._network.receive()
                now = time.monotonic()
                self._beat(now)
                self._watch_bus()
                self._watch_for_masters()
                if self._booted and now >= self._next_watch:
                    self._next_watch = now + ROUND_S
                    for node in self.nodes:
                        self._watch(node, now)
            except Exception:
                # nothing that a bus brings may end its supervision
                if not reported:
                    reported = True
                    log.exception("bus %s: a round failed", self.name)
                self._stopping.wait(ROUND_S)

    def _wait_for_frames(self) -> None:
        nobody_waits = self._booted and not self._under_way and not self._network.is_awaited
        if nobody_waits and self._network.fileno() >= 0:
            self._stopping.wait(LUMP_S)
        else:
            wait_for_frames(self._network, self._stopping.wait)

    def _beat(self, now: float) -> None:
        if now >= self._next_beat:
            self._next_beat = now + HEARTBEAT_S
            self._network.try_send(Function.HEARTBEAT + MASTER, bytes((NmtState.OPERATIONAL,)))

    def _watch_bus(self) -> None:
        down = self._network.counters.down
        if down != self._down:
            self._down = down
            if down:
                message = f"the CAN bus {self.name} is away; its drives stop by their own time-outs"
                self._tell("bus.lost", None, message, "MC424")
            else:
                self._tell("bus.back", None, f"the CAN bus {self.name} is back")

    def _on_foreign_beat(self, _payload: bytes) -> None:
        """Count heartbeats of node 127: that number is ours, and we do not hear ourselves."""
        self._foreign_beats += 1

    def _watch_for_masters(self) -> None:
        if self._foreign_beats and not self._foreign_reported:
            self._foreign_reported = True
            message = (
                f"another master is on the CAN bus {self.name}: node 127, whose heartbeat is this server's, "
                "is heard from somebody else; both may command the same drives"
            )
            self._tell("bus.foreign_master", None, message, "MC560")

    def _watch(self, node: Node, now: float) -> None:
        self._tell_emergencies(node, now)
        self._ask(node, now)
        number = node.settings.node
        under_way = self._under_way.get(number)
        if under_way is not None:
            if not under_way.done():
                return
            del self._under_way[number]
        if node.boot_ups != self._known_boot_ups[number]:
            self._known_boot_ups[number] = node.boot_ups
            message = f"{node.settings.name}: has rebooted; it is configured again, without energy"
            self._tell("drive.rebooted", node, message, "MC558")
            self._restart(node)
        elif node.is_silent(now):
            self._watch_silent(node, now)
        elif node.phase is Phase.FAILED:
            if now >= node.retry_at:
                self._restart(node)
        elif node.phase is Phase.LOST or (node.settings.has_profile and node.nmt in _UNWANTED):
            self._welcome(node)

    def _ask(self, node: Node, now: float) -> None:
        """Ask a drive that speaks only when it is spoken to, as nobody else does before the cycle runs."""
        streamed = node.settings.streamed
        question = None if streamed is None else streamed.question
        if question is not None and node.is_silent(now + ASKED_BEFORE_S):
            self._network.try_send(*question)

    def _watch_silent(self, node: Node, now: float) -> None:
        if node.phase is Phase.OPERATIONAL:
            node.phase = Phase.LOST
            node.retry_at = now + SEEK_S
            what = _sign_of_life(node)
            message = f"{node.settings.name}: no {what} for {node.silence_limit_s:g} s"
            self._tell("drive.lost", node, message + "; check its power and the bus", "MC557")
        elif node.settings.has_profile and not self._down and now >= node.retry_at:
            # one that was switched off and on has no heartbeat before it is configured
            self._under_way[node.settings.node] = self._workers.submit(self._seek, node)

    def _welcome(self, node: Node) -> None:
        """A node is heard again, or is heard to have left operation."""
        unbeating = node.settings.heartbeat_ms == 0 and node.nmt is None
        if not node.settings.has_profile or node.nmt is NmtState.OPERATIONAL or unbeating:
            node.phase = Phase.OPERATIONAL
            self._tell("drive.back", node, f"{node.settings.name}: is heard again")
            return
        state = "not operational" if node.nmt is None else node.nmt.name.lower().replace("_", "-")
        message = f"{node.settings.name}: is {state}; it is configured and started again, without energy"
        self._tell("drive.rebooted", node, message, "MC558")
        self._restart(node)

    def _tell_emergencies(self, node: Node, now: float) -> None:
        if not node.emergencies or now < node.tell_at:
            return
        node.tell_at = now + EMERGENCY_S
        dropped, node.emergencies_dropped = node.emergencies_dropped, 0
        emergency = node.emergencies.popleft()
        more = f", and {dropped} more that are not shown" if dropped else ""
        message = f"{node.settings.name}: emergency {emergency.text}{more}"
        self._tell("drive.emergency", node, message, "" if emergency.cleared else "MC556")

    def _tell(self, kind: CanopenEventKind, node: Node | None, message: str, code: str = "") -> None:
        axis = None if node is None or node.settings.axis == NO_AXIS else node.settings.axis
        self._on_event(CanopenEvent(kind, message, axis, code))

    # ------------------------------------------------------------ workers

    def _restart(self, node: Node) -> None:
        node.phase = Phase.RESTARTING
        self._under_way[node.settings.node] = self._workers.submit(self._bring_back, node)

    def _bring_up(self, node: Node, find: bool) -> None:
        if find:
            self._boot.find(node)
        if node.settings.has_profile:
            self._boot.wake(node)
            self._configure(node)
        node.phase = Phase.OPERATIONAL
        node.failure = ""
        node.failures = 0

    def _configure(self, node: Node) -> None:
        """From pre-operational to operational, again where the node reboots in the middle of it."""
        for left in range(CONFIGURATIONS - 1, -1, -1):
            boot_ups = node.boot_ups
            try:
                writes = [write for axis in node.axes for write in axis.writes]
                configure_node(node, node.sdo, writes, self._boot.check_stopping)
                self._boot.start(node)
            except DriveError:
                if node.boot_ups == boot_ups or not left:
                    raise
            if node.boot_ups == boot_ups:
                return
        raise node.settings.fault(
            "MC555", "reboots again and again while it is configured", "check its supply"
        )

    def _seek(self, node: Node) -> None:
        """Ask a silent node whether it is there, and whether it still has its configuration.

        One that has it may be moving, and only its heartbeat is missing: it is left alone. Without a
        heartbeat nothing tells a node that was stopped from one that is gone: its process data have been
        missing for long, so that it is taken out of whatever state it is in and configured again.
        """
        unbeating = node.settings.heartbeat_ms == 0
        if unbeating or node.nmt is NmtState.STOPPED:
            payload = bytes((NmtCommand.ENTER_PRE_OPERATIONAL, node.settings.node))
            self._network.try_send(NMT, payload)
        try:
            period = int.from_bytes(node.sdo.upload(0x1017, 0, attempts=1), "little")
        except DriveError as error:
            if error.details.get("abort_code") is None:
                node.retry_at = time.monotonic() + SEEK_S
                return
            # a device without a heartbeat refuses to be asked for it, and so it is there
            period = 0
        configured = period == node.settings.heartbeat_ms and node.phase is not Phase.FAILED and not unbeating
        if configured or not node.is_silent(time.monotonic()):
            node.retry_at = time.monotonic() + SEEK_S
            return
        if node.phase is Phase.LOST:
            node.phase = Phase.RESTARTING
            message = f"{node.settings.name}: is there again without its configuration, which it gets again"
            self._tell("drive.rebooted", node, message, "MC558")
        node.forget_process_data()
        self._bring_back(node)

    def _bring_back(self, node: Node) -> None:
        try:
            self._bring_up(node, False)
        except Stopped:
            return
        except Exception as error:
            node.failures += 1
            pause = min(LONGEST_RETRY_S, FIRST_RETRY_S * 2.0 ** (node.failures - 1))
            node.retry_at = time.monotonic() + pause
            node.phase = Phase.FAILED
            node.failure = str(error)
            code = error.code if isinstance(error, McError) else "MC555"
            message = error.message if isinstance(error, McError) else f"{node.settings.name}: {error}"
            self._tell("drive.failed", node, f"{message}; tried again in {pause:g} s", code)
            return
        self._tell(
            "drive.started",
            node,
            f"{node.settings.name}: configured and operational, without energy (G1000, G1010)",
        )

    # ------------------------------------------------------------ the end

    def _say_goodbye(self) -> None:
        """Nodes no longer watch the master, whose heartbeat ends now, and leave operation."""
        operational = [
            node for node in self.nodes if node.phase is Phase.OPERATIONAL and node.settings.has_profile
        ]
        self._booted = False
        if self._down:
            return
        for future in [self._workers.submit(self._dismiss, node) for node in operational]:
            future.result()

    def _dismiss(self, node: Node) -> None:
        watched = any(
            (write.index, write.subindex) == GOODBYE_WATCH for axis in node.axes for write in axis.writes
        )
        if watched:
            try:
                node.sdo.download(*GOODBYE_WATCH, b"\x00\x00\x00\x00", attempts=1)
            except DriveError as error:
                log.info("%s", error)
        self._network.try_send(NMT, bytes((NmtCommand.ENTER_PRE_OPERATIONAL, node.settings.node)))


def _sign_of_life(node: Node) -> str:
    if not node.settings.has_profile:
        return "telemetry"
    return "heartbeat" if node.settings.heartbeat_ms else "process data"


_UNWANTED = frozenset({NmtState.PRE_OPERATIONAL, NmtState.STOPPED, NmtState.BOOT_UP})
