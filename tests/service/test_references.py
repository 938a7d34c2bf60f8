"""References that are kept over a restart."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcserver.executor.process_start import StoredReference
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.service.references import References
from tests.machine_text import axes_text


@pytest.fixture
def machine() -> Machine:
    text = '[machine]\nname = "m"\n'
    for index, homing in enumerate(['method = "absolute"', 'method = "manual"', 'method = "drive"', ""]):
        text += axes_text([index], keys=f"[axis.homing]\n{homing}" if homing else "", drive="simulated")
    return parse_machine(text)


def test_the_reference_of_an_absolute_encoder_holds_whatever_it_reads(
    tmp_path: Path, machine: Machine
) -> None:
    References(tmp_path / "r.json", machine).keep(0, 0.5, 0.1)
    again = References(tmp_path / "r.json", machine)
    again.may_move([0])
    assert again.holding == {0: StoredReference(0.5)}


def test_one_given_by_hand_holds_where_the_encoder_reads_the_same(tmp_path: Path, machine: Machine) -> None:
    References(tmp_path / "r.json", machine).keep(1, 0.5, 0.1)
    assert References(tmp_path / "r.json", machine).holding == {1: StoredReference(0.5, 0.1)}


def test_an_axis_that_may_have_moved_before_a_kill_is_not_homed(tmp_path: Path, machine: Machine) -> None:
    kept = References(tmp_path / "r.json", machine)
    kept.keep(1, 0.5, 0.0)
    kept.may_move([1])
    again = References(tmp_path / "r.json", machine)
    assert again.holding == {}
    assert again.axes == {1}


def test_an_orderly_stop_notes_where_the_axes_stand(tmp_path: Path, machine: Machine) -> None:
    kept = References(tmp_path / "r.json", machine)
    kept.keep(1, 0.5, 0.0)
    kept.may_move([1])
    kept.stand({0: 0.0, 1: 0.75, 2: 0.0, 3: 0.0})
    again = References(tmp_path / "r.json", machine)
    assert again.holding == {1: StoredReference(0.5, pytest.approx(0.25))}


def test_what_homes_again_at_each_start_is_not_kept(tmp_path: Path, machine: Machine) -> None:
    kept = References(tmp_path / "r.json", machine)
    kept.keep(2, 0.5, 0.0)
    kept.keep(3, 0.5, 0.0)
    assert not (tmp_path / "r.json").exists()


def test_a_lost_reference_is_forgotten(tmp_path: Path, machine: Machine) -> None:
    kept = References(tmp_path / "r.json", machine)
    kept.keep(0, 0.5, 0.0)
    kept.forget(0)
    assert References(tmp_path / "r.json", machine).axes == frozenset()


@pytest.mark.parametrize("damage", [b"", b"{", b"[1]", b'{"0": {"offset": "x"}}', b"\xff" * 50, b"[" * 5000])
def test_a_damaged_file_leaves_its_axes_unhomed(tmp_path: Path, machine: Machine, damage: bytes) -> None:
    (tmp_path / "r.json").write_bytes(damage)
    found = References(tmp_path / "r.json", machine)
    assert found.damage
    assert found.holding == {}
    found.keep(0, 0.5, 0.0)
    assert References(tmp_path / "r.json", machine).holding == {0: StoredReference(0.5)}


def test_axes_that_the_machine_has_no_more_are_left_out(tmp_path: Path, machine: Machine) -> None:
    (tmp_path / "r.json").write_bytes(b'{"0": {"offset": 0.5}, "9": {"offset": 1.0, "reading": 0.0}}')
    assert References(tmp_path / "r.json", machine).holding == {0: StoredReference(0.5)}


def test_a_file_that_cannot_be_written_is_said(tmp_path: Path, machine: Machine) -> None:
    kept = References(tmp_path / "missing" / "r.json", machine)
    kept.keep(0, 0.5, 0.0)
    assert "could not be kept" in kept.failure
    assert kept.holding == {0: StoredReference(0.5)}
