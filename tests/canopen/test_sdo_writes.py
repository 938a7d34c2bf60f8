"""Writes by SDO whose answers stay out: read back, and never carried out twice for nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from mcserver.canopen.canopen_errors import DriveError
from mcserver.canopen.network import PortNetwork
from mcserver.canopen.sdo import NodeSdo
from mcserver.canopen.settings import DriveSettings, SdoTimes
from tests.canopen.fake_drives import FakeDrives

WORKING = 0x2000
DRIVE = DriveSettings(0, "cia402", "left", "", 1, sdo=SdoTimes(response_s=0.1, attempts=3, store_s=0.3))


@pytest.fixture
def drives(make_drives: Callable[..., FakeDrives]) -> FakeDrives:
    return make_drives(1)


@pytest.fixture
def sdo(network: PortNetwork) -> NodeSdo:
    return NodeSdo(network, DRIVE)


def written(drives: FakeDrives, index: int) -> int:
    return sum(write[0] == index for write in drives[1].written)


def test_a_write_that_was_carried_out_and_not_answered_is_not_repeated(
    sdo: NodeSdo, drives: FakeDrives
) -> None:
    drives[1].objects[WORKING, 0] = b"\x00\x00"
    drives[1].swallowed[WORKING, 0] = 1
    sdo.download(WORKING, 0, b"\x34\x12")
    assert written(drives, WORKING) == 1
    assert drives[1].objects[WORKING, 0] == b"\x34\x12"


def test_a_write_that_got_lost_is_repeated(sdo: NodeSdo, drives: FakeDrives) -> None:
    drives[1].objects[WORKING, 0] = b"\x00\x00"
    drives[1].unanswered[WORKING, 0] = 1
    sdo.download(WORKING, 0, b"\x34\x12")
    assert written(drives, WORKING) == 1


def test_a_write_that_cannot_be_read_back_is_not_repeated_and_said_to_be_unknown(
    sdo: NodeSdo, drives: FakeDrives
) -> None:
    drives[1].objects[WORKING, 0] = b"\x00\x00"
    drives[1].swallowed[WORKING, 0] = 1
    drives[1].write_only.add((WORKING, 0))
    with pytest.raises(DriveError, match=r"MC554.*2000h:00 was sent to the drive once.*cannot be read back"):
        sdo.download(WORKING, 0, b"\x34\x12")
    assert written(drives, WORKING) == 1


def test_a_store_has_a_time_of_its_own_and_is_never_repeated(
    network: PortNetwork, drives: FakeDrives
) -> None:
    # far above the time that the store takes: a busy computer adds to that
    sdo = NodeSdo(network, replace(DRIVE, sdo=replace(DRIVE.sdo, store_s=1.5)))
    drives[1].slow[0x1010, 1] = 0.2
    sdo.download(0x1010, 1, b"save")
    assert written(drives, 0x1010) == 1
    drives[1].swallowed[0x1010, 1] = 1
    with pytest.raises(DriveError, match=r"MC554.*1010h:01 was sent once.*may still be storing"):
        sdo.download(0x1010, 1, b"save")
    assert written(drives, 0x1010) == 2
