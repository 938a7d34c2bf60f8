"""A recording that a client makes of its program: complete to its rest, whatever comes late."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from mcclient import recording
from mcclient.feed import Feed, Queue
from mcclient.recording import Recorder
from mcclient.reports import Report

CYCLE_S = 0.01


class LateMachine:
    """A machine whose samples come after the reports of its program."""

    def __init__(self) -> None:
        self.queue: Queue[Any] = Queue(100)
        self.info = SimpleNamespace(telemetry=SimpleNamespace(axes=(0,)), cycle_s=CYCLE_S)

    def samples(self) -> Feed[Any]:
        return Feed(self.queue, lambda: None)

    def send(self, first: int, count: int) -> None:
        rows = np.arange(first, first + count, dtype=np.float64)[:, None]
        self.queue.push(
            SimpleNamespace(seq=first, time_s=CYCLE_S * rows[:, 0], setpoint=rows, position=rows, actual=rows)
        )


@pytest.mark.parametrize("told", ["at once", "late"])
async def test_the_last_samples_are_waited_for_also_where_the_end_is_told_late(
    told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = LateMachine()
    recorder = Recorder(cast("Any", machine), tmp_path / "run.npz")
    reports: Queue[Report] = Queue(100)
    recorder.follow(cast("Any", SimpleNamespace(reports=Feed(reports, lambda: None))))
    machine.send(0, 10)
    await recorder.start()
    written: list[int] = []
    monkeypatch.setattr(Recorder, "_write", lambda self: written.append(self.rows))
    reports.push(Report("program", 0, 0.05, state="running"))
    if told == "at once":
        reports.push(Report("program", 3, 0.5, state="finished"))
        reports.end()
    saving = asyncio.create_task(recorder.save())
    await asyncio.sleep(0.05)
    machine.send(10, 20)
    await asyncio.sleep(0.05)
    assert not written
    if told == "late":
        reports.push(Report("program", 3, 0.5, state="finished"))
        reports.end()
    machine.send(30, 30)
    await saving
    await recorder.close()
    assert written == [60]
    assert CYCLE_S * 59 >= 0.5 + recording.REST_S
