"""Counts of what happens on a bus while somebody listens: load, lost and late frames, errors, strangers.

Nothing is sent, so that it may run beside a server at work.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from mcserver.can.cob import NMT, SYNC, Function, NmtState
from mcserver.can.pdo import MappedPdo
from mcserver.canopen.emergency_text import decode_emergency
from mcserver.canopen.listening import MASTER
from mcserver.canopen.process_data import SYNCHRONOUS
from mcserver.canopen.views import BusCounts, NodeHealth
from mcserver.machine.bus_load import frame_bits

MOST_EMERGENCIES = 8
MOST_STRANGERS = 16


class _Cyclic:
    """One TPDO that is due at every n-th SYNC; counted over windows of n SYNCs."""

    def __init__(self, pdo: MappedPdo) -> None:
        self._every = max(1, pdo.transmission)
        self._syncs = 0
        self._came: list[int] = []
        self._now = 0
        self.readings = 0

    def arrive(self) -> None:
        if self._syncs:
            self.readings += 1
            self._now += 1

    def sync(self) -> None:
        self._syncs += 1
        if self._syncs > 1 and (self._syncs - 1) % self._every == 0:
            self._came.append(self._now)
            self._now = 0

    @property
    def late_and_lost(self) -> tuple[int, int]:
        """Windows without a reading of their own: made up for in another one, or never.

        The first window is not judged: listening began in it.
        """
        judged = self._came[1:]
        lost = max(0, len(judged) - sum(judged) - self._now)
        return max(0, judged.count(0) - lost), lost


class BusListener:
    """Counts frames of one bus.

    Args:
        nodes: axes and TPDOs of each node of the machine file, by number. commands: COB-IDs of their RPDOs.
    """

    def __init__(
        self, nodes: Mapping[int, tuple[Sequence[int], Sequence[MappedPdo]]], commands: Iterable[int]
    ) -> None:
        self._nodes: dict[int, NodeHealth] = {}
        self._cyclic: dict[int, tuple[int, _Cyclic]] = {}
        own = {NMT, SYNC, Function.HEARTBEAT + MASTER, *commands}
        for number, (axes, tpdos) in sorted(nodes.items()):
            self._nodes[number] = NodeHealth(number, list(axes))
            own |= {pdo.cob_id for pdo in tpdos}
            own |= {
                function + number
                for function in (
                    Function.EMCY,
                    Function.HEARTBEAT,
                    Function.SDO_REQUEST,
                    Function.SDO_RESPONSE,
                )
            }
            for pdo in tpdos:
                if pdo.transmission in SYNCHRONOUS and pdo.transmission:
                    self._cyclic[pdo.cob_id] = number, _Cyclic(pdo)
        self._own = own
        self._counts = BusCounts(0.0, 0, 0.0)
        self._bits = 0
        self._strangers: Counter[int] = Counter()
        self._sync_at: float | None = None
        self._beat_at: dict[int, float] = {}

    def take(self, at_s: float, identifier: int, payload: bytes) -> None:
        """Take a frame that came at a time [s]."""
        counts = self._counts
        counts.frames += 1
        self._bits += frame_bits(len(payload))
        if identifier == SYNC:
            self._on_sync(at_s)
        elif identifier in self._cyclic:
            self._cyclic[identifier][1].arrive()
        elif identifier not in self._own:
            if identifier in self._strangers or len(self._strangers) < MOST_STRANGERS:
                self._strangers[identifier] += 1
        elif (node := self._nodes.get(identifier & 0x7F)) is not None:
            self._on_node(node, at_s, identifier & 0x780, payload)

    def report(self, duration_s: float, bitrate: int) -> BusCounts:
        """Return what was counted.

        Args:
            duration_s: that was listened. bitrate: of the bus [bit/s].
        """
        for number, cyclic in self._cyclic.values():
            late, lost = cyclic.late_and_lost
            node = self._nodes[number]
            node.readings += cyclic.readings
            node.late += late
            node.lost += lost
        self._cyclic.clear()
        counts = self._counts
        counts.duration_s = duration_s
        counts.load = self._bits / duration_s / bitrate
        counts.nodes = list(self._nodes.values())
        counts.strangers = {f"{each:03X}h": count for each, count in sorted(self._strangers.items())}
        return counts

    def _on_sync(self, at_s: float) -> None:
        self._counts.syncs += 1
        if self._sync_at is not None:
            gap = at_s - self._sync_at
            self._counts.longest_sync_gap_s = max(self._counts.longest_sync_gap_s, gap)
        self._sync_at = at_s
        for _, cyclic in self._cyclic.values():
            cyclic.sync()

    def _on_node(self, node: NodeHealth, at_s: float, function: int, payload: bytes) -> None:
        if function == Function.HEARTBEAT and len(payload) == 1:
            try:
                state = NmtState(payload[0] & 0x7F)
            except ValueError:
                return
            node.boot_ups += state is NmtState.BOOT_UP
            node.state = state.name.lower().replace("_", "-")
            node.heartbeats += 1
            before = self._beat_at.get(node.node)
            if before is not None:
                node.longest_gap_s = max(node.longest_gap_s, at_s - before)
            self._beat_at[node.node] = at_s
        elif function == Function.EMCY:
            emergency = decode_emergency(payload)
            if emergency is not None:
                node.emergencies = [*node.emergencies, emergency.text][-MOST_EMERGENCIES:]
