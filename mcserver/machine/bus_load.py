"""Compute the share of a CAN bus that a machine's cycle takes, and refuse more than 80 %.

Bits of a classic frame with an 11-bit identifier and n bytes, in the worst case of bit stuffing (Davis,
Burns, Bril, Lukkien: Controller Area Network schedulability analysis, 2007): 47 + 8·n + floor((33 + 8·n)/4),
which is 135 for 8 bytes, and 160 with an identifier of 29 bits; the three bits between frames are in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mcserver.can.pdo import ProcessData
from mcserver.can.pdo_layout import rpdo1_cycles
from mcserver.errors import ConfigurationError
from mcserver.machine.drive import COMMAND_TIMEOUT_CYCLES, CanDrive
from mcserver.machine.io_process_data import HEARTBEAT_MS, io_process_data, nodes_on

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis
    from mcserver.machine.bus_section import BusConfig
    from mcserver.machine.machine_file import Machine

# Share of a bus that the cycle may take: SDO, EMCY and retransmissions need the rest.
CEILING = 0.8
# The server's own heartbeat, node 127.
MASTER_HEARTBEAT_HZ = 20.0
# Above any cycle rate: here RPDO1 is sent at its minimum rate.
GREATEST_HZ = 1e5


def frame_bits(length: int, *, extended: bool = False) -> int:
    """Return the bits of a frame with ``length`` bytes, maximum bit stuffing and the interframe space."""
    # bits before the checksum that may be stuffed, without the payload
    head = 54 if extended else 34
    return head + 13 + 8 * length + (head - 1 + 8 * length) // 4


@dataclass(frozen=True)
class Share:
    """One kind of frame on a bus.

    Attributes:
        frames: per cycle; below 1 if not in every cycle. bits: of each. fixed_hz: rate of all of them
            together if independent of the cycle [1/s]; ``frames`` is then 0.
        timeouts_ms: of frames sent as rarely as the drives' time-outs allow: those of the machine file, each
            with the shortest usual for its mode; ``frames`` is then the count of axes.
        cycle_hz: present cycle rate.
    """

    what: str
    frames: float
    bits: int
    fixed_hz: float = 0.0
    timeouts_ms: tuple[tuple[float, float], ...] = ()
    cycle_hz: float = 0.0

    def frames_at(self, cycle_hz: float) -> float:
        """Return the frames per cycle at another cycle rate."""
        if not self.timeouts_ms:
            return self.frames
        timeouts = [timeout for timeout, _ in self.timeouts_ms]
        if cycle_hz > self.cycle_hz:
            # time-outs that are multiples of the cycle get shorter with it
            by_cycle = COMMAND_TIMEOUT_CYCLES * 1e3 / cycle_hz
            timeouts = [min(timeout, max(usual, by_cycle)) for timeout, usual in self.timeouts_ms]
        return self.frames / rpdo1_cycles(timeouts, 1.0 / cycle_hz)


@dataclass(frozen=True)
class BusLoad:
    """The load of one bus.

    Attributes:
        cycle_hz: of the machine. bitrate: [bit/s]. axes: on the bus. shares: see `Share`.
    """

    bus: str
    cycle_hz: float
    bitrate: int
    axes: int
    shares: tuple[Share, ...]

    @property
    def bits_per_cycle(self) -> float:
        """Bits per cycle of frames sent with the cycle."""
        return self.bits_at(self.cycle_hz)

    def bits_at(self, cycle_hz: float) -> float:
        """Return `bits_per_cycle` at another cycle rate."""
        return math.fsum(share.frames_at(cycle_hz) * share.bits for share in self.shares)

    @property
    def fixed_bits_per_second(self) -> float:
        """Bits of frames at fixed rates [bit/s]."""
        return math.fsum(share.fixed_hz * share.bits for share in self.shares)

    @property
    def share(self) -> float:
        """Share of the bus in use [1]."""
        return (self.bits_per_cycle * self.cycle_hz + self.fixed_bits_per_second) / self.bitrate

    @property
    def fits(self) -> bool:
        return self.share <= CEILING

    @property
    def greatest_cycle_hz(self) -> int:
        """Greatest whole cycle rate that fits; 0 if none does."""
        if self.bits_per_cycle <= 0.0:
            return 0
        left = CEILING * self.bitrate - self.fixed_bits_per_second
        # upper bound: the rate that fits with RPDO1 at its minimum
        most = math.floor(left / self.bits_at(GREATEST_HZ))
        fitting = (hz for hz in range(most, 0, -1) if self.bits_at(hz) * hz <= left)
        return next(fitting, 0)

    @property
    def usual_cycle_hz(self) -> int:
        """Greatest rate that fits with a period of whole 0.1 ms, as in 60C2h; 0 if none does."""
        rates = [hz for hz in range(1, self.greatest_cycle_hz + 1) if 10_000 % hz == 0]
        return max(rates, default=0)

    @property
    def buses_needed(self) -> int:
        """Number of buses like this one over which the axes have to be spread; 0: no number suffices."""
        for count in range(2, self.axes + 1):
            if self._spread(count) <= CEILING:
                return count
        return 0

    def axes_of(self, buses: int) -> int:
        """Return the axes on the fullest of ``buses`` buses."""
        return math.ceil(self.axes / buses)

    def _spread(self, buses: int) -> float:
        """Return the fullest bus's load with axes spread evenly; frames that each bus has anyway stay."""
        part = self.axes_of(buses) / self.axes if self.axes else 1.0
        bits = 0.0
        for share in self.shares:
            whole = share.what in ("SYNC", "heartbeat of the master", "inputs", "outputs")
            rate = share.frames_at(self.cycle_hz) * self.cycle_hz + share.fixed_hz
            bits += rate * share.bits * (1.0 if whole else part)
        return bits / self.bitrate

    def arithmetic(self) -> str:
        """Return the sum in one line."""
        terms = [
            f"{share.frames_at(self.cycle_hz):.4g} × {share.bits} ({share.what})"
            for share in self.shares
            if share.frames > 0.0
        ]
        text = (
            f"{' + '.join(terms)} = {self.bits_per_cycle:.0f} bits a cycle, × {self.cycle_hz:g} Hz"
            f" + {self.fixed_bits_per_second:.0f} bit/s at rates of their own"
        )
        return f"{text} = {100.0 * self.share:.1f} % of {self.bitrate / 1000.0:g} kbit/s"


