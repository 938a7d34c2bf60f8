"""Where the process data of one axis stand in the arenas of its bus, whatever PDOs they come and go in.

An arena holds what the cycle exchanges in one form: RPDO1 and TPDO1 of 7 bytes, RPDO2 of 8 (see
`mcserver.can.pdo_layout`), a third one of 2 bytes for torque offsets and a fourth of 4 for outputs.
A PDO of another mapping is put together from pieces of an arena, and taken apart into pieces.
"""

from __future__ import annotations

from dataclasses import dataclass

from mcserver.can.cob import Function
from mcserver.can.pdo import MappedObject, MappedPdo, ProcessData
from mcserver.can.pdo_layout import RPDO1, RPDO2, TPDO1, TPDO2, Pdo
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.machine.axis import Axis

AXIS_OFFSET = 0x800
CONTROLWORD, MODE, TARGET_POSITION, INTERPOLATED = 0x6040, 0x6060, 0x607A, 0x60C1
TARGET_VELOCITY, TARGET_TORQUE, TORQUE_OFFSET = 0x60FF, 0x6071, 0x60B2
PROFILE_VELOCITY = 0x6081
DIGITAL_INPUTS, DIGITAL_OUTPUTS = 0x60FD, 0x60FE
STATUSWORD, MODE_DISPLAY, POSITION, TORQUE = 0x6041, 0x6061, 0x6064, 0x6077

# object → (which outgoing arena, first byte, bytes)
_OUT = {
    CONTROLWORD: (1, 0, 2),
    MODE: (1, 2, 1),
    TARGET_POSITION: (1, 3, 4),
    INTERPOLATED: (1, 3, 4),
    TARGET_VELOCITY: (2, 2, 4),
    PROFILE_VELOCITY: (2, 2, 4),  # no axis has both speeds
    TARGET_TORQUE: (2, 6, 2),
    TORQUE_OFFSET: (3, 0, 2),
    DIGITAL_OUTPUTS: (4, 0, 4),
}
# object → (first byte, bytes) of the incoming arena
_IN = {STATUSWORD: (0, 2), MODE_DISPLAY: (2, 1), POSITION: (3, 4)}
_ESSENTIAL = frozenset({STATUSWORD, POSITION})
_BY_POSITION = frozenset({MODE, TARGET_POSITION, INTERPOLATED})
_BY_SPEED = frozenset({TARGET_VELOCITY, TARGET_TORQUE})


@dataclass(frozen=True)
class Piece:
    """Bytes of an arena, and where in the payload they stand."""

    arena: int
    first: int
    length: int
    at: int


@dataclass(frozen=True)
class OutgoingPdo:
    """One RPDO: its frame and its pieces; whether it goes out in position mode, and in the others."""

    cob_id: int
    length: int
    pieces: tuple[Piece, ...]
    by_position: bool
    by_speed: bool


@dataclass(frozen=True)
class IncomingPdo:
    """One TPDO: its pieces, where torque and digital inputs stand, whether it belongs to an answer."""

    cob_id: int
    length: int
    pieces: tuple[Piece, ...]
    torque_at: int | None
    inputs_at: int | None
    essential: bool


@dataclass(frozen=True)
class AxisFrames:
    """The PDOs of one axis.

    Attributes:
        shows_mode: 6061h comes. has_profile_velocity: 6081h goes out.
    """

    rpdos: tuple[OutgoingPdo, ...]
    tpdos: tuple[IncomingPdo, ...]
    shows_mode: bool
    has_profile_velocity: bool


def frames_of(axis: Axis) -> AxisFrames:
    """Return the PDOs of an axis, as agreed with its drive, or the usual ones."""
    drive = cia402_drive(axis)
    data = drive.process_data or usual_process_data(drive.node, torque_offset=drive.torque_offset)
    offset = AXIS_OFFSET * drive.node_axis
    always = frozenset({TORQUE_OFFSET, DIGITAL_OUTPUTS} if drive.torque_offset else {DIGITAL_OUTPUTS})
    rpdos = tuple(_outgoing(pdo, offset, always) for pdo in data.rpdos)
    tpdos = tuple(_incoming(pdo, offset) for pdo in data.tpdos)
    going = {_plain(mapped, offset) for pdo in data.rpdos for mapped in pdo.objects}
    coming = {_plain(mapped, offset) for pdo in data.tpdos for mapped in pdo.objects}
    return AxisFrames(rpdos, tpdos, MODE_DISPLAY in coming, PROFILE_VELOCITY in going)


def usual_process_data(node: int, *, torque_offset: bool = False) -> ProcessData:
    """Return the mapping of `mcserver.can.pdo_layout`, of a node's first axis."""
    third = MappedPdo(3, Function.RPDO3 + node, (MappedObject(TORQUE_OFFSET, 0, 16),), 1)
    rpdos = _mapped(RPDO1, Function.RPDO1 + node), _mapped(RPDO2, Function.RPDO2 + node)
    return ProcessData(
        (*rpdos, third) if torque_offset else rpdos,
        (_mapped(TPDO1, Function.TPDO1 + node), _mapped(TPDO2, Function.TPDO2 + node)),
    )


def _mapped(pdo: Pdo, cob_id: int) -> MappedPdo:
    return MappedPdo(pdo.number, cob_id, pdo.objects, pdo.transmission)


def _plain(mapped: MappedObject, offset: int) -> int:
    """Return the index of the same object on a node's first axis."""
    return mapped.index - offset if mapped.index >= 0x6000 else mapped.index


def _outgoing(pdo: MappedPdo, offset: int, always: frozenset[int]) -> OutgoingPdo:
    """``always``: objects that have to go out in every mode."""
    pieces: list[Piece] = []
    indices = {_plain(mapped, offset) for mapped in pdo.objects}
    at = 0
    for mapped in pdo.objects:
        place = _OUT.get(_plain(mapped, offset))
        length = mapped.bits // 8
        if place is not None:
            pieces.append(Piece(place[0], place[1], length, at))
        at += length
    by_position = bool(indices & (_BY_POSITION | always)) or not indices & _BY_SPEED
    by_speed = bool(indices & (_BY_SPEED | always))
    return OutgoingPdo(pdo.cob_id, at, _joined(pieces), by_position, by_speed)


def _incoming(pdo: MappedPdo, offset: int) -> IncomingPdo:
    pieces: list[Piece] = []
    torque_at = inputs_at = None
    at = 0
    indices = {_plain(mapped, offset) for mapped in pdo.objects}
    for mapped in pdo.objects:
        index = _plain(mapped, offset)
        place = _IN.get(index)
        if place is not None:
            pieces.append(Piece(0, place[0], place[1], at))
        elif index == TORQUE:
            torque_at = at
        elif index == DIGITAL_INPUTS:
            inputs_at = at
        at += mapped.bits // 8
    essential = bool(indices & _ESSENTIAL)
    return IncomingPdo(pdo.cob_id, at, _joined(pieces), torque_at, inputs_at, essential)


def _joined(pieces: list[Piece]) -> tuple[Piece, ...]:
    """Neighbours as one piece: a usual PDO is a single copy."""
    joined: list[Piece] = []
    for piece in pieces:
        last = joined[-1] if joined else None
        if (
            last is not None
            and last.arena == piece.arena
            and last.first + last.length == piece.first
            and last.at + last.length == piece.at
        ):
            joined[-1] = Piece(last.arena, last.first, last.length + piece.length, last.at)
        else:
            joined.append(piece)
    return tuple(joined)
