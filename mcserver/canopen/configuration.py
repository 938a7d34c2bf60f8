"""What is written into a drive at boot-up, as a list: from the machine file, the cycle and the dictionary."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

from canopen.objectdictionary import ObjectDictionaryError, ODVariable

from mcserver.can.cob import SYNC, Function
from mcserver.can.pdo_layout import Mode
from mcserver.canopen.canopen_errors import object_text
from mcserver.canopen.dictionary import DeviceDictionary
from mcserver.canopen.process_data import INVALID, PlannedProcessData, plan_process_data
from mcserver.canopen.sdo_write import DriveDictionary, SdoWrite, unsigned32
from mcserver.canopen.settings import AXIS_OFFSET, DriveSettings
from mcserver.errors import ConfigurationError

# On EtherCAT they end with the assignments of PDOs to sync managers (ETG.1000.6).
PDO_OBJECTS = range(0x1400, 0x1C30)
# What else follows from the machine file: watching, command, mode, targets, scaling, cycle.
OWN_OBJECTS = frozenset(
    {0x1016, 0x1017, 0x6040, 0x6060, 0x6071, 0x607A, 0x608F, 0x6091, 0x6092, 0x60C1, 0x60C2, 0x60FF}
)
# Communication that belongs to the network's master: SYNC, time stamps, node guarding, emergency messages,
# store commands, and what an NMT master or a commissioning tool keeps (CiA 301, CiA 302).
MASTER_OBJECTS = frozenset(
    {
        *(0x1005, 0x1006, 0x1007, 0x100B, 0x100C, 0x100D, 0x1010, 0x1011, 0x1012, 0x1013, 0x1014, 0x1015),
        *(0x1019, 0x1020, 0x1028),
        *range(0x1200, 0x1300),
        *range(0x1F00, 0x2000),
    }
)
# Objects of the maker that hold the node's own number or the bit rate, by their names.
_ADDRESSING = re.compile(r"\bnode[ _-]?(id|number|address)|\b(bit|baud)[ _-]?rate|^can (id|address)\b", re.I)
# The drive gives up on a master that is silent for so long [ms].
MASTER_HEARTBEAT_TIMEOUT_MS = 1000
# 6007h: what a drive does when communication is lost (CiA 402: 3 = quick stop), and what serves nearly as
# well where it has no such option: 2 = disable voltage, 1 = fault.
QUICK_STOP_ON_LOSS = 3
_STOPS_ON_LOSS = (2, 1)
# Exponents of 60C2h, those of most drives first: some take milliseconds alone.
_EXPONENTS = (-3, -4, -5, -6, -2, -1, 0)
_NO_HEARTBEAT = (
    "set heartbeat_ms = 0, and the drive is watched by its process data, or to a time that it takes; "
    "check `eds`"
)
_OTHER_CYCLE = (
    "the drive does not take this cycle; cycle_hz = 1000, 500, 250, 200, 125 and 100 are whole milliseconds, "
    "which most drives take"
)
ENCODER, FEED = 0x608F, 0x6092
_OTHER_ENCODER = (
    "the machine file has another encoder, and the drive lets neither be set (608Fh, 6092h): move the axis "
    "by a little and measure it before anything else"
)
# A cycle that 60C2h says less exactly than this would make the drive interpolate to another time.
_CYCLE_ACCURACY = 1e-4
# Bits of 6502h: which modes a drive has (CiA 402).
MODE_BITS = {
    0: ("pp", "profile position"),
    2: ("pv", "profile velocity"),
    3: ("tq", "profile torque"),
    5: ("hm", "homing"),
    6: ("ip", "interpolated position"),
    7: ("csp", "cyclic synchronous position"),
    8: ("csv", "cyclic synchronous velocity"),
    9: ("cst", "cyclic synchronous torque"),
}
_BIT_OF_MODE = {
    Mode.CYCLIC_POSITION: 7,
    Mode.CYCLIC_VELOCITY: 8,
    Mode.INTERPOLATED_POSITION: 6,
    Mode.PROFILE_POSITION: 0,
    Mode.CYCLIC_TORQUE: 9,
}
# without these the drive's own profiles would not keep the axis's limits
_PROFILE_NEEDS = frozenset({0x6081, 0x6083})
# in the order in which they serve an axis best
USABLE_MODES = ("csp", "csv", "ip", "cst", "pp")


def configuration_writes(
    drive: DriveSettings, cycle_s: float, dictionary: DeviceDictionary, master: int
) -> list[SdoWrite]:
    """As `configure`, the writes alone."""
    return configure(drive, cycle_s, dictionary, master)[0]


def configure(
    drive: DriveSettings, cycle_s: float, dictionary: DeviceDictionary, master: int
) -> tuple[list[SdoWrite], PlannedProcessData]:
    """List everything to write into one CiA 402 drive between pre-operational and operational, in order.

    Args:
        cycle_s: time between two SYNCs [s]. dictionary: of an EDS, or the generic one.
        master: node of the heartbeat that the drive watches.

    Raises:
        ConfigurationError: MC552 the drive has no place for what has to be written.
    """
    known = DriveDictionary(drive, dictionary)
    _refuse_mode(drive, known)
    writer = _Writer(drive, known)
    planned = plan_process_data(known)
    first = drive.node_axis == 0
    return [
        *(writer.dcf(cycle_s) if first else ()),
        *(writer.communication() if first else ()),
        *(writer.heartbeats(master) if first else ()),
        *planned.writes,
        *writer.profile(cycle_s),
        *writer.extra(),
    ], planned


def application_writes(drive: DriveSettings, cycle_s: float, known: DriveDictionary) -> list[SdoWrite]:
    """List what is written of a drive's application, whatever bus it is on, in order.

    Raises:
        ConfigurationError: MC552 the drive has no place for it.
    """
    _refuse_mode(drive, known)
    writer = _Writer(drive, known)
    return [*writer.dcf(cycle_s), *writer.profile(cycle_s), *writer.extra()]


def _refuse_mode(drive: DriveSettings, known: DriveDictionary) -> None:
    supported = known.default(0x6502 + drive.offset)
    refusal = mode_refusal(drive, supported) if supported else None
    if refusal is not None:
        raise known.no_place(0x6502 + drive.offset, 0, *refusal)


def mode_refusal(drive: DriveSettings, supported: int) -> tuple[str, str] | None:
    """Compare the mode with 6502h: what is wrong and what to do; None where the drive has it.

    Args:
        supported: 6502h.
    """
    bit = _BIT_OF_MODE[Mode(drive.mode)]
    if supported >> bit & 1:
        return None
    has = [short for each, (short, _) in MODE_BITS.items() if supported >> each & 1]
    usable = [short for short in USABLE_MODES if short in has]
    remedy = (
        " or ".join(f'set mode = "{short}"' for short in usable)
        if usable
        else "this server needs csp, csv, ip, cst or pp: ask the maker for a firmware that has one of them"
    )
    return (
        f"the drive has no {MODE_BITS[bit][1]}; it has {', '.join(has) or 'no mode of the standard'}",
        remedy,
    )


def interpolation_period(cycle_s: float) -> tuple[int, int]:
    """60C2h: (mantissa 1 … 255, exponent) with mantissa · 10^exponent = cycle [s] (CiA 402).

    Raises:
        ConfigurationError: MC552 no such pair gives the cycle.
    """
    for exponent in _EXPONENTS:
        mantissa = round(cycle_s * 10.0**-exponent)
        if 1 <= mantissa <= 255 and abs(mantissa * 10.0**exponent / cycle_s - 1.0) < _CYCLE_ACCURACY:
            return mantissa, exponent
    raise ConfigurationError(
        "MC552",
        f"drives cannot take a cycle of {cycle_s * 1e3:.6g} ms: 60C2h holds 1 … 255 times a power of ten",
        "set cycle_hz = 100, 125, 200, 250, 400, 500 or 1000",
    )


def of_first_axis(index: int) -> int:
    """Return the object of a node's first axis that an object of another axis stands for."""
    return 0x6000 + (index - 0x6000) % AXIS_OFFSET if 0x6000 <= index < 0xA000 else index


