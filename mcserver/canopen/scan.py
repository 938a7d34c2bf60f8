"""What is on a CAN bus: every node that answers SDO, with identity and modes, without a machine file.

Nothing is configured, reset or started; a node that moves goes on.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Collection

from mcserver.can.cob import GREATEST_NODE, LEAST_NODE, Function
from mcserver.can.port import CanPort
from mcserver.canopen.configuration import MODE_BITS, USABLE_MODES
from mcserver.canopen.views import ScannedNode

ROUND_S = 0.005
ANSWER_S = 0.3
TRIES = 2
CIA_402 = 402
_UPLOAD = 0x40
_PROFILES = {401: "inputs and outputs", 402: "drive", 404: "measuring device", 406: "encoder"}

Wait = Callable[[float], None]


def scan(port: CanPort, wait: Wait = time.sleep, without: Collection[int] = ()) -> list[ScannedNode]:
    """Ask every node number for 1000h, and those that answer for identity and modes; takes about a second.

    Args:
        without: numbers that are not asked: somebody else has a transfer with them.
    """
    every = [node for node in range(LEAST_NODE, GREATEST_NODE + 1) if node not in without]
    types = _ask(port, [(node, 0x1000, 0) for node in every], wait)
    there = sorted(node for node, _, _ in types)
    wanted = [(node, 0x1018, subindex) for node in there for subindex in (1, 2, 3, 4)]
    wanted += [(node, 0x6502, 0) for node in there if (types[node, 0x1000, 0] or 0) & 0xFFFF == CIA_402]
    answers = _ask(port, wanted, wait)
    found = []
    for node in there:
        profile = (types[node, 0x1000, 0] or 0) & 0xFFFF
        supported = answers.get((node, 0x6502, 0)) or 0
        vendor, product, revision, serial = (
            answers.get((node, 0x1018, subindex)) for subindex in (1, 2, 3, 4)
        )
        identity = (vendor, product, revision, serial)
        found.append(ScannedNode(node, profile, what_of(profile), *identity, modes=modes_of(supported)))
    return found


def what_of(profile: int) -> str:
    """Return what a device profile (1000h) is, in words."""
    return _PROFILES.get(profile, f"profile {profile}")


def modes_of(supported: int) -> list[str]:
    """Return the modes that 6502h names, in short."""
    return [short for bit, (short, _) in MODE_BITS.items() if supported >> bit & 1]


def machine_file(name: str, address: str, nodes: list[ScannedNode]) -> str:
    """A machine file to start from: what has to be filled in is said there."""
    lines = [
        "# made by mcserver scan: fill in what is marked, then run `mcserver machine check` on it",
        "[machine]",
        f'name = "{name}"',
        "cycle_hz = 200",
        "",
        "[[bus]]",
        'name = "bus"',
        f'address = "{address}"',
        "bitrate = 1000000              # as the interface has it",
    ]
    drives = [node for node in nodes if node.profile == CIA_402]
    for axis, node in enumerate(drives):
        mode = next((mode for mode in USABLE_MODES if mode in node.modes), "csp")
        lines += [
            "",
            "[[axis]]",
            f"index = {axis}",
            'type = "rotary"                # "linear" needs units_per_motor_rev',
            "max_velocity = 10.0            # deg/s: fill in",
            "max_acceleration = 10.0        # deg/s²: fill in",
            "[axis.drive]",
            'kind = "cia402"',
            'bus = "bus"',
            f"node = {node.node}",
            f'mode = "{mode}"'
            + (f"                   # 6502h: {', '.join(node.modes)}" if node.modes else ""),
            "counts_per_motor_rev = 65536   # of the encoder: fill in",
        ]
        if node.vendor_id is not None:
            lines.append(f"vendor_id = 0x{node.vendor_id:08X}")
        if node.product_code is not None:
            lines.append(f"product_code = 0x{node.product_code:08X}")
        lines.append(
            f"eds = {json.dumps(node.eds)}"
            if node.eds
            else '# eds = "drive.eds"            # whose VendorNumber and ProductNumber are these'
        )
    return "\n".join(lines) + "\n"


def _ask(
    port: CanPort, places: list[tuple[int, int, int]], wait: Wait
) -> dict[tuple[int, int, int], int | None]:
    """Upload objects, one at a time a node; None where the node refuses, missing where it is silent."""
    answers: dict[tuple[int, int, int], int | None] = {}
    queues: dict[int, list[tuple[int, int, int]]] = {}
    for place in places:
        queues.setdefault(place[0], []).append(place)
    while queues:
        for _ in range(TRIES):
            waiting = {queue[0] for queue in queues.values() if queue[0] not in answers}
            if not waiting:
                break
            for node, index, subindex in sorted(waiting):
                payload = bytes((_UPLOAD, index & 0xFF, index >> 8, subindex)).ljust(8, b"\x00")
                port.send(Function.SDO_REQUEST + node, payload)
            for _ in range(round(ANSWER_S / ROUND_S)):
                wait(ROUND_S)
                for identifier, payload in port.drain():
                    _take(identifier, bytes(payload), waiting, answers)
                if not waiting:
                    break
        for node, queue in list(queues.items()):
            # a node that was silent is not there, or not any more
            remaining = queue[1:] if queue[0] in answers else []
            if remaining:
                queues[node] = remaining
            else:
                del queues[node]
    return answers


def _take(
    identifier: int,
    payload: bytes,
    waiting: set[tuple[int, int, int]],
    answers: dict[tuple[int, int, int], int | None],
) -> None:
    node = identifier - Function.SDO_RESPONSE
    if len(payload) != 8 or not LEAST_NODE <= node <= GREATEST_NODE:
        return
    place = (node, int.from_bytes(payload[1:3], "little"), payload[3])
    if place not in waiting:
        return
    if payload[0] & 0xE0 == 0x80:
        answers[place] = None
    elif payload[0] & 0xE2 == 0x42:
        unused = payload[0] >> 2 & 3 if payload[0] & 1 else 0
        answers[place] = int.from_bytes(payload[4 : 8 - unused], "little")
    else:
        return
    waiting.discard(place)
