"""How much of a CAN bus a machine's cycle takes: frames, bits, and the 80 % that may be used.

Bits of a classic frame with an 11-bit identifier and n bytes, in the worst case of bit stuffing (Davis,
Burns, Bril, Lukkien: Controller Area Network schedulability analysis, 2007): 47 + 8·n + floor((33 + 8·n)/4),
which is 135 for 8 bytes; the three bits between frames are in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mcserver.can.pdo import ProcessData
from mcserver.can.pdo_layout import RPDO1, RPDO2, SLOW_SYNCS, TPDO1, TPDO2, Pdo, rpdo1_cycles
from mcserver.errors import ConfigurationError
from mcserver.machine.drive_section import COMMAND_TIMEOUT_CYCLES, COMMAND_TIMEOUT_MS, TORQUE_TIMEOUT_MS
from mcserver.machine.io_process_data import HEARTBEAT_MS, io_process_data, nodes_on

if TYPE_CHECKING:
    from mcserver.machine.drive_section import CanBusConfig
    from mcserver.machine.machine_file import Axis, Machine

# Share of a bus that the cycle may take: SDO, EMCY and repetitions need the rest.
CEILING = 0.8
# The server's own heartbeat, node 127.
MASTER_HEARTBEAT_HZ = 20.0
# Beyond any cycle: RPDO1 comes as rarely as it ever does.
GREATEST_HZ = 1e5
SERVOSILA_BYTES = 8
SERVOSILA_TELEMETRY = 3


def frame_bits(length: int) -> int:
    """Bits of a frame with ``length`` bytes, with the most stuff bits and the space to the next one."""
    return 47 + 8 * length + (33 + 8 * length) // 4


def _bytes(pdo: Pdo) -> int:
    return sum(entry.bits for entry in pdo.entries) // 8


@dataclass(frozen=True)
class Share:
    """One kind of frame on a bus.

    Attributes:
        frames: per cycle; below 1 where not every cycle has one. bits: of each. fixed_hz: where the frames
            come at a rate of their own, all of them together [1/s]; then ``frames`` is 0.
        timeouts_ms: where the frames come as rarely as the drives' time-outs allow: those of this machine
            file, each with the shortest that is usual for its mode; ``frames`` is the count of axes then.
        cycle_hz: that they are of.
    """

    what: str
    frames: float
    bits: int
    fixed_hz: float = 0.0
    timeouts_ms: tuple[tuple[float, float], ...] = ()
    cycle_hz: float = 0.0

    def frames_at(self, cycle_hz: float) -> float:
        """Of a cycle at this rate."""
        if not self.timeouts_ms:
            return self.frames
        timeouts = [timeout for timeout, _ in self.timeouts_ms]
        if cycle_hz > self.cycle_hz:
            # those that follow from the cycle get shorter with it
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
        """Of frames that come with the cycle."""
        return self.bits_at(self.cycle_hz)

    def bits_at(self, cycle_hz: float) -> float:
        """The same of a cycle at another rate."""
        return sum(share.frames_at(cycle_hz) * share.bits for share in self.shares)

    @property
    def fixed_bits_per_second(self) -> float:
        """Of frames at a rate of their own."""
        return sum(share.fixed_hz * share.bits for share in self.shares)

    @property
    def share(self) -> float:
        """Of the bus that is taken [1]."""
        return (self.bits_per_cycle * self.cycle_hz + self.fixed_bits_per_second) / self.bitrate

    @property
    def fits(self) -> bool:
        return self.share <= CEILING

    @property
    def greatest_cycle_hz(self) -> int:
        """The greatest whole cycle rate that fits; 0: none does."""
        if self.bits_per_cycle <= 0.0:
            return 0
        left = CEILING * self.bitrate - self.fixed_bits_per_second
        # with RPDO1 as rarely as it ever comes it is no greater
        most = math.floor(left / sum(share.frames_at(GREATEST_HZ) * share.bits for share in self.shares))
        fitting = (hz for hz in range(most, 0, -1) if self.bits_at(hz) * hz <= left)
        return next(fitting, 0)

    @property
    def usual_cycle_hz(self) -> int:
        """The greatest rate that fits and whose period 60C2h can hold: a whole number of tenths of a
        millisecond; 0: none does."""
        rates = [hz for hz in range(1, self.greatest_cycle_hz + 1) if 10_000 % hz == 0]
        return max(rates, default=0)

    @property
    def buses_needed(self) -> int:
        """Over how many buses like this one the axes would have to be spread at this rate; 0: no number
        suffices."""
        for count in range(2, self.axes + 1):
            if self._spread(count) <= CEILING:
                return count
        return 0

    def axes_of(self, buses: int) -> int:
        """Axes on the fullest of so many buses."""
        return math.ceil(self.axes / buses)

    def _spread(self, buses: int) -> float:
        """Load of the fullest bus if the axes were spread evenly; what a bus has anyway stays."""
        part = self.axes_of(buses) / self.axes if self.axes else 1.0
        bits = 0.0
        for share in self.shares:
            whole = share.what in ("SYNC", "heartbeat of the master", "inputs", "outputs")
            rate = share.frames_at(self.cycle_hz) * self.cycle_hz + share.fixed_hz
            bits += rate * share.bits * (1.0 if whole else part)
        return bits / self.bitrate

    def arithmetic(self) -> str:
        """The sum in one line."""
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
    """The load of each bus that a drive of the machine is on."""
    loads = []
    for bus in machine.buses:
        axes = [axis for axis in machine.axes if axis.drive.bus == bus.name and axis.drive.node]
        axes = [axis for axis in axes if axis.drive.kind in ("cia402", "servosila")]
        nodes = [io_process_data(machine, bus.name, node) for node in nodes_on(machine, bus.name)]
        if axes or nodes:
            loads.append(load_of(bus, axes, machine.cycle_hz, nodes, _drive_io(machine, bus.name)))
    return tuple(loads)


def load_of(
    bus: CanBusConfig,
    axes: list[Axis],
    cycle_hz: float,
    nodes: Sequence[ProcessData] = (),
    besides: Sequence[Share] = (),
) -> BusLoad:
    """The load of one bus with these axes, all of them in velocity mode, which takes most.

    Args:
        nodes: the process data of its I/O nodes. besides: what its drives exchange besides motion.
    """
    servo = [axis for axis in axes if axis.drive.kind == "cia402"]
    streamed = [axis for axis in axes if axis.drive.kind == "servosila"]
    shares: list[Share] = []
    if servo:
        count = float(len(servo))
        shares += [
            Share("SYNC", 1.0, frame_bits(0)),
            *_commands(servo, cycle_hz),
            *besides,
            Share("TPDO1", count, frame_bits(_bytes(TPDO1))),
            Share("TPDO2", count / SLOW_SYNCS, frame_bits(_bytes(TPDO2))),
        ]
        beats = sum(1000.0 / axis.drive.heartbeat_ms for axis in servo if axis.drive.heartbeat_ms)
        shares += [
            Share("heartbeats", 0.0, frame_bits(1), beats),
            Share("heartbeat of the master", 0.0, frame_bits(1), MASTER_HEARTBEAT_HZ),
        ]
    if nodes and not servo:
        shares += [
            Share("SYNC", 1.0, frame_bits(0)),
            Share("heartbeat of the master", 0.0, frame_bits(1), MASTER_HEARTBEAT_HZ),
        ]
    for node in nodes:
        shares += [Share("inputs", 1.0, frame_bits(pdo.length)) for pdo in node.tpdos]
        shares += [Share("outputs", 1.0, frame_bits(pdo.length)) for pdo in node.rpdos]
        shares.append(Share("heartbeats", 0.0, frame_bits(1), 1000.0 / HEARTBEAT_MS))
    if streamed:
        shares.append(Share("commands", float(len(streamed)), frame_bits(SERVOSILA_BYTES)))
        every_cycle = sum(not axis.drive.telemetry_hz for axis in streamed)
        own_rate = sum(axis.drive.telemetry_hz for axis in streamed)
        shares.append(
            Share(
                "telemetry",
                float(SERVOSILA_TELEMETRY * every_cycle),
                frame_bits(SERVOSILA_BYTES),
                SERVOSILA_TELEMETRY * own_rate,
            )
        )
    return BusLoad(bus.name, cycle_hz, bus.bitrate, len(axes), tuple(shares))


def _drive_io(machine: Machine, bus: str) -> list[Share]:
    """60FDh and 60FEh of drives, each in a PDO of its own."""
    shares = []
    for what, objects in (
        ("inputs of drives", [each.source for each in machine.inputs]),
        ("outputs of drives", [each.target for each in machine.outputs]),
    ):
        axes = {each.axis for each in objects if each is not None and each.axis >= 0 and each.bus == bus}
        if axes:
            shares.append(Share(what, float(len(axes)), frame_bits(4)))
    return shares


def _commands(axes: Sequence[Axis], cycle_hz: float) -> list[Share]:
    """RPDOs; 60B2h and 6081h have no room beside mode and position, and go in some of their own."""
    profiled = float(sum(axis.profiled for axis in axes))
    streamed = float(len(axes)) - profiled
    offsets = float(sum(axis.drive.torque_offset for axis in axes))
    # one that is silent for longer than the shortest of these would make its drive act by itself
    timeouts = tuple(sorted({_timeouts_of(axis) for axis in axes}))
    every = (
        Share("RPDO2", streamed, frame_bits(_bytes(RPDO2))),
        Share("RPDO1 besides", streamed, frame_bits(_bytes(RPDO1)), timeouts_ms=timeouts, cycle_hz=cycle_hz),
        Share("RPDO1", profiled, frame_bits(_bytes(RPDO1))),
        Share("profile velocity", profiled, frame_bits(4)),
        Share("torque offset", offsets, frame_bits(2)),
    )
    return [share for share in every if share.frames]


def _timeouts_of(axis: Axis) -> tuple[float, float]:
    usual = TORQUE_TIMEOUT_MS if axis.drive.mode == "cst" else COMMAND_TIMEOUT_MS
    return float(axis.drive.command_timeout_ms), float(usual)


def refuse_overload(machine: Machine, source: str) -> None:
    """Refuse a machine whose cycle does not fit its buses.

    Raises:
        ConfigurationError: MC007, with the arithmetic and what would fit.
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
