"""Objects of drives on EtherCAT for the server's process, through a socket of their master's."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from mcserver.canopen.canopen_errors import DriveError
from mcserver.canopen.coe import agreed_on_ethercat
from mcserver.canopen.settings import DriveSettings
from mcserver.ethercat.mailbox_relay import MailboxRelay, MailboxServer, RelayedSdo, socket_pair
from mcserver.ethercat.operator_line import OperatorLine
from mcserver.ethercat.slave import MOST_BYTES
from mcserver.executor import client
from mcserver.executor.process_start import Start
from mcserver.machine.machine_file import parse_machine
from tests.ethercat.rig import line_of

DRIVE = DriveSettings(3, "cia402", "line", "ec0", 4, fieldbus="ethercat")


class Mailbox:
    """Of a drive; what it refuses is as its manual says."""

    def __init__(self) -> None:
        self.objects: dict[tuple[int, int], bytes] = {(0x1008, 0): b"a drive"}
        self.asked = threading.Event()
        self.goes_on = threading.Event()
        self.goes_on.set()

    def upload(self, index: int, subindex: int, *, attempts: int = 0) -> bytes:
        del attempts
        self.asked.set()
        self.goes_on.wait()
        if (index, subindex) not in self.objects:
            raise DRIVE.fault("MC553", "it refuses", "as its manual says", abort_code=0x0602_0000)
        return self.objects[index, subindex]

    def download(self, index: int, subindex: int, payload: bytes, *, attempts: int = 0) -> None:
        del attempts
        self.objects[index, subindex] = payload


@pytest.fixture
def mailbox() -> Mailbox:
    return Mailbox()


@pytest.fixture
def served(mailbox: Mailbox) -> Iterator[tuple[RelayedSdo, MailboxServer]]:
    ours, theirs = socket_pair()
    server = MailboxServer(theirs.detach())
    slave: Any = SimpleNamespace(settings=DRIVE, sdo=mailbox)
    server.add([slave])
    server.start()
    with ours:
        yield RelayedSdo(MailboxRelay(ours), DRIVE), server


def test_objects_are_read_and_written_as_by_the_mailbox_itself(
    served: tuple[RelayedSdo, MailboxServer], mailbox: Mailbox
) -> None:
    sdo, server = served
    assert sdo.upload(0x1008, 0) == b"a drive"
    longest = bytes(range(256)) * (MOST_BYTES // 256)
    sdo.download(0x2000, 1, longest)
    assert mailbox.objects[0x2000, 1] == longest
    assert sdo.upload(0x2000, 1) == longest
    server.close()


def test_a_refusal_comes_with_its_code_its_remedy_and_its_details(
    served: tuple[RelayedSdo, MailboxServer],
) -> None:
    sdo, server = served
    with pytest.raises(DriveError, match="MC553: axis 3, position 3 on line: it refuses") as refused:
        sdo.upload(0x6065, 0)
    assert refused.value.hint == "as its manual says"
    assert refused.value.details == {"abort_code": 0x0602_0000}
    assert refused.value.axis == 3
    server.close()


def test_a_transfer_under_way_is_answered_before_the_end_and_a_later_one_says_what_has_ended(
    served: tuple[RelayedSdo, MailboxServer], mailbox: Mailbox
) -> None:
    sdo, server = served
    mailbox.goes_on.clear()
    read: list[bytes] = []
    reading = threading.Thread(target=lambda: read.append(sdo.upload(0x1008, 0)))
    reading.start()
    assert mailbox.asked.wait(30.0)
    closing = threading.Thread(target=server.close)
    closing.start()
    mailbox.goes_on.set()
    closing.join(30.0)
    reading.join(30.0)
    assert not closing.is_alive()
    assert read == [b"a drive"]
    with pytest.raises(DriveError, match="MC554: axis 3, position 3 on line: its master"):
        sdo.upload(0x1008, 0)


def test_the_executors_process_gets_one_end_and_the_server_keeps_the_other(
    mailbox: Mailbox, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[MailboxServer] = []

    def start_child(_module: str, start: Start, descriptors: Sequence[int]) -> object:
        assert start.mailboxes in descriptors
        begun.append(MailboxServer(os.dup(start.mailboxes)))
        return SimpleNamespace(poll=lambda: 0, wait=lambda _timeout_s: 0)

    monkeypatch.setattr(client, "start_child", start_child)
    executor = client.ExecutorProcess(agreed_on_ethercat(parse_machine(line_of(1))))
    executor.launch()
    (server,) = begun
    slave: Any = SimpleNamespace(settings=replace(DRIVE, axis=0), sdo=mailbox)
    server.add([slave])
    server.start()
    assert executor.mailboxes is not None
    (drive,) = OperatorLine(executor.machine, executor.mailboxes).drives
    assert drive.sdo.upload(0x1008, 0) == b"a drive"
    server.close()
    with pytest.raises(DriveError, match="MC554: axis 0, position 0 on line"):
        drive.sdo.upload(0x1008, 0)
    executor.stop()
