"""A drive that refuses one step of its configuration, each step in turn, in every mode."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import cast

import pytest

from mcserver.canopen.abort_codes import ABSENT, OUT_OF_RANGE, UNMAPPABLE, abort_text, refused
from mcserver.canopen.canopen_errors import DriveError, object_text
from mcserver.canopen.configuration import configure
from mcserver.canopen.dictionary import generic_dictionary
from mcserver.canopen.network import PortNetwork
from mcserver.canopen.node import Node, NodeAxis
from mcserver.canopen.node_configuration import configure_node
from mcserver.canopen.sdo import NodeSdo
from mcserver.canopen.sdo_write import SdoWrite
from mcserver.canopen.settings import DriveSettings, settings_of
from tests.canopen.rig import machine_on

MODES = {
    "csp": 'rated_torque = 1.0\nmonitor = ["6079h:00 voltage"]\n[axis.drive.homing]\nmethod = 33',
    "ip": 'mode = "ip"',
    "csv": 'mode = "csv"\nrated_torque = 1.0\ntorque_feed_forward = true',
    "cst": 'mode = "cst"\nrated_torque = 1.0\ninertia = 1e-3\nmax_torque = 2.0',
    "pp": 'mode = "pp"\nsdo_writes = [[0x6065, 0, 500]]',
}
CODES = (0x0602_0000, 0x0601_0002, 0x0604_0041, 0x0609_0030, 0x0800_0022, 0x0504_0000, 0x0666_0666)
IDENTITY = {(0x1000, 0): 0x20192, (0x1018, 1): 5, (0x1018, 2): 6, (0x6502, 0): 0}


class SilentNetwork:
    """Nobody is on it."""

    def handle(self, identifier: int, handler: Callable[[bytes], None]) -> None: ...

    def try_send(self, identifier: int, payload: bytes) -> None: ...


class RefusingSdo:
    """An SDO client whose drive refuses one object, after so many writes; it takes everything else."""

    def __init__(self, place: tuple[int, int], code: int, after: int) -> None:
        self.written: list[tuple[int, int, bytes]] = []
        self._place, self._code, self._after = place, code, after

    def upload(self, index: int, subindex: int, *, attempts: int = 0) -> bytes:
        del attempts
        return IDENTITY.get((index, subindex), 0).to_bytes(4, "little")

    def download(self, index: int, subindex: int, payload: bytes, *, attempts: int = 0) -> None:
        del attempts
        if len(self.written) >= self._after and (index, subindex) == self._place:
            raise refused(
                DriveSettings(0, "cia402", "left", "can0", 1), index, subindex, "written", self._code
            )
        self.written.append((index, subindex, payload))


def steps(mode: str) -> tuple[Node, list[SdoWrite]]:
    keys = "command_timeout_ms = 5000\n" + MODES[mode]
    machine = machine_on("can0", [1], keys, axis_keys="max_following_error = 20.0")
    [settings] = settings_of(machine)
    writes, planned = configure(settings, machine.cycle_s, generic_dictionary(1), 127)
    network, sdo = cast(PortNetwork, SilentNetwork()), cast(NodeSdo, RefusingSdo((0, 0), 0, 0))
    return Node([NodeAxis(settings, planned, tuple(writes))], network, sdo), writes


def refusals(writes: list[SdoWrite]) -> Iterator[tuple[SdoWrite, int, int]]:
    """Each step with each code; the number of writes that went before."""
    done = 0
    for write in writes:
        for code in CODES:
            yield write, code, done
        done += not write.verify


@pytest.mark.parametrize("mode", MODES)
def test_each_step_that_is_refused_is_named_with_a_remedy_or_done_without_and_said(mode: str) -> None:
    node, writes = steps(mode)
    assert len(writes) > 30
    for write, code, before in refusals(writes):
        sdo = RefusingSdo((write.index, write.subindex), code, before)
        place = object_text(write.index, write.subindex)
        gone_without = (
            (write.optional and code in ABSENT)
            or (bool(write.spare_pdo) and code in UNMAPPABLE)
            or (bool(write.instead) and code in OUT_OF_RANGE)
        )
        if gone_without:
            configure_node(node, sdo, writes, lambda: None)
            assert any(place in remark for remark in node.remarks), (place, node.remarks)
            assert not write.spare_pdo or node.dropped == {write.spare_pdo}
        else:
            with pytest.raises(DriveError) as caught:
                configure_node(node, sdo, writes, lambda: None)
            error = caught.value
            assert (error.code, error.axis) == ("MC553", 0)
            assert place in error.message
            assert write.what in error.message
            assert abort_text(code) in error.message
            assert error.hint
            # nothing behind it was written
            assert len(sdo.written) == before, place
