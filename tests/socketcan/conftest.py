"""vcan0 … vcan3, clean and up; elsewhere every test of this folder skips and says why."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import pytest

from mcserver.can.open import open_port
from mcserver.can.port import CanPort
from tests.socketcan.interfaces import lacking, required

Open = Callable[[str], CanPort]


@pytest.fixture(scope="session", autouse=True)
def socketcan() -> None:
    """Skips where the kernel has no CAN, and fails where it must have it."""
    why = lacking()
    if why is None:
        return
    assert not required(), why
    pytest.skip(f"{why}; `make socketcan` runs these tests in QEMU")


@pytest.fixture
def opened() -> Iterator[Open]:
    """Opens ports, and closes them at the end."""
    with contextlib.ExitStack() as stack:

        def open_one(address: str) -> CanPort:
            port = open_port(address)
            stack.callback(port.close)
            return port

        yield open_one
