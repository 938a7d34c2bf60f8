"""The page's commissioning desk: the desk of `mcserver drives`, with a server between it and the drive."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest
from mcclient import MotionError, RequestRefused
from mcclient.types import DriveParameters, ParameterInfo, SdoReply

from mcserver.canopen import parameter_backup
from mcserver.canopen.canopen_errors import DriveError, Stopped
from mcserver.canopen.desk import Desk
from mcserver.canopen.parameters import Parameter
from mcserver.canopen.settings import DriveSettings
from mcserver.errors import UsageFault
from mcserver.web.desk import DeskThread, parameters_from

DISABLED = 0x0040
WINDOW = ParameterInfo(0x6065, 0, "Following error window", "u32", "rw", 0, 9000)
TIME = ParameterInfo(0x6066, 0, "Following error time out", "u16", "rw")
NAME = ParameterInfo(0x1008, 0, "Manufacturer device name", "str", "const")


class Filling:
    """A drive whose texts have eight bytes, filled up with zeros."""

    def __init__(self) -> None:
        self.objects = {(0x6041, 0): DISABLED.to_bytes(2, "little")}

    def upload(self, index: int, subindex: int, *, attempts: int = 0) -> bytes:
        del attempts
        return self.objects[index, subindex]

    def download(self, index: int, subindex: int, payload: bytes, *, attempts: int = 0) -> None:
        del attempts
        self.objects[index, subindex] = payload.ljust(8, b"\0")


@pytest.mark.parametrize(
    ("kind", "text"), [("str", "Säge"), ("utf16", "轴"), ("str", "eight by"), ("str", "")]
)
def test_a_text_is_what_was_written_whatever_zeros_a_drive_puts_behind_it(kind: str, text: str) -> None:
    name = Parameter(0x2000, 0, "Name", kind, "rw")
    desk = Desk(DriveSettings(0, "cia402", "can0", "", 1), Filling(), lambda: None)
    assert desk.write(name, text).value == text


def test_bytes_that_are_no_text_are_shown_as_bytes_and_in_no_backup() -> None:
    name, sdo = Parameter(0x2000, 0, "Name", "utf16", "rw"), Filling()
    desk = Desk(DriveSettings(0, "cia402", "can0", "", 1), sdo, lambda: None)
    sdo.objects |= {(0x1018, at): bytes(4) for at in (1, 2, 3, 4)}
    sdo.objects[0x2000, 0] = b"\x00\xd8\x41"
    assert desk.read(name).value == "00 d8 41"
    backup = parameter_backup.take_backup(desk, [name])
    assert not backup.parameters
    assert len(backup.unread) == 1


class ServedDrive:
    """A drive behind a server, known by the calls that its machine answers."""

    def __init__(self) -> None:
        self.objects: dict[tuple[int, int], bytes] = {
            (0x1018, 1): b"\x34\x12\0\0",
            (0x1018, 2): b"\x02\x04\0\0",
            (0x1018, 3): b"\0\0\1\0",
            (0x6041, 0): DISABLED.to_bytes(2, "little"),
            (0x6065, 0): b"\x10\0\0\0",
            (0x6066, 0): b"\x05\0",
            (0x1008, 0): b"A drive",
        }
        self.written: list[tuple[int, int, bytes]] = []
        self.refused: set[tuple[int, int]] = set()
        self.silent = False
        # the loop reads no further while it is cleared
        self.goes_on = asyncio.Event()
        self.goes_on.set()
        self.asked = asyncio.Event()

    async def sdo_read(self, index: int, subindex: int = 0, *, axis: int) -> SdoReply:
        self.asked.set()
        await self.goes_on.wait()
        if self.silent:
            raise RequestRefused("MC554", "axis 2: it does not answer", "check its power")
        if (index, subindex) not in self.objects:
            raise RequestRefused(
                "MC553", f"{index:04X}h: no such object", details={"abort_code": 0x0602_0000}
            )
        raw = self.objects[index, subindex]
        return SdoReply(axis, "can0", 3, index, subindex, "bytes", raw.hex(" "), raw)

    async def sdo_write(
        self,
        index: int,
        value: str,
        subindex: int = 0,
        *,
        axis: int,
        type: str,
    ) -> SdoReply:
        if (index, subindex) in self.refused:
            raise RequestRefused("MC559", f"axis 2: {index:04X}h is not written", "as it says")
        assert type == "bytes"
        raw = bytes.fromhex(value)
        self.objects[index, subindex] = raw
        self.written.append((index, subindex, raw))
        return SdoReply(axis, "can0", 3, index, subindex, "bytes", value, raw)


def described(*parameters: ParameterInfo) -> DriveParameters:
    return DriveParameters(2, "can0", 3, 0, "ab" * 32, parameters or (NAME, WINDOW, TIME), ())


def at(drive: ServedDrive) -> DeskThread:
    link: Any = SimpleNamespace(connected=lambda: drive)
    return DeskThread(link)


def parameter(info: ParameterInfo) -> Parameter:
    return parameters_from(described(info))[0]


async def test_a_parameter_is_written_within_the_limits_of_the_eds_and_read_back() -> None:
    drive = ServedDrive()
    thread = at(drive)
    reading = await thread.work(described(), lambda desk: desk.write(parameter(WINDOW), "0x100"))
    assert (reading.value, drive.written) == (256, [(0x6065, 0, b"\0\1\0\0")])
    with pytest.raises(UsageFault, match=r"MC559.*9001 is outside 0 to 9000 of the EDS"):
        await thread.work(described(), lambda desk: desk.write(parameter(WINDOW), "9001"))
    with pytest.raises(UsageFault, match=r"MC559.*is const"):
        await thread.work(described(), lambda desk: desk.write(parameter(NAME), "another"))
    assert len(drive.written) == 1
    thread.close()


async def test_a_backup_has_what_the_drive_keeps_and_names_what_it_refuses() -> None:
    drive, absent = ServedDrive(), ParameterInfo(0x2345, 0, "Not there", "u8", "rw")
    thread = at(drive)
    wanted = parameters_from(described(NAME, WINDOW, TIME, absent))
    file = await thread.work(
        described(), lambda desk: parameter_backup.take_backup(desk, wanted, "now", "ab" * 32)
    )
    assert {each.object: each.value for each in file.parameters} == {"6065h:00": 16, "6066h:00": 5}
    assert (file.drive.vendor_id, file.drive.eds_sha256, file.taken) == (0x1234, "ab" * 32, "now")
    assert file.unread == ["2345h: no such object"]
    # four of the identity, two that are kept; one was refused
    assert thread.transfers == 5
    thread.close()


async def test_a_restore_writes_what_differs_and_names_what_the_server_refuses() -> None:
    drive = ServedDrive()
    thread = at(drive)
    wanted = parameters_from(described())
    file = await thread.work(described(), lambda desk: parameter_backup.take_backup(desk, wanted))
    drive.objects[0x6065, 0], drive.objects[0x6066, 0] = b"\x11\0\0\0", b"\x06\0"
    drive.refused.add((0x6066, 0))
    said: list[str] = []
    with pytest.raises(DriveError, match=r"MC567.*6066h is not written"):
        await thread.work(
            described(),
            lambda desk: parameter_backup.restore(
                desk, wanted, file, lambda each, was, now: said.append(f"{each.name}: {was} {now}")
            ),
        )
    assert said == ["Following error window: 17 16"]
    assert drive.objects[0x6065, 0] == b"\x10\0\0\0"
    thread.close()


async def test_a_drive_that_does_not_answer_ends_the_work_at_its_first_object() -> None:
    drive = ServedDrive()
    drive.silent = True
    thread = at(drive)
    with pytest.raises(DriveError, match="MC554"):
        await thread.work(
            described(), lambda desk: parameter_backup.take_backup(desk, parameters_from(described()))
        )
    assert not thread.is_busy
    thread.close()


async def test_a_link_that_is_cut_is_said_by_its_own_code() -> None:
    def connected() -> Any:
        raise MotionError("MC530", "bench is not connected", "is its server running?")

    link: Any = SimpleNamespace(connected=connected)
    thread = DeskThread(link)
    with pytest.raises(DriveError, match="MC530"):
        await thread.work(described(), lambda desk: desk.read(parameter(WINDOW)))
    thread.close()


async def test_work_at_thousands_of_objects_is_stopped_between_two_of_them() -> None:
    drive = ServedDrive()
    many = [ParameterInfo(0x2000 + at, 0, f"Own {at}", "u8", "rw") for at in range(4000)]
    drive.objects |= {(each.index, 0): b"\1" for each in many}
    drive.goes_on.clear()
    thread = at(drive)
    working = asyncio.create_task(
        thread.work(
            described(),
            lambda desk: parameter_backup.take_backup(desk, parameters_from(described(*many))),
        )
    )
    await drive.asked.wait()
    assert thread.is_busy
    thread.stop()
    drive.goes_on.set()
    with pytest.raises(Stopped):
        await working
    assert thread.transfers == 1
    # the next work is not stopped by what stopped this one
    assert (await thread.work(described(), lambda desk: desk.read(parameter(WINDOW)))).value == 16
    thread.close()
