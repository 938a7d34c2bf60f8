"""One drive by SDO, without a server: only where nobody else is master of its bus, and nothing is moved.

A bus has one master. A running server shows itself by its heartbeat every 50 ms, other masters by SYNC, NMT,
SDO requests or commands: where any is heard, before the first frame or later, nothing more is sent (MC560).
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from mcserver.can.open import open_port
from mcserver.canopen.bus_frames import wait_for_frames
from mcserver.canopen.canopen_errors import DriveError
from mcserver.canopen.listening import Listening, for_masters, refuse_other_masters, sign_of_master
from mcserver.canopen.network import PortNetwork
from mcserver.canopen.node_configuration import SdoClient
from mcserver.canopen.parameters import Parameter, encode
from mcserver.canopen.reachable_drives import moves_by_sdo
from mcserver.canopen.sdo import NodeSdo
from mcserver.canopen.settings import STORING, DriveSettings
from mcserver.canopen.values import Value, decode_value
from mcserver.drives.cia402.state import POWERED, power_state
from mcserver.errors import RuntimeFault

# Five heartbeats of a server, whatever the machine file says of listening [s].
LEAST_LISTEN_S = 0.25
STATUSWORD, STORE = 0x6041, 0x1010
# "save" in the order of the wire (CiA 301, 7.5.2.13).
SAVE = b"save"
_REMEDY = (
    "stop the server or the other master first; a running server's drives are read by `mcctl sdo read AXIS "
    "OBJECT`, and watched by `mcserver drives health` and `scope`"
)


@dataclass(frozen=True)
class Reading:
    """A parameter's value; ``kind`` is "bytes" where the drive's length is not that of the EDS's type."""

    parameter: Parameter
    kind: str
    value: Value
    raw: bytes


class Desk:
    """A drive's parameters; made by `at_desk`.

    Args:
        check: raises RuntimeFault MC560 where anybody else has become master of the bus.
    """

    def __init__(self, drive: DriveSettings, sdo: SdoClient, check: Callable[[], None]) -> None:
        self.drive = drive
        self._sdo = sdo
        self._check = check

    def read(self, parameter: Parameter) -> Reading:
        """Read a parameter.

        Raises:
            DriveError: MC553 the drive refuses, MC554 no answer. RuntimeFault: MC560 another master came.
        """
        self._check()
        raw = self._sdo.upload(*parameter.place)
        self._check()
        try:
            return Reading(parameter, parameter.type, decode_value(parameter.type, raw), raw)
        except ValueError:
            # the EDS is wrong about its length, or it is no text: the bytes are right
            return Reading(parameter, "bytes", decode_value("bytes", raw), raw)

    def read_number(self, index: int, subindex: int = 0) -> int | None:
        """Return an unsigned number; None where the drive refuses it.

        Raises:
            DriveError: MC554. RuntimeFault: MC560.
        """
        self._check()
        try:
            return int.from_bytes(self._sdo.upload(index, subindex)[:8], "little")
        except DriveError as error:
            if error.code != "MC553":
                raise
            return None

    def write(self, parameter: Parameter, value: Value) -> Reading:
        """Write a parameter and read it back; where it is not to be read, the reading has what was written.

        Raises:
            UsageFault: MC559 as `encode`.
            DriveError: MC553, MC554; MC559 it would move the drive, the drive is energized, or it holds
                another value afterwards.
            RuntimeFault: MC560.
        """
        raw = encode(parameter, value)
        if moves_by_sdo(parameter.index):
            raise self._refusal(
                f"{parameter.title} is not written: it commands motion, or a brake",
                "move the axis by a program, or by jog; outputs are switched by programs",
            )
        if parameter.index in STORING:
            raise self._refusal(
                f"{parameter.title} is no parameter, but a command", "`mcserver drives save AXIS` stores"
            )
        self.refuse_energized()
        self._sdo.download(*parameter.place, raw)
        if not parameter.readable:
            return Reading(parameter, parameter.type, decode_value(parameter.type, raw), raw)
        reading = self.read(parameter)
        if _unfilled(parameter, reading.raw) != _unfilled(parameter, raw):
            written = decode_value(parameter.type, raw)
            raise self._refusal(
                f"{parameter.title} holds {reading.value} after {written} was written",
                "the drive rounds or bounds it, or another parameter decides: see its manual",
            )
        return reading

    def save(self) -> None:
        """Store all parameters in the drive (1010h:01).

        Raises:
            DriveError: MC553 the drive does not store, MC554 no answer, MC559 it is energized.
            RuntimeFault: MC560.
        """
        self.refuse_energized()
        self._sdo.download(STORE, 1, SAVE)

    def line_errors(self) -> dict[str, list[int]]:
        """Damaged frames and lost links that the drive has counted itself, by port; empty: it does not."""
        return {}

    def refuse_energized(self) -> None:
        """Raise unless the drive is without energy, by its own statusword; DriveError: MC559, MC554."""
        word = self.read_number(STATUSWORD + self.drive.offset)
        if word is None:
            raise self._refusal("its statusword (6041h) cannot be read", "see whether it is a CiA 402 drive")
        state = power_state(word)
        if state in POWERED:
            raise self._refusal(
                f"is {state.name.lower().replace('_', ' ')}: nothing is written to an energized drive",
                "switch it off first, in whatever energized it",
            )

    def _refusal(self, what: str, remedy: str) -> DriveError:
        return self.drive.fault("MC559", what, remedy)


