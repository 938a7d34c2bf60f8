"""Layer setting services (CiA 305): a node without a number gets one by its identity.

Switch state selective names vendor, product, revision and serial number; the node that has them all answers,
is given its number, stores it, and goes back to waiting, in which it boots with the number.
"""

from __future__ import annotations

import enum
import struct
import threading
from collections.abc import Callable

from mcserver.canopen.network import PortNetwork

MASTER_ID = 0x7E5
SLAVE_ID = 0x7E4
SELECT = (0x40, 0x41, 0x42, 0x43)
SELECTED = 0x44
SWITCH_GLOBAL = 0x04
CONFIGURE_NODE = 0x11
STORE = 0x17
WAITING = 0
ANSWER_S = 0.2
TRIES = 3
# Only one conversation at a time takes place on a bus: LSS answers have no sender.
_FRAME = struct.Struct("<BI3x")


class LssOutcome(enum.Enum):
    """What came of giving a node its number."""

    ASSIGNED = "assigned"
    ABSENT = "absent"  # no node without a number has this identity
    REFUSED = "refused"


Identity = tuple[int, int, int, int]


def identity_text(identity: Identity) -> str:
    """``vendor 0x11, product 0x22, revision 0x1, serial 0x5``."""
    names = ("vendor", "product", "revision", "serial")
    return ", ".join(f"{name} 0x{value:X}" for name, value in zip(names, identity, strict=True))


def assign_node_number(
    network: PortNetwork, identity: Identity, number: int, check: Callable[[], None] = lambda: None
) -> LssOutcome:
    """Give the node of that identity a number, and let it store it.

    Args:
        check: called before each wait; may raise to give up.
    """
    with network.lss_lock:
        conversation = _Conversation(network, check)
        try:
            if not any(conversation.select(identity) for _ in range(TRIES)):
                return LssOutcome.ABSENT
            answer = conversation.ask(bytes((CONFIGURE_NODE, number)), CONFIGURE_NODE)
            if answer is None or answer[1] != 0:
                return LssOutcome.REFUSED
            # a device that cannot store takes the number all the same, until it is switched off
            conversation.ask(bytes((STORE,)), STORE)
            return LssOutcome.ASSIGNED
        finally:
            conversation.end()


class _Conversation:
    def __init__(self, network: PortNetwork, check: Callable[[], None]) -> None:
        self._network = network
        self._check = check
        self._heard = threading.Condition()
        self._answers: list[bytes] = []
        network.handle(SLAVE_ID, self._on_answer)

    def select(self, identity: Identity) -> bool:
        """Switch state selective; whether the node with all four numbers answers."""
        self._answers.clear()
        for command, value in zip(SELECT[:-1], identity[:-1], strict=True):
            self._network.try_send(MASTER_ID, _FRAME.pack(command, value))
        return self._exchange(_FRAME.pack(SELECT[-1], identity[-1]), SELECTED) is not None

    def ask(self, request: bytes, answer: int) -> bytes | None:
        """One request; None where nobody answers."""
        self._answers.clear()
        return self._exchange(request.ljust(8, b"\x00"), answer)

    def end(self) -> None:
        """Everybody waits again: a node with a new number boots with it."""
        self._network.try_send(MASTER_ID, bytes((SWITCH_GLOBAL, WAITING)).ljust(8, b"\x00"))

    def _exchange(self, request: bytes, answer: int) -> bytes | None:
        self._check()
        self._network.try_send(MASTER_ID, request)
        with self._network.awaited(), self._heard:
            self._heard.wait_for(lambda: self._answer(answer) is not None, ANSWER_S)
            return self._answer(answer)

    def _answer(self, specifier: int) -> bytes | None:
        return next((each for each in self._answers if each[0] == specifier), None)

    def _on_answer(self, payload: bytes) -> None:
        if len(payload) == 8:
            with self._heard:
                self._answers.append(payload)
                del self._answers[:-8]
                self._heard.notify_all()