def bus_loads(machine: Machine) -> tuple[BusLoad, ...]:
    """Return the load of each bus with a drive of the machine."""
    loads = []
    for bus in machine.buses:
        if bus.kind != "can":
            continue
        axes = [
            axis
            for axis in machine.axes
            if isinstance(axis.drive, CanDrive) and axis.drive.bus == bus.name and axis.drive.node
        ]
        nodes = [io_process_data(machine, bus.name, node) for node in nodes_on(machine, bus.name)]
        if axes or nodes:
            loads.append(load_of(bus, axes, machine.cycle_hz, nodes, _drive_io(machine, bus.name)))
    return tuple(loads)


def load_of(
    bus: BusConfig,
    axes: list[Axis],
    cycle_hz: float,
    nodes: Sequence[ProcessData] = (),
    besides: Sequence[Share] = (),
) -> BusLoad:
    """Return the load of one bus with these axes in velocity mode, which takes most.

    Args:
        nodes: process data of its I/O nodes. besides: frames of its drives that are not for motion.
    """
    kinds: dict[type[CanDrive], list[Axis]] = {}
    for axis in axes:
        assert isinstance(axis.drive, CanDrive)
        kinds.setdefault(type(axis.drive), []).append(axis)
    shares: list[Share] = []
    if nodes or any(kind.synchronous for kind in kinds):
        shares += [
            Share("SYNC", 1.0, frame_bits(0)),
            Share("heartbeat of the master", 0.0, frame_bits(1), MASTER_HEARTBEAT_HZ),
        ]
    for kind, own in kinds.items():
        shares += kind.shares(own, cycle_hz)
    shares += besides
    for node in nodes:
        shares += [Share("inputs", 1.0, frame_bits(pdo.length)) for pdo in node.tpdos]
        shares += [Share("outputs", 1.0, frame_bits(pdo.length)) for pdo in node.rpdos]
        shares.append(Share("heartbeats", 0.0, frame_bits(1), 1000.0 / HEARTBEAT_MS))
    return BusLoad(bus.name, cycle_hz, bus.bitrate, len(axes), tuple(shares))


def _drive_io(machine: Machine, bus: str) -> list[Share]:
    """Return the frames of 60FDh and 60FEh of drives, each in its own PDO."""
    shares = []
    for what, objects in (
        ("inputs of drives", [each.source for each in machine.inputs]),
        ("outputs of drives", [each.target for each in machine.outputs]),
    ):
        axes = {each.axis for each in objects if each is not None and each.axis >= 0 and each.bus == bus}
        if axes:
            shares.append(Share(what, float(len(axes)), frame_bits(4)))
    return shares


def refuse_overload(machine: Machine, source: str) -> None:
    """Refuse a machine whose cycle does not fit its buses.

    Raises:
        ConfigurationError: MC007, with the computation and with rates or buses that would fit.
    """
    for load in bus_loads(machine):
        if load.fits:
            continue
        remedies = []
        if load.usual_cycle_hz >= 10:
            remedies.append(
                f"cycle_hz = {load.usual_cycle_hz} fits (anything up to {load.greatest_cycle_hz} does)"
            )
        if load.buses_needed:
            remedies.append(
                f"at {load.cycle_hz:g} Hz {load.buses_needed} buses with at most "
                f"{load.axes_of(load.buses_needed)} axes each fit"
            )
        raise ConfigurationError(
            "MC007",
            f"{source}: bus {load.bus} cannot carry {load.axes} axes at {load.cycle_hz:g} Hz, "
            f"at most {100.0 * CEILING:.0f} % may be used: {load.arithmetic()}",
            "; ".join(remedies) or "use a greater bitrate and fewer axes a bus",
        )