def _unfilled(parameter: Parameter, raw: bytes) -> bytes:
    """Return bytes without the zeros by which a drive fills up a text."""
    return raw.rstrip(b"\0") if parameter.type in ("str", "utf16") else raw


class _Watch:
    """Signs of another master that come while the desk is at work."""

    def __init__(self, bus: Listening) -> None:
        self._bus = bus
        self.sign = ""

    def observe(self, identifier: int, _payload: bytes) -> None:
        self.sign = self.sign or sign_of_master(identifier, self._bus)

    def check(self) -> None:
        """Raise RuntimeFault MC560 once a sign has come."""
        if self.sign:
            raise RuntimeFault(
                "MC560", f"another master came to bus {self._bus.name}: {self.sign}; no more is sent", _REMEDY
            )


@contextmanager
def at_desk(drive: DriveSettings) -> Iterator[Desk]:
    """Open the drive's bus, listen whether anybody else is its master, and give the drive's desk.

    Nothing is reset, started or configured; the node stays in the NMT state in which it is.

    Raises:
        ConfigurationError: MC009 the address. RuntimeFault: MC424 the bus, MC560 another master.
        DriveError: MC559 a drive without the standard's SDO.
    """
    if drive.kind != "cia402":
        raise drive.fault("MC559", f"is {drive.kind}, not CiA 402", "use its maker's own tool")
    port = open_port(drive.address)
    bus = for_masters(drive, port)
    try:
        refuse_other_masters([bus], max(LEAST_LISTEN_S, drive.listen_s))
    except BaseException as error:
        port.close()
        if isinstance(error, RuntimeFault):
            raise RuntimeFault(error.code, error.message, _REMEDY, axis=drive.axis) from None
        raise
    watch = _Watch(bus)
    network = PortNetwork(port)
    network.observe(watch.observe)
    # a time-out is said once, by its drive and object
    library = logging.getLogger("canopen.sdo")
    before = library.level
    library.setLevel(logging.CRITICAL)
    stopping = threading.Event()
    thread = threading.Thread(target=_receive, args=(network, stopping), name="desk", daemon=True)
    thread.start()
    try:
        yield Desk(drive, NodeSdo(network, drive), watch.check)
    finally:
        stopping.set()
        thread.join()
        network.disconnect()
        library.setLevel(before)


def _receive(network: PortNetwork, stopping: threading.Event) -> None:
    while not stopping.is_set():
        wait_for_frames(network, stopping.wait)
        network.receive()
