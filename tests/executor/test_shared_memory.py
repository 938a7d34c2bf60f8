"""The block of memory that server and executor share."""

from __future__ import annotations

import os

import pytest

from mcserver.executor.shm.shared_memory import create_block, map_block, map_feedback
from mcserver.machine.machine_file import load_machine


def test_a_python_built_for_older_systems_has_the_same_block(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = load_machine("cartesian")
    made = create_block(machine)
    monkeypatch.delattr(os, "memfd_create", raising=False)
    block = create_block(machine)
    assert os.fstat(block).st_size == os.fstat(made).st_size
    assert not os.get_inheritable(block)
    assert len(map_block(block, machine).rings) > 1
    assert map_feedback(block, machine) is not None
    os.close(made)
    os.close(block)
