"""Listen on a bus before the first frame is sent: is another master at work there?

Heartbeats and boot-up messages of nodes say nothing of a master. SYNC, NMT commands, SDO requests, commands
to drives, the heartbeat of node 127 and process data of drives do: resetting such nodes may stop or drop a
machine that somebody else moves.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from mcserver.can.cob import GREATEST_NODE, LEAST_NODE, NMT, RPDOS, SYNC, TPDOS, Function
from mcserver.can.port import EXTENDED, ListeningPort, recipient
from mcserver.canopen.settings import DriveSettings
from mcserver.errors import RuntimeFault

MASTER = 127
ROUND_S = 0.01
ROUNDS_AFTER_SIGN = 10
SHOWN = 6


@dataclass(frozen=True)
class Listening:
    """One bus that is listened on.

    Attributes:
        drives: numbers of its CiA 402 nodes. foreign: of its other drives, COB-IDs that tell of a master (of
            extended ones the `recipient`), and whose they are.
        foreign_sync: SYNC comes from somebody else by agreement.
    """

    name: str
    port: ListeningPort
    drives: Collection[int]
    foreign: Mapping[int, int] = field(default_factory=dict)
    foreign_sync: bool = False


def for_masters(drive: DriveSettings, port: ListeningPort) -> Listening:
    """Listen on a drive's bus for a master's frames alone.

    Nodes that send process data by themselves are none, nor is a producer of SYNC by agreement.
    """
    commands = {rpdo + node: node for node in range(LEAST_NODE, GREATEST_NODE + 1) for rpdo in RPDOS}
    return Listening(drive.bus, port, (), commands, drive.foreign_sync)


def sign_of_master(identifier: int, bus: Listening) -> str:
    """Return what a frame says of another master, in words; empty: nothing."""
    if identifier == SYNC:
        return "" if bus.foreign_sync else "SYNC (080h)"
    if identifier == NMT:
        return "NMT commands (000h)"
    if identifier == Function.HEARTBEAT + MASTER:
        return "the heartbeat of node 127 (77Fh)"
    if identifier & EXTENDED:
        node = bus.foreign.get(recipient(identifier), 0)
        return f"commands to node {node} ({identifier ^ EXTENDED:08X}h)" if node else ""
    node = identifier & 0x7F
    function = identifier & 0x780
    if function == Function.SDO_REQUEST and node:
        return f"SDO requests to node {node} ({identifier:03X}h)"
    if function in RPDOS and node in bus.drives:
        return f"commands to node {node} ({identifier:03X}h)"
    if identifier in bus.foreign:
        return f"commands to node {bus.foreign[identifier]} ({identifier:03X}h)"
    if function in TPDOS and node in bus.drives:
        return f"process data of node {node} ({identifier:03X}h)"
    return ""


def refuse_other_masters(
    buses: Sequence[Listening],
    duration_s: float,
    stopping: Callable[[], bool] = lambda: False,
    wait: Callable[[float], None] = time.sleep,
) -> None:
    """Listen on all buses at once; nothing is sent.

    Raises:
        RuntimeFault: MC560 another master is at work, with what was heard.
    """
    signs: dict[str, Counter[str]] = {bus.name: Counter() for bus in buses}
    remaining = max(1, round(duration_s / ROUND_S))
    while remaining and not stopping():
        remaining -= 1
        wait(ROUND_S)
        for bus in buses:
            found = (sign_of_master(identifier, bus) for identifier, _ in bus.port.drain())
            signs[bus.name].update(sign for sign in found if sign)
        if any(signs.values()):
            # enough to refuse; a little longer, so that it can be said what else is there
            remaining = min(remaining, ROUNDS_AFTER_SIGN)
    heard = [(name, counted) for name, counted in signs.items() if counted]
    if heard:
        raise _other_master(heard, duration_s)


def _other_master(heard: Iterable[tuple[str, Counter[str]]], duration_s: float) -> RuntimeFault:
    texts = []
    for name, counted in heard:
        shown = [f"{sign} {count} times" for sign, count in counted.most_common(SHOWN)]
        if len(counted) > SHOWN:
            shown.append(f"and {len(counted) - SHOWN} more")
        texts.append(f"bus {name}: {', '.join(shown)}")
    return RuntimeFault(
        "MC560",
        f"another master is at work; within {duration_s:g} s was heard on {'; '.join(texts)}",
        "stop it first; nothing was sent and no drive was reset. --take-over resets the nodes all the same; "
        'where another device sends SYNC by agreement, set sync = "foreign" in [[bus]]',
    )
