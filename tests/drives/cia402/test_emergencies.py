"""Emergency messages: which stop an axis, which warn, and what is no error at all."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from mcserver.drives.cia402.emergency_codes import EmergencyRule, emergency_pattern
from mcserver.errors import ConfigurationError
from tests.drives.can_rig import Bench, machine


def energized(keys: str = "") -> Bench:
    bench = Bench(machine(1, drive=keys), (1000,))
    bench.tell(DriveMode.POSITION)
    bench.exchange(20)
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    bench.bus.events()
    return bench


def test_that_the_error_is_gone_is_no_warning() -> None:
    bench = energized()
    for code in (0x0000, 0x0001, 0x00FF):
        bench.drives[0].emergency(code)
    bench.exchange(2)
    assert bench.bus.events() == []
    assert bench.feedback.state[0] == DriveState.ENERGIZED


def test_an_emergency_of_warn_on_warns_and_stops_nothing() -> None:
    bench = energized('warn_on = ["32xx"]')
    bench.drives[0].emergency(0x3220)
    bench.exchange(2)
    assert [event.code for event in bench.bus.events()] == [0x3220]
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    bench.drives[0].emergency(0x8611)
    bench.exchange(2)
    assert (bench.feedback.fault[0], bench.feedback.detail[0]) == (DriveFault.EMERGENCY, 0x8611)


def test_with_stop_on_nothing_else_stops() -> None:
    bench = energized('stop_on = ["8611", "0x23xx"]')
    bench.drives[0].emergency(0x5441)
    bench.exchange(2)
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    bench.drives[0].emergency(0x2310)
    bench.exchange(2)
    assert bench.feedback.fault[0] == DriveFault.EMERGENCY


def test_what_is_no_error_code_is_refused_in_the_machine_file() -> None:
    with pytest.raises(ConfigurationError, match="stop_on"):
        machine(1, drive='stop_on = ["86"]')


@given(st.integers(0x0100, 0xFFFF))
def test_without_rules_every_error_stops(code: int) -> None:
    assert EmergencyRule.of([], []).stops(code)
    assert EmergencyRule.of([f"{code:04X}h"], ["xxxx"]).stops(code)
    assert not EmergencyRule.of([], [f"0x{code:04x}"]).stops(code)


@pytest.mark.parametrize("text", ["", "86", "86111", "zzzz", "0x"])
def test_a_pattern_has_four_digits(text: str) -> None:
    with pytest.raises(ValueError, match="error code"):
        emergency_pattern(text)


def test_process_data_of_another_length_are_named() -> None:
    from mcserver.executor.fault_codes import FaultCode, remedy_of

    bench = energized()
    bench.drives[0].short = True
    bench.exchange(4)
    assert bench.feedback.fault[0] == DriveFault.COMMUNICATION
    values = (float(DriveFault.COMMUNICATION), float(bench.feedback.detail[0]))
    assert "come with 4 bytes" in remedy_of(FaultCode.DRIVE_SILENT, 0, values)[0]
