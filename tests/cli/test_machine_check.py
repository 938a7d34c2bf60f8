"""Doubts about machine files that are valid."""

from __future__ import annotations

import pytest

from mcserver.config import BUILT_IN, load_machine, parse_machine
from mcserver.machine_check import axis_name, find_doubts


def _codes(axis: str, drive: str = "") -> list[str]:
    machine = parse_machine(
        '[machine]\nname = "m"\n[[axis]]\nindex = 0\ntype = "linear"\nmax_velocity = 200.0\n'
        f"max_acceleration = 1000.0\n{axis}\n[axis.drive]\n{drive}"
    )
    return [doubt.code for doubt in find_doubts(machine)]


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_machines_are_beyond_doubt(name: str) -> None:
    assert find_doubts(load_machine(name)) == []


def test_a_jerk_that_is_no_limit_is_doubtful() -> None:
    assert _codes("max_jerk = 5e6") == ["MC020"]


def test_a_tolerance_finer_than_the_encoder_is_doubtful() -> None:
    assert _codes("in_position = 0.001", "encoder_resolution = 0.01") == ["MC021"]


def test_a_tolerance_of_one_count_is_not_doubtful() -> None:
    assert _codes("in_position = 0.01", "encoder_resolution = 0.01") == []


def test_a_tolerance_wider_than_the_following_error_is_doubtful() -> None:
    assert _codes("in_position = 0.5\nmax_following_error = 0.1") == ["MC023"]


def test_a_bus_drive_without_bus_and_node_is_doubtful() -> None:
    assert _codes("", 'kind = "cia402"').count("MC022") == 2


@pytest.mark.parametrize(("index", "name"), [(0, "X"), (5, "C"), (6, "[6]"), (63, "[63]")])
def test_axes_are_named_as_in_programs(index: int, name: str) -> None:
    assert axis_name(index) == name
