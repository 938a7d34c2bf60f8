"""``[axis.homing]`` and ``[probe]`` of a machine file."""

from __future__ import annotations

import math

import pytest

from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected


def parse(homing: str = "", *, axis: str = "", drive: str = 'kind = "simulated"', more: str = "") -> Machine:
    section = f"[axis.homing]\n{homing}\n" if homing else ""
    return parse_machine(
        f'[machine]\nname = "m"\n{more}\n[[axis]]\nindex = 2\ntype = "linear"\nmax_velocity = 100.0\n'
        f"max_acceleration = 1000.0\n{axis}\n{section}[axis.drive]\n{drive}\n"
    )


LIMITS = "min_position = -10.0\nmax_position = 90.0"


def test_a_section_becomes_si_with_what_follows_from_other_keys() -> None:
    homing = (
        parse(
            'method = "switch"\ndirection = "positive"\nvelocity = 20.0\nback_off = 3.0\nposition = 5.0',
            axis=LIMITS,
        )
        .axes[0]
        .homing
    )
    assert homing is not None
    assert (homing.direction, homing.velocity, homing.position) == (1.0, 0.02, 0.005)
    assert homing.travel == pytest.approx(0.11)
    assert homing.release_travel == pytest.approx(0.015)
    assert homing.jog_velocity == 0.02
    assert homing.required
    assert not homing.absolute


def test_a_machine_without_the_section_has_no_homing() -> None:
    assert parse(axis=LIMITS).axes[0].homing is None


def test_an_absolute_encoder_keeps_a_reference_of_any_method() -> None:
    for text in ('method = "absolute"', 'method = "switch"\nencoder = "absolute"'):
        homing = parse(text, axis=LIMITS).axes[0].homing
        assert homing is not None
        assert homing.absolute


@pytest.mark.parametrize(
    ("homing", "axis", "drive", "code", "key"),
    [
        ('method = "swich"', LIMITS, "", "MC003", "method"),
        ('method = "switch"\nvelocity = 0.0', LIMITS, "", "MC004", "velocity"),
        ('method = "switch"\nvelocity = 200.0', LIMITS, "", "MC030", "velocity"),
        ('method = "switch"\njog_velocity = 200.0', LIMITS, "", "MC030", "jog_velocity"),
        ('method = "switch"\nvelocity = 5.0\nlatch_velocity = 6.0', LIMITS, "", "MC030", "latch_velocity"),
        ('method = "switch"', "", "", "MC031", "travel"),
        ('method = "switch"\nthen_move_to = 91.0', LIMITS, "", "MC032", "then_move_to"),
        ('method = "switch"\ninput = 3', LIMITS, "", "MC033", "input"),
        ('method = "switch"', LIMITS, 'kind = "servosila"\nbus = "can0"\nnode = 5', "MC033", "input"),
        ('method = "manual"\ninput = 3', LIMITS, "", "MC030", "input"),
        ('method = "manual"\nthen_move_to = 3.0', LIMITS, "", "MC030", "then_move_to"),
        ('method = "hard-stop"', LIMITS, "", "MC030", "torque"),
        ('method = "switch"\ntorque = 1.0', LIMITS, "", "MC030", "torque"),
        ('method = "hard-stop"\ntorque = 1.0', LIMITS, 'kind = "ideal"', "MC030", "method"),
        ('method = "manual"\nindex = true', LIMITS, "", "MC030", "index"),
    ],
)
def test_a_mistake_is_placed(homing: str, axis: str, drive: str, code: str, key: str) -> None:
    with pytest.raises(MachineFileRejected) as rejected:
        parse(homing, axis=axis, drive=drive or 'kind = "simulated"')
    first = rejected.value.diagnostics[0]
    assert first.code == code
    assert first.message.startswith(f"axis[0].homing.{key}")
    assert first.line > 0
    assert first.hint


def test_a_drive_that_is_to_home_itself_has_to_say_how() -> None:
    drive = 'kind = "cia402"\nbus = "can0"\nnode = 1\ncounts_per_motor_rev = 1000\nfeed = [5.0, 1.0]'
    with pytest.raises(MachineFileRejected) as rejected:
        parse('method = "drive"', axis=LIMITS, drive=drive)
    assert rejected.value.diagnostics[0].code == "MC030"
    with_section = drive + "\n[axis.drive.homing]\nmethod = 35"
    assert parse('method = "drive"', axis=LIMITS, drive=with_section).axes[0].homing is not None


def test_the_index_of_a_drive_on_a_bus_is_found_by_the_drive() -> None:
    drive = 'kind = "cia402"\nbus = "can0"\nnode = 1\ncounts_per_motor_rev = 1000\nfeed = [5.0, 1.0]'
    with pytest.raises(MachineFileRejected) as rejected:
        parse('method = "index"', axis=LIMITS, drive=drive)
    assert "33" in rejected.value.diagnostics[0].hint


def test_a_switch_may_be_an_input_of_the_machine() -> None:
    more = '[[input]]\nnumber = 3\nname = "home z"\n'
    homing = parse('method = "switch"\ninput = 3', axis=LIMITS, more=more).axes[0].homing
    assert homing is not None
    assert homing.input == 3


def test_a_probe_in_si() -> None:
    probe = parse(more="[probe]\nsimulated_at = { Z = -3.2 }").probe
    assert probe is not None
    assert probe.planes == {2: pytest.approx(-0.0032)}
    assert math.isfinite(probe.planes[2])


@pytest.mark.parametrize(
    ("probe", "code"),
    [
        ("simulated_at = { X = 1.0 }", "MC034"),
        ("invert = true", "MC035"),
        ("input = 9", "MC035"),
        ("inputs = 9", "MC003"),
    ],
)
def test_a_probe_that_nothing_trips_is_refused(probe: str, code: str) -> None:
    with pytest.raises(MachineFileRejected) as rejected:
        parse(more=f"[probe]\n{probe}")
    assert code in {each.code for each in rejected.value.diagnostics}
