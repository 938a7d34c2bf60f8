"""Boot-up of one node by CiA 302: found, identified, configured, started. Never energized."""

from __future__ import annotations

import threading
import time

from mcserver.can.cob import NMT, NmtCommand, NmtState
from mcserver.canopen.canopen_errors import DriveError, Stopped
from mcserver.canopen.lss import LssOutcome, assign_node_number, identity_text
from mcserver.canopen.network import PortNetwork
from mcserver.canopen.node import Node
from mcserver.drives.cia402.state import STATE_BITS, STATE_OF_BITS, Controlword, PowerState

# A reset is repeated after this time, then after twice as long, and so on: a slow drive must not be reset
# again while it boots [s].
FIRST_PATIENCE_S = 0.5
START_LIMIT_S = 2.0
CONTROLWORD, STATUSWORD = 0x6040, 0x6041
_UNHEARD = "check that it has power, its node number and the bit rate, and the bus's two terminators"


class NodeBoot:
    """Boots nodes of one bus, each in the calling thread.

    Args:
        stopping: set when the server stops; what waits ends soon then.
    """

    def __init__(self, network: PortNetwork, stopping: threading.Event) -> None:
        self._network = network
        self._stopping = stopping

    def find(self, node: Node) -> None:
        """Reset the node's communication, and wait until it has booted.

        Raises:
            DriveError: MC550 it does not appear in time. Stopped.
        """
        deadline = time.monotonic() + node.settings.appear_s
        patience = FIRST_PATIENCE_S
        if node.settings.lss is not None:
            self._give_number(node)
        before = node.boot_ups
        while True:
            self.check_stopping()
            streamed = node.settings.streamed
            if streamed is None:
                self._command(node, NmtCommand.RESET_COMMUNICATION)
            elif streamed.question is not None:
                self._network.try_send(*streamed.question)
            patience_end = min(deadline, time.monotonic() + patience)
            if self._appears(node, before, patience_end):
                return
            if time.monotonic() >= deadline:
                raise self._unheard(node)
            patience *= 2.0

    def wake(self, node: Node) -> None:
        """Bring a node that has stopped by an NMT command back to where it answers SDO.

        In the state stopped a node answers no SDO (CiA 301, 7.3.2.2): it is sent to pre-operational, and one
        that does not go there is reset.

        Raises:
            DriveError: MC555 neither helps. Stopped.
        """
        if node.nmt is not NmtState.STOPPED:
            return
        limit = node.silence_limit_s
        for command in (NmtCommand.ENTER_PRE_OPERATIONAL, NmtCommand.RESET_COMMUNICATION):
            self.check_stopping()
            self._command(node, command)
            node.wait(lambda: node.nmt is not NmtState.STOPPED or self._stopping.is_set(), limit)
            self.check_stopping()
            if node.nmt is not NmtState.STOPPED:
                return
            try:
                # without a heartbeat its answer is the only sign
                node.sdo.upload(0x1000, 0, attempts=1)
            except DriveError:
                continue
            node.nmt = None
            return
        raise node.settings.fault(
            "MC555",
            "stays in the NMT state stopped, whatever it is commanded",
            "see who commands it (another master on the bus?); switch it off and on",
        )

    def start(self, node: Node) -> None:
        """NMT start, and the heartbeat that confirms it.

        Raises:
            DriveError: MC555 it stays in another state. Stopped.
        """
        limit = node.silence_limit_s
        if not node.settings.heartbeat_ms:
            # its boot-up message is the last that it says of its state
            node.nmt = None
            self._command(node, NmtCommand.START)
            return
        deadline = time.monotonic() + max(START_LIMIT_S, 2.0 * limit)
        remarks: list[str] = []
        while time.monotonic() < deadline:
            self.check_stopping()
            node.nmt = None
            self._command(node, NmtCommand.START)
            node.wait(lambda: self._is_operational(node), min(limit, deadline - time.monotonic()))
            self.check_stopping()
            if node.nmt is NmtState.OPERATIONAL:
                node.remarks += tuple(dict.fromkeys(remarks))
                return
            if node.nmt is NmtState.PRE_OPERATIONAL:
                # a device may stay there while its error register is set (1029h): no PDO can reset it
                remarks += self._reset_faults(node)
        state = "silent" if node.nmt is None else node.nmt.name.lower().replace("_", "-")
        state += "".join(f"; {remark}" for remark in dict.fromkeys(remarks))
        emergency = node.emergency
        reason = f"; it sent the emergency {emergency.text}" if emergency and not emergency.cleared else ""
        raise node.settings.fault(
            "MC555",
            f"does not become operational: it is {state}{reason}",
            "take the cause of its fault away (the emergency's code is in the drive's manual): it is tried "
            "again, and G1000 resets the axis then"
            if reason
            else "its heartbeat (1017h) and its own fault memory may say why; try switching it off and on",
        )

    # ------------------------------------------------------------ inside

    def _reset_faults(self, node: Node) -> list[str]:
        """Reset the faults of a node's drives by SDO, without energy; return what was found, in words.

        The axis itself stays faulted until it is reset (G1000).
        """
        found = []
        for axis in node.axes:
            if axis.settings.kind != "cia402":
                continue
            offset = axis.settings.offset
            try:
                word = int.from_bytes(node.sdo.upload(STATUSWORD + offset, 0)[:2], "little")
                if STATE_OF_BITS[word & STATE_BITS] is not PowerState.FAULT:
                    continue
                # a rising edge of bit 7, which falls again for the next one
                for controlword in (
                    Controlword.DISABLE_VOLTAGE,
                    Controlword.FAULT_RESET,
                    Controlword.DISABLE_VOLTAGE,
                ):
                    node.sdo.download(CONTROLWORD + offset, 0, int(controlword).to_bytes(2, "little"))
                word = int.from_bytes(node.sdo.upload(STATUSWORD + offset, 0)[:2], "little")
            except DriveError as error:
                found.append(f"its fault cannot be reset by SDO: {error.message}")
                continue
            after = STATE_OF_BITS[word & STATE_BITS]
            shown = (
                "its fault was reset" if after is not PowerState.FAULT else "its fault stays after a reset"
            )
            found.append(f"{shown} by SDO (6040h)")
        return found

    def _give_number(self, node: Node) -> None:
        identity = node.settings.lss
        assert identity is not None
        outcome = assign_node_number(self._network, identity, node.settings.node, self.check_stopping)
        if outcome is not LssOutcome.REFUSED:
            # one that nobody answers to may have its number already
            return
        raise node.settings.fault(
            "MC550",
            f"the node {identity_text(identity)} refuses this number by LSS",
            "give another node number, or set it with the maker's tool",
        )

    def _is_operational(self, node: Node) -> bool:
        return node.nmt is NmtState.OPERATIONAL or self._stopping.is_set()

    def _appears(self, node: Node, boot_ups_before: int, until: float) -> bool:
        """Return whether a boot-up message comes, or an answer: some devices send no such message."""

        def heard() -> bool:
            if self._stopping.is_set():
                return True
            if not node.settings.has_profile:
                return node.seen_at is not None
            return node.boot_ups != boot_ups_before

        if node.wait(heard, max(0.0, until - time.monotonic())):
            self.check_stopping()
            return True
        if not node.settings.has_profile:
            return False
        try:
            node.sdo.upload(0x1000, 0, attempts=1)
        except DriveError:
            return False
        return True

    def _command(self, node: Node, command: NmtCommand) -> None:
        # a lost command is repeated by whoever waits for its effect
        self._network.try_send(NMT, bytes((command, node.settings.node)))

    def check_stopping(self) -> None:
        """Raise `Stopped` once the server stops."""
        if self._stopping.is_set():
            raise Stopped

    def _unheard(self, node: Node) -> DriveError:
        what = (
            "does not answer: neither boot-up message nor SDO"
            if node.settings.has_profile
            else "sends no telemetry"
        )
        return node.settings.fault("MC550", f"{what} within {node.settings.appear_s:g} s", _UNHEARD)
