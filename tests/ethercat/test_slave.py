"""A slave that does not answer is silence; an error of this program is none."""

from __future__ import annotations

from typing import Any

import pytest

from mcserver.ethercat.slave import AL_STATUS, EthercatSlave

pysoem = pytest.importorskip("pysoem")


class Device:
    """A slave of pysoem whose registers cannot be reached."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def _fprd(self, *_: object) -> bytes:
        raise self.error

    def _fpwr(self, *_: object) -> None:
        raise self.error


def slave_with(error: Exception) -> EthercatSlave:
    nothing: Any = None
    return EthercatSlave(nothing, Device(error), nothing, nothing, [])


def test_a_register_of_a_slave_that_does_not_answer_is_empty_and_not_written() -> None:
    slave = slave_with(pysoem.WkcError("0", 0))
    assert slave.read_register(AL_STATUS, 6) == b""
    assert not slave.write_register(AL_STATUS, b"\0")


def test_an_error_of_this_program_is_not_taken_for_a_silent_slave() -> None:
    slave = slave_with(TypeError("an address is a number"))
    with pytest.raises(TypeError):
        slave.read_register(AL_STATUS, 6)
    with pytest.raises(TypeError):
        slave.write_register(AL_STATUS, b"\0")
