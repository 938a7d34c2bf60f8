"""Node numbers by layer setting services (CiA 305)."""

from __future__ import annotations

import struct
import threading
from collections.abc import Iterator

import pytest

from mcserver.can.open import open_port
from mcserver.can.port import CanPort
from mcserver.canopen.lss import LssOutcome, assign_node_number, identity_text
from mcserver.canopen.network import PortNetwork
from tests.canopen.rig import RunningHub

IDENTITY = (0x11, 0x22, 1, 5)


class Unnumbered:
    """A node without a number that is in the state waiting, and obeys CiA 305."""

    def __init__(self, port: CanPort, identity: tuple[int, int, int, int] = IDENTITY) -> None:
        self.number = 0xFF
        self.stored = False
        self.refuses = False
        self._port = port
        self._identity = identity
        self._matched = 0
        self._selected = False
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stopping.set()
        self._thread.join(5.0)
        self._port.close()

    def _run(self) -> None:
        while not self._stopping.wait(0.002):
            for identifier, payload in self._port.drain():
                if identifier == 0x7E5:
                    self._obey(payload)

    def _obey(self, payload: bytes) -> None:
        command = payload[0]
        if 0x40 <= command <= 0x43:
            place = command - 0x40
            (value,) = struct.unpack_from("<I", payload, 1)
            if place == 0:
                self._matched = 0
            self._matched += value == self._identity[place] and self._matched == place
            if place == 3 and self._matched == 4:
                self._selected = True
                self._say(bytes((0x44,)))
        elif command == 0x04:
            self._selected = payload[1] == 1
        elif self._selected and command == 0x11:
            if not self.refuses:
                self.number = payload[1]
            self._say(bytes((0x11, int(self.refuses), 0)))
        elif self._selected and command == 0x17:
            self.stored = True
            self._say(bytes((0x17, 0, 0)))

    def _say(self, payload: bytes) -> None:
        self._port.send(0x7E4, payload.ljust(8, b"\x00"))


@pytest.fixture
def node(hub: RunningHub) -> Iterator[Unnumbered]:
    made = Unnumbered(open_port(hub.address()))
    yield made
    made.close()


def test_the_node_of_that_identity_gets_its_number_and_stores_it(
    network: PortNetwork, node: Unnumbered
) -> None:
    assert assign_node_number(network, IDENTITY, 7) is LssOutcome.ASSIGNED
    assert (node.number, node.stored) == (7, True)


@pytest.mark.parametrize("place", range(4))
def test_a_node_of_another_identity_is_left_alone(network: PortNetwork, node: Unnumbered, place: int) -> None:
    other = tuple(value + (at == place) for at, value in enumerate(IDENTITY))
    assert assign_node_number(network, other, 7) is LssOutcome.ABSENT  # type: ignore[arg-type]
    assert node.number == 0xFF


def test_a_node_that_refuses_the_number_is_reported(network: PortNetwork, node: Unnumbered) -> None:
    node.refuses = True
    assert assign_node_number(network, IDENTITY, 7) is LssOutcome.REFUSED
    assert identity_text(IDENTITY) == "vendor 0x11, product 0x22, revision 0x1, serial 0x5"
