"""Boot-up of one node by CiA 302: found, identified, configured, started. Never energized."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass

from mcserver.can.cob import NMT, NmtCommand, NmtState
from mcserver.canopen.abort_codes import ABSENT
from mcserver.canopen.canopen_errors import DriveError, Stopped, object_text
from mcserver.canopen.configuration import SdoWrite
from mcserver.canopen.network import PortNetwork
from mcserver.canopen.node import Identity, Node
from mcserver.canopen.sdo import NodeSdo

CIA_402 = 402
# A reset is repeated after this time, then after twice as long, and so on: a slow drive must not be reset
# again while it boots [s].
FIRST_PATIENCE_S = 0.5
START_LIMIT_S = 2.0
_UNHEARD = "check that it has power, its node number and the bit rate, and the bus's two terminators"


@dataclass(frozen=True)
class BootTimes:
    """How long a node may take [s]: to appear, and to become operational."""

    appear_s: float = 10.0
    start_s: float = START_LIMIT_S


class NodeBoot:
    """Boots nodes of one bus, each in the calling thread.

    Args:
        stopping: set when the server stops; what waits ends soon then.
    """

    def __init__(self, network: PortNetwork, times: BootTimes, stopping: threading.Event) -> None:
        self._network = network
        self._times = times
        self._stopping = stopping

    def find(self, node: Node) -> None:
        """Resets the node's communication, and waits until it has booted.

        Raises:
            DriveError: MC550 it does not appear in time. Stopped.
        """
        deadline = time.monotonic() + self._times.appear_s
        patience = FIRST_PATIENCE_S
        before = node.boot_ups
        while True:
            self._check_stopping()
            if node.sdo is not None:
                self._command(node, NmtCommand.RESET_COMMUNICATION)
            patience_end = min(deadline, time.monotonic() + patience)
            if self._appears(node, before, patience_end):
                return
            if time.monotonic() >= deadline:
                raise self._unheard(node)
            patience *= 2.0

    def configure(self, node: Node, sdo: NodeSdo, writes: Sequence[SdoWrite]) -> None:
        """Checks who it is, and writes its configuration.

        Raises:
            DriveError: MC551 it is another device, MC553, MC554. Stopped.
        """
        node.identity = self._identify(node, sdo)
        remarks = []
        for write in writes:
            self._check_stopping()
            try:
                sdo.download(write.index, write.subindex, write.payload)
            except DriveError as error:
                if not (write.optional and error.details.get("abort_code") in ABSENT):
                    raise DriveError(
                        error.code,
                        f"{error.message} ({write.what})",
                        error.hint,
                        axis=node.settings.axis,
                        **error.details,
                    ) from None
                remarks.append(f"{object_text(write.index, write.subindex)} is not there: no {write.what}")
        node.remarks = tuple(remarks)

    def start(self, node: Node) -> None:
        """NMT start, and the heartbeat that confirms it.

        Raises:
            DriveError: MC555 it stays in another state. Stopped.
        """
        limit = node.silence_limit_s
        if limit is None:
            # its boot-up message is the last that it says of its state
            node.nmt = None
            self._command(node, NmtCommand.START)
            return
        deadline = time.monotonic() + max(self._times.start_s, 2.0 * limit)
        while time.monotonic() < deadline:
            self._check_stopping()
            node.nmt = None
            self._command(node, NmtCommand.START)
            node.wait(lambda: self._is_operational(node), min(limit, deadline - time.monotonic()))
            self._check_stopping()
            if node.nmt is NmtState.OPERATIONAL:
                return
        state = "silent" if node.nmt is None else node.nmt.name.lower().replace("_", "-")
        raise DriveError(
            "MC555",
            f"{node.settings.name}: does not become operational: it is {state}",
            "its heartbeat (1017h) and its own fault memory may say why; try switching it off and on",
            axis=node.settings.axis,
        )

    # ------------------------------------------------------------ inside

    def _is_operational(self, node: Node) -> bool:
        return node.nmt is NmtState.OPERATIONAL or self._stopping.is_set()

    def _appears(self, node: Node, boot_ups_before: int, until: float) -> bool:
        """Whether a boot-up message comes, or an answer: some devices send no such message."""

        def heard() -> bool:
            if self._stopping.is_set():
                return True
            return node.seen_at is not None if node.sdo is None else node.boot_ups != boot_ups_before

        if node.wait(heard, max(0.0, until - time.monotonic())):
            self._check_stopping()
            return True
        if node.sdo is None:
            return False
        try:
            node.sdo.upload(0x1000, 0, attempts=1)
        except DriveError:
            return False
        return True

    def _identify(self, node: Node, sdo: NodeSdo) -> Identity:
        settings = node.settings
        device_type = int.from_bytes(sdo.upload(0x1000, 0)[:4], "little")
        if device_type & 0xFFFF != CIA_402:
            raise DriveError(
                "MC551",
                f"{settings.name}: 1000h says device profile {device_type & 0xFFFF}, a drive has {CIA_402}",
                "check the node number, or the drive's configured profile",
                axis=settings.axis,
            )
        vendor, product = (self._identity_entry(sdo, subindex) for subindex in (1, 2))
        for subindex, what, wanted, found in (
            (1, "vendor_id", settings.vendor_id, vendor),
            (2, "product_code", settings.product_code, product),
        ):
            if wanted and found != wanted:
                shown = "nothing" if found is None else f"0x{found:08X}"
                raise DriveError(
                    "MC551",
                    f"{settings.name}: {object_text(0x1018, subindex)} says {shown}, the machine file "
                    f"{what} = 0x{wanted:08X}",
                    "another drive has this node number, or the machine file is not of this machine",
                    axis=settings.axis,
                )
        return Identity(device_type, vendor, product)

    def _identity_entry(self, sdo: NodeSdo, subindex: int) -> int | None:
        try:
            return int.from_bytes(sdo.upload(0x1018, subindex)[:4], "little")
        except DriveError as error:
            if error.details.get("abort_code") in ABSENT:
                return None
            raise

    def _command(self, node: Node, command: NmtCommand) -> None:
        # a lost command is repeated by whoever waits for its effect
        self._network.try_send(NMT, bytes((command, node.settings.node)))

    def _check_stopping(self) -> None:
        if self._stopping.is_set():
            raise Stopped

    def _unheard(self, node: Node) -> DriveError:
        what = (
            "sends no telemetry" if node.sdo is None else "does not answer: neither boot-up message nor SDO"
        )
        return DriveError(
            "MC550",
            f"{node.settings.name}: {what} within {self._times.appear_s:g} s",
            _UNHEARD,
            axis=node.settings.axis,
        )
