"""A simulated CiA 402 drive on EtherCAT: the device of `Cia402Node` behind a slave controller."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import replace

from mcserver.can.cob import Function, NmtState
from mcserver.drive_sim.cia402_node import Cia402Node
from mcserver.drive_sim.described import Identity
from mcserver.drive_sim.dictionary import Entry, ObjectStore
from mcserver.drive_sim.ethercat.assignment import PdoAssignment
from mcserver.drive_sim.ethercat.controller import INPUTS, OUTPUTS, SlaveController
from mcserver.drive_sim.ethercat.mailbox import CoeMailbox
from mcserver.drive_sim.ethercat.registers import AlCode, AlState
from mcserver.drive_sim.ethercat.sii import MAILBOX_BYTES, eeprom_of
from mcserver.drive_sim.fault_injection import ETHERCAT_FAULTS, values_of
from mcserver.drive_sim.motor import Hardware
from mcserver.drive_sim.sdo_abort import Abort, SdoAbort

VENDOR_ID, PRODUCT_CODE, REVISION = 0x00000402, 0x0000402E, 1
_NMT = {
    AlState.INIT: NmtState.STOPPED,
    AlState.PREOP: NmtState.PRE_OPERATIONAL,
    AlState.SAFEOP: NmtState.PRE_OPERATIONAL,
    AlState.OP: NmtState.OPERATIONAL,
}


class EthercatDrive:
    """One drive; `mcserver.drive_sim.simulation.Node`.

    Args:
        node: its position on the bus, from 1. clock: [s].

    Attributes:
        controller: its end on the line. plugged: whether frames pass it.
        cut: the cable in front of it is open, and it has power. frames_lost: so many are still lost.
    """

    def __init__(
        self,
        node: int,
        hardware: Hardware,
        position: float,
        identity: Identity,
        clock: Callable[[], float],
    ) -> None:
        self.node = node
        self.plugged = True
        self.cut = False
        self.frames_lost = 0
        self._clock = clock
        identity = replace(
            identity,
            vendor_id=identity.vendor_id or VENDOR_ID,
            product_code=identity.product_code or PRODUCT_CODE,
            revision=identity.revision or REVISION,
        )
        self._device = Cia402Node(node, self._transmit, hardware, position, identity)
        self._assignment = PdoAssignment(self.store, lambda: self.controller.state is AlState.PREOP)
        self._mailbox = CoeMailbox(self, MAILBOX_BYTES, self._changed)
        self._outputs: list[tuple[Entry | None, struct.Struct]] = []
        self._inputs: list[tuple[Entry | None, struct.Struct]] = []
        self.controller = SlaveController(
            eeprom_of(identity, f"simulated drive {node}"), self, lambda: round(clock() * 1e9)
        )

    # ------------------------------------------------------------------ a node of the simulation

    @property
    def store(self) -> ObjectStore:
        """Its objects."""
        return self._device.store

    @property
    def booted(self) -> bool:
        return self._device.booted

    @property
    def wake(self) -> float:
        return self._device.wake

    def switch_on(self, now: float) -> None:
        self._device.switch_on(now)
        self._assignment.reset()
        self._mailbox.reset()
        self.controller.switch_on()

    def poll(self, now: float) -> None:
        self._device.poll(now)
        if self._device.booted and self._device.nmt.state is not _NMT[self.controller.state]:
            self._device.nmt.enter(_NMT[self.controller.state])
        self.controller.watch()

    def request(self, fault: str, request: Mapping[str, object], now: float) -> None:
        """A fault on demand.

        Raises:
            BadRequest: there is no such fault, or a value does not fit.
        """
        values = values_of(request, fault, ETHERCAT_FAULTS)
        if fault == "mute":
            self.controller.silent = True
        elif fault == "drop_sync":
            self.controller.deaf = int(values["syncs"])
        elif fault == "sdo_abort":
            subindex = None if values["subindex"] < 0 else int(values["subindex"])
            self._mailbox.refusals[int(values["index"]), subindex] = int(values["code"])
        elif fault == "sdo_delay":
            self._mailbox.held = True
        elif fault == "unplug":
            self.plugged = False
        elif fault == "cut":
            self.cut = True
        elif fault == "safe_op":
            self.controller.fail(AlState.SAFEOP, int(values["code"]))
        elif fault == "frame_loss":
            self.frames_lost = int(values["frames"])
        elif fault == "reboot":
            self.switch_on(now)
        else:
            if fault == "clear":
                self.controller.silent, self.controller.deaf = False, 0
                self._mailbox.refusals.clear()
                self._mailbox.held = self.cut = False
                if not self.plugged:
                    # what is plugged in has been without power
                    self.plugged = True
                    self.switch_on(now)
            self._device.request(fault, request, now)

    def describe(self) -> dict[str, object]:
        shown = self._device.describe()
        more = {
            "mute": self.controller.silent,
            "drop_sync": self.controller.deaf > 0,
            "sdo_abort": bool(self._mailbox.refusals),
            "sdo_delay": self._mailbox.held,
            "unplug": not self.plugged,
            "cut": self.cut,
        }
        del shown["nmt"]
        return {
            **shown,
            "al": self.controller.state.name,
            "al_error": self.controller.failed,
            "faults": [*shown["faults"], *(name for name, on in more.items() if on)],  # type: ignore[misc]
        }

    # ------------------------------------------------------------------ the application of its controller

    def refuse(self, state: AlState) -> AlCode:
        if state is AlState.SAFEOP:
            try:
                self._compile()
            except SdoAbort:
                return AlCode.INVALID_OUTPUTS
            for number, entries, code in (
                (OUTPUTS, self._outputs, AlCode.INVALID_OUTPUTS),
                (INPUTS, self._inputs, AlCode.INVALID_INPUTS),
            ):
                if self.controller.sync_manager(number).length != sum(each.size for _, each in entries):
                    return code
        return AlCode.NONE

    def enter(self, old: AlState, new: AlState) -> None:
        del old
        if new is AlState.INIT:
            self._mailbox.reset()
        if self._device.booted:
            self._device.nmt.enter(_NMT[new])

    def take(self, message: bytes) -> None:
        self._mailbox.request(message)

    def reply(self) -> bytes | None:
        return self._mailbox.reply()

    def exchange(self, outputs: bytes) -> bytes:
        now = self._clock()
        device, at = self._device, 0
        device.sample(now)
        for entry, packing in self._outputs if outputs else ():
            if entry is not None:
                (entry.value,) = packing.unpack_from(outputs, at)
            at += packing.size
        shown = b"".join(
            packing.pack(*(() if entry is None else (entry.value,))) for entry, packing in self._inputs
        )
        if outputs:
            device.obey(now)
        return shown

    # ------------------------------------------------------------------ objects for the mailbox

    def read(self, index: int, subindex: int) -> bytes:
        if self._assignment.has(index):
            return self._assignment.read(index, subindex)
        self._refuse_can(index)
        return self._device.store.read(index, subindex)

    def write(self, index: int, subindex: int, raw: bytes) -> None:
        if self._assignment.has(index):
            self._assignment.write(index, subindex, raw)
            return
        self._refuse_can(index)
        self._device.store.write(index, subindex, raw)

    def _changed(self) -> None:
        self._device.obey(self._clock())

    def _refuse_can(self, index: int) -> None:
        if index in (0x1005, 0x1014, 0x1016, 0x1017, 0x1029, 0x1200) or 0x1400 <= index < 0x1C00:
            raise SdoAbort(Abort.NO_OBJECT)

    def _compile(self) -> None:
        for target, entries in (
            (self._outputs, self._assignment.outputs()),
            (self._inputs, self._assignment.inputs()),
        ):
            target[:] = [
                (entry, struct.Struct("<x" if entry is None else f"<{entry.packing}")) for entry in entries
            ]

    def _transmit(self, identifier: int, payload: bytes) -> None:
        """What the device would send on CAN: emergency messages go by the mailbox."""
        if identifier == Function.EMCY + self.node:
            self._mailbox.emergency(payload)
