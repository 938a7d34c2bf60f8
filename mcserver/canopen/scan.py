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
from mcserver.canopen.profiles import CIA_402, profile_text
from mcserver.canopen.views import Fieldbus, ScannedNode

ROUND_S = 0.005
ANSWER_S = 0.3
TRIES = 2
_UPLOAD = 0x40
# values that stand for no limit
UNLIMITED, UNLIMITED_RPM = (1 << 31) - 1, 200_000
# what a drive says of its mechanics and limits
DRIVE_OBJECTS = (
    *((index, subindex) for index in (0x608F, 0x6091, 0x6092, 0x607D) for subindex in (1, 2)),
    (0x6076, 0),
    (0x6080, 0),
)

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
    drives = [node for node in there if (types[node, 0x1000, 0] or 0) & 0xFFFF == CIA_402]
    wanted += [(node, *place) for node in drives for place in ((0x6502, 0), *DRIVE_OBJECTS)]
    answers = _ask(port, wanted, wait)
    found = []
    for node in there:
        profile = (types[node, 0x1000, 0] or 0) & 0xFFFF
        supported = answers.get((node, 0x6502, 0)) or 0
        vendor, product, revision, serial = (
            answers.get((node, 0x1018, subindex)) for subindex in (1, 2, 3, 4)
        )
        identity = (vendor, product, revision, serial)
        said = {
            object_key(*place): value
            for place in DRIVE_OBJECTS
            if (value := answers.get((node, *place))) is not None
        }
        found.append(
            ScannedNode(
                node, profile, profile_text(profile), *identity, modes=modes_of(supported), objects=said
            )
        )
    return found


def object_key(index: int, subindex: int) -> str:
    """Name an object in `ScannedNode.objects`."""
    return f"{index:04X}:{subindex}"


def modes_of(supported: int) -> list[str]:
    """Return the modes that 6502h names, in short."""
    return [short for bit, (short, _) in MODE_BITS.items() if supported >> bit & 1]


def machine_file(name: str, address: str, nodes: list[ScannedNode], fieldbus: Fieldbus = "can") -> str:
    """Return a machine file to start from: what has to be filled in is said there."""
    line = fieldbus == "ethercat"
    bus = [f'address = "{address}"', "bitrate = 1000000              # as the interface has it"]
    lines = [
        "# made by mcserver scan: fill in what is marked, then run `mcserver machine check` on it",
        "[machine]",
        f'name = "{name}"',
        "cycle_hz = 200",
        "",
        "[[bus]]",
        'name = "bus"',
        *(['kind = "ethercat"', f'interface = "{address}"'] if line else bus),
    ]
    drives = [node for node in nodes if node.profile == CIA_402]
    for axis, node in enumerate(drives):
        mode = next((mode for mode in USABLE_MODES if mode in node.modes), "csp")
        lines += [
            "",
            "[[axis]]",
            f"index = {axis}",
            'type = "rotary"                # "linear" needs units_per_motor_rev',
            *_axis_limits(node),
            "max_acceleration = 10.0        # deg/s²: fill in",
            "[axis.drive]",
            'kind = "cia402"',
            'bus = "bus"',
            f"{'position' if line else 'node'} = {node.node}",
            f'mode = "{mode}"'
            + (f"                   # 6502h: {', '.join(node.modes)}" if node.modes else ""),
            *_mechanics(node),
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


def _axis_limits(node: ScannedNode) -> list[str]:
    """Velocity and travel at the shaft, as far as the drive says them; else to be filled in."""
    motor_rpm = node.objects.get("6080:0", 0)
    motor, shaft = _ratio(node, 0x6091) or (1, 1)
    lines = ["max_velocity = 10.0            # deg/s: fill in"]
    if 0 < motor_rpm < UNLIMITED_RPM:
        degrees = motor_rpm * 6.0 * shaft / motor
        lines = [f"max_velocity = {degrees:.6g}  # deg/s at the shaft: the motor's {motor_rpm} /min (6080h)"]
    feed = _ratio(node, 0x6092)
    low, high = (_signed(node.objects.get(object_key(0x607D, subindex), 0)) for subindex in (1, 2))
    if feed is not None and low < high and low > -UNLIMITED and high < UNLIMITED:
        for key, value in (("min_position", low), ("max_position", high)):
            lines.append(f"{key} = {value * 360.0 * feed[1] / feed[0]:.6g}  # deg: 607Dh")
    return lines


def _mechanics(node: ScannedNode) -> list[str]:
    """Encoder, gear and rated torque as the drive says them; the encoder else to be filled in."""
    encoder, gear = _ratio(node, 0x608F), _ratio(node, 0x6091)
    if encoder is None:
        lines = ["counts_per_motor_rev = 65536   # of the encoder: fill in"]
    elif encoder[1] == 1:
        lines = [f"counts_per_motor_rev = {encoder[0]}   # 608Fh"]
    else:
        lines = [f"encoder = [{encoder[0]}, {encoder[1]}]   # increments, motor revolutions: 608Fh"]
    if gear is not None and gear != (1, 1):
        lines.append(f"gear = [{gear[0]}, {gear[1]}]   # motor, shaft revolutions: 6091h")
    torque = node.objects.get("6076:0", 0)
    if torque:
        lines.append(f"rated_torque = {torque / 1000.0:g}   # N·m: 6076h")
    return lines


def _ratio(node: ScannedNode, index: int) -> tuple[int, int] | None:
    """Return the two numbers of an object; None where the drive does not say them."""
    first, second = (node.objects.get(object_key(index, subindex), 0) for subindex in (1, 2))
    return (first, second) if 0 < first < UNLIMITED and 0 < second < UNLIMITED else None


def _signed(number: int) -> int:
    return number - (1 << 32) if number >= 1 << 31 else number


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
