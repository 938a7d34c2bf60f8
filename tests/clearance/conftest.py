"""Servers on a virtual clock, of machines that name bodies."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from mcserver.machine.machine_file import Machine
from tests.clearance.cells import Start
from tests.service.virtual_cell import TURN_S, VirtualCell

log = logging.getLogger(__name__)


@pytest.fixture
async def start(tmp_path: Path) -> AsyncIterator[Start]:
    cells: list[VirtualCell] = []

    def started(machine: Machine, turn_s: float = TURN_S) -> VirtualCell:
        cells.append(VirtualCell(machine, tmp_path, turn_s=turn_s))
        return cells[-1]

    yield started
    for cell in cells:
        # shown with a test that failed, one that was stopped from outside too
        log.info(cell.shown())
        await cell.stop()
