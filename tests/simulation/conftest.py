"""What tests of five-axis machines share."""

from __future__ import annotations

import pytest

from mcserver.machine.machine_file import Machine

from .five_axes import TABLE_TABLE


@pytest.fixture(scope="module")
def trunnion(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return TABLE_TABLE.machine(tmp_path_factory.mktemp("trunnion"))