def is_own_parameter(index: int, name: str) -> bool:
    """Whether an object is the drive's own: neither what follows from the machine file, nor of process data,
    nor the network master's, nor the node's address.

    Args:
        name: of the object, a member's behind its record's.
    """
    return (
        index >= 0x1000
        and index not in PDO_OBJECTS
        and index not in MASTER_OBJECTS
        and of_first_axis(index) not in OWN_OBJECTS
        and not any(_ADDRESSING.search(part) for part in (name, *name.split(".")))
    )


class _Writer:
    def __init__(self, drive: DriveSettings, dictionary: DriveDictionary) -> None:
        self._drive = drive
        self._dictionary = dictionary

    def dcf(self, cycle_s: float) -> Iterator[SdoWrite]:
        """Values of a DCF, but for those of communication, which the master arranges, and of addressing."""
        for variable in self._dictionary.objects.variables:
            index = variable.index
            if variable.value is None or not variable.writable:
                continue
            if index in MASTER_OBJECTS:
                yield from self._of_master(index, cycle_s)
            elif is_own_parameter(index, variable.qualname):
                what = f"{variable.name} of the DCF"
                yield SdoWrite(index, variable.subindex, self._payload(variable), what)

    def communication(self) -> Iterator[SdoWrite]:
        """SYNC is consumed and never produced; emergency messages name their sender by the COB-ID."""
        for index, cob, what in (
            (0x1005, SYNC, "COB-ID of SYNC"),
            (0x1014, Function.EMCY + self._drive.node, "COB-ID of emergency messages"),
        ):
            if not self._dictionary.writable(index):
                continue
            wanted = unsigned32(cob)
            if index == 0x1014:
                off = unsigned32(INVALID | cob)
                yield SdoWrite(index, 0, off, f"{what}, off", optional=True, unless=wanted)
            yield SdoWrite(index, 0, wanted, what, optional=True, unless=wanted)

    def heartbeats(self, master: int) -> Iterator[SdoWrite]:
        what = "heartbeat time [ms]"
        if not self._drive.heartbeat_ms:
            # a device without one is as silent as it shall be
            yield from self._dictionary.if_there(0x1017, 0, 0, what)
        elif not self._dictionary.has(0x1017):
            raise self._dictionary.no_place(
                0x1017,
                0,
                "the EDS has no heartbeat",
                _NO_HEARTBEAT,
            )
        else:
            write = self._dictionary.number(0x1017, 0, self._drive.heartbeat_ms, what)
            yield replace(write, remedy=_NO_HEARTBEAT)
        watched = master << 16 | MASTER_HEARTBEAT_TIMEOUT_MS
        yield from self._dictionary.if_there(0x1016, 1, watched, "heartbeat of the master to watch")

    def profile(self, cycle_s: float) -> Iterator[SdoWrite]:
        drive, known, offset = self._drive, self._dictionary, self._drive.offset
        yield from self._on_loss(0x6007 + offset)
        for index, subindex, value in drive.scaling:
            yield from known.if_there(index + offset, subindex, value, "scaling to increments")
        yield from self._fixed_encoder()
        if drive.mode != Mode.PROFILE_POSITION:
            mantissa, exponent = interpolation_period(cycle_s)
            for write in (
                *known.if_there(0x60C2 + offset, 1, mantissa, "interpolation time"),
                *known.if_there(0x60C2 + offset, 2, exponent, "interpolation time, power of ten"),
            ):
                yield replace(write, remedy=_OTHER_CYCLE)
        for index, subindex, value in drive.homing:
            yield known.number(index + offset, subindex, value, "homing by the drive")
        for index, subindex, value in drive.profile:
            if index in _PROFILE_NEEDS:
                yield known.number(index + offset, subindex, value, "profile of the drive")
            else:
                yield from known.if_there(index + offset, subindex, value, "profile of the drive")
        if drive.outputs:
            yield from known.if_there(0x60FE + offset, 2, drive.outputs, "outputs that are switched")
        yield known.number(0x6060 + offset, 0, drive.mode, "mode of operation")

    def _fixed_encoder(self) -> Iterator[SdoWrite]:
        """Compare an encoder that nobody can set: without a feed constant its increments may be the units."""
        known, offset = self._dictionary, self._drive.offset
        if known.writable(FEED + offset, 1) or known.writable(ENCODER + offset, 1):
            return
        for index, subindex, value in self._drive.scaling:
            if index == ENCODER and known.has(index + offset, subindex):
                write = known.number(
                    index + offset, subindex, value, "increments of the encoder", optional=True
                )
                yield replace(write, verify=True, doubt=_OTHER_ENCODER)

    def _on_loss(self, index: int) -> Iterator[SdoWrite]:
        what = "what to do when the master is silent"
        for write in self._dictionary.if_there(index, 0, QUICK_STOP_ON_LOSS, what):
            length = len(write.payload)
            yield replace(write, instead=tuple(value.to_bytes(length, "little") for value in _STOPS_ON_LOSS))

    def extra(self) -> Iterator[SdoWrite]:
        for write in self._drive.sdo_writes:
            index, subindex, value = write[:3]
            name = f"sdo_writes {object_text(index, subindex)}"
            if index in PDO_OBJECTS or of_first_axis(index) in OWN_OBJECTS or index == 0x1014:
                raise self._dictionary.no_place(
                    index,
                    subindex,
                    "sdo_writes names it, but this server writes it itself",
                    "take it out; what it holds follows from the other keys of the machine file",
                )
            if len(write) > 3:
                yield SdoWrite(index, subindex, self._sized(index, subindex, value, write[3]), name)
            else:
                yield self._dictionary.number(index, subindex, value, name)

    # ------------------------------------------------------------ inside

    def _of_master(self, index: int, cycle_s: float) -> Iterator[SdoWrite]:
        """A DCF wants one of the master's objects: it gets the master's value, or none."""
        if index == 0x1006:
            yield from self._dictionary.if_there(index, 0, round(cycle_s * 1e6), "period of SYNC [us]")
        elif index in (0x100C, 0x100D):
            yield from self._dictionary.if_there(index, 0, 0, "node guarding off: heartbeats are used")

    def _payload(self, variable: ODVariable) -> bytes:
        assert variable.value is not None
        try:
            return bytes(variable.encode_raw(variable.value))
        except (ValueError, TypeError, ObjectDictionaryError) as error:
            raise self._dictionary.no_place(
                variable.index,
                variable.subindex,
                f"the ParameterValue {variable.value!r} is no value of its type: {error}",
                "correct it in the DCF",
            ) from error

    def _sized(self, index: int, subindex: int, value: int, length: int) -> bytes:
        try:
            return value.to_bytes(length, "little", signed=value < 0)
        except (OverflowError, ValueError) as error:
            raise self._dictionary.no_place(
                index, subindex, f"{value} has no room in {length} bytes", "give a longer length"
            ) from error
