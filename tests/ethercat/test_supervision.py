"""The supervision's rounds, by hand, beside a cycle that may be late."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from mcserver.ethercat.open import _states
from mcserver.ethercat.slave import AL_STATUS, ERROR, AlState
from mcserver.ethercat.supervision import EthercatSupervision


class Slave:
    """One slave by its AL status; it goes where it is requested to."""

    def __init__(self) -> None:
        self.status = int(AlState.OP)
        self.settings = SimpleNamespace(name="axis 0, position 0 on line")

    def read_register(self, address: int, length: int) -> bytes:
        assert (address, length) == (AL_STATUS, 6)
        return bytes((self.status, 0, 0, 0, 0x1B, 0))

    def request(self, state: AlState, *, acknowledge: bool = False) -> None:
        del acknowledge
        self.status = int(state)


def test_a_slave_that_has_left_op_stays_there_until_the_cycle_knows_it() -> None:
    slave = Slave()
    master: Any = SimpleNamespace(
        slaves=[slave],
        is_ring=False,
        soem=SimpleNamespace(read_state=lambda: AlState(slave.status & 0x0F)),
        why=lambda code: f"{code:04X}h",
    )
    port: Any = SimpleNamespace(states=(AlState.OP,), reported=(AlState.OP,), flowing=True, begun=True)
    supervision = EthercatSupervision(master, port)
    slave.status = AlState.SAFEOP | ERROR
    for _ in range(10):
        assert supervision.round()
    assert (port.states, slave.status) == ((AlState.SAFEOP,), AlState.SAFEOP | ERROR)
    port.reported = port.states
    while supervision.round():
        pass
    assert (port.states, slave.status) == ((AlState.OP,), AlState.OP)


def test_drives_are_shown_as_silent_while_no_frame_comes_back() -> None:
    device = SimpleNamespace(man=1, id=2, rev=3, name="drive", input=bytes(9))
    inputs = SimpleNamespace(offset=lambda _index: 0)
    slave = SimpleNamespace(
        settings=SimpleNamespace(place=0, axis=0),
        planned=SimpleNamespace(tpdos=[inputs]),
        identity=SimpleNamespace(device_type=0x20192),
    )
    master: Any = SimpleNamespace(slaves=[slave], soem=SimpleNamespace(slaves=[device]))
    shown = []
    for flowing in (True, False):
        port: Any = SimpleNamespace(states=(AlState.OP,), flowing=flowing, begun=True)
        (found,) = _states("line", master, port)
        shown.append((found.state, found.statusword))
    assert shown == [(AlState.OP, 0), (AlState.NONE, None)]
