"""The executor's own process with drives on CAN."""

from __future__ import annotations

import pytest

from mcserver.errors import RuntimeFault
from mcserver.executor.client import ExecutorProcess
from mcserver.executor.process import ExitCode
from tests.drives.can_rig import machine


def test_a_bus_that_cannot_be_opened_ends_the_process_with_its_reason(
    capfd: pytest.CaptureFixture[str],
) -> None:
    described = machine(1, bus="nowhere")
    process = ExecutorProcess(described)
    with pytest.raises(RuntimeFault) as refused:
        process.start()
    assert refused.value.code == "MC422"
    assert f"ended with code {int(ExitCode.DRIVES)}" in refused.value.message
    shown = capfd.readouterr().err
    assert shown.startswith("MC424: ")
    assert "Traceback" not in shown
