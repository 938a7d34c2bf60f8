"""Lines that are not what the machine file says: each is refused with the drive and the remedy."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing

import pytest

from mcserver.canopen.coe import agreed_on_ethercat
from mcserver.canopen.settings import settings_of
from mcserver.errors import McError
from mcserver.ethercat.master import EthercatMaster
from mcserver.machine.machine_file import parse_machine
from tests.ethercat.rig import Cycle, Namespace, SimulatedLine, line_of

Simulate = Callable[[str], SimulatedLine]


def refusal(namespace: Namespace, text: str) -> McError:
    with pytest.raises(McError) as refused:
        Cycle(namespace, text)
    assert refused.value.hint
    return refused.value


def test_a_drive_that_is_not_there_is_named(namespace: Namespace, simulate: Simulate) -> None:
    simulate(line_of(1))
    error = refusal(namespace, line_of(2))
    assert error.code == "MC550"
    assert "axis 1, position 1 on line" in error.message
    assert "1 slaves answer" in error.message


def test_an_empty_line_is_named(namespace: Namespace) -> None:
    error = refusal(namespace, line_of(1))
    assert (error.code, "no slave answers" in error.message) == ("MC550", True)


def test_an_interface_that_is_not_there_is_named(namespace: Namespace) -> None:
    error = refusal(namespace, line_of(1).replace('"ec0"', '"ec7"'))
    assert error.code == "MC424"
    assert "ec7" in error.message


def test_another_makers_drive_is_refused(namespace: Namespace, simulate: Simulate) -> None:
    simulate(line_of(1))
    error = refusal(namespace, line_of(1, drive="vendor_id = 0x539"))
    assert (error.code, "1018h:01" in error.message) == ("MC551", True)


def test_a_slave_that_the_machine_file_does_not_have_is_refused(
    namespace: Namespace, simulate: Simulate
) -> None:
    simulate(line_of(2))
    error = refusal(namespace, line_of(1))
    assert (error.code, "position 1" in error.message) == ("MC551", True)


def test_an_object_that_a_drive_refuses_is_named(namespace: Namespace, simulate: Simulate) -> None:
    line = simulate(line_of(2))
    line.control.fault(2, "sdo_abort", index=0x6060, code=0x06090030)
    error = refusal(namespace, line_of(2))
    assert error.code == "MC553"
    assert "axis 1, position 1 on line: 6060h:00" in error.message


def test_a_mailbox_that_answers_nothing_is_named(namespace: Namespace, simulate: Simulate) -> None:
    line = simulate(line_of(1))
    line.control.fault(1, "sdo_delay")
    assert refusal(namespace, line_of(1, drive="sdo_tries = 1")).code == "MC554"


def test_after_a_refusal_the_line_can_be_opened_again(namespace: Namespace, simulate: Simulate) -> None:
    line = simulate(line_of(1))
    line.control.fault(1, "sdo_abort", index=0x6060, code=0x06090030)
    refusal(namespace, line_of(1))
    line.control.clear()
    Cycle(namespace, line_of(1)).close()


class DeafWhileMapped:
    """pysoem's master on a line whose drive is silent while SOEM reads its mapping for the first time."""

    def __init__(self, soem: object, line: SimulatedLine) -> None:
        self._soem = soem
        self._line = line
        self.mappings = 0

    def __getattr__(self, name: str) -> object:
        return getattr(self._soem, name)

    def config_map(self) -> None:
        self.mappings += 1
        if self.mappings == 1:
            self._line.control.fault(1, "sdo_delay")
        try:
            self._soem.config_map()  # type: ignore[attr-defined]
        finally:
            self._line.control.clear()


def test_a_mapping_whose_answer_was_lost_is_read_once_more(namespace: Namespace, simulate: Simulate) -> None:
    line = simulate(line_of(1))
    machine = agreed_on_ethercat(parse_machine(line_of(1)))
    with namespace.entered():
        master = EthercatMaster(machine.buses[0], settings_of(machine), machine.cycle_s)
    with closing(master):
        master.soem = deaf = DeafWhileMapped(master.soem, line)
        master.boot()
    assert deaf.mappings == 2
