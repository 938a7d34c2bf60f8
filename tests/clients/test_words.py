"""Words at the right moment: what a run waits for, what is wrong first, and only what can be done."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fake_server import FakeServer
from mcclient.cli import interrupt
from mcclient.cli.job import behind
from mcclient.cli.jog_keys import FIRST_HOLD_S, NEXT_HOLD_S, jog_by_keys
from mcclient.cli.options import axis_of
from mcclient.cli.progress import PlainDisplay, Snapshot
from mcclient.errors import RequestRefused
from mcclient.transport import plain
from mcclient.types import AxisInfo, Info, ProgramStatus

from tests.wire_values import wire_value

Run = Callable[..., tuple[int, str, str]]
AXES = tuple(
    wire_value(AxisInfo, index, "linear", "mm", max_velocity=100.0, max_acceleration=1.0, drive="ideal")
    for index in (0, 1, 7)
)
EXTRUDER = wire_value(
    AxisInfo, 3, "linear", "mm", max_velocity=100.0, max_acceleration=1.0, drive="ideal", letter="E"
)
INFO = wire_value(Info, "cell", "1", (1,), "i", 0.0, 0.001, axes=AXES)


def program(name: str, axes: tuple[int, ...], state: str, opened_at: float) -> ProgramStatus:
    return wire_value(ProgramStatus, f"id-{name}", state, name=name, axes=axes, opened_at=opened_at)


def snapshot(state: str, **more: Any) -> Snapshot:
    return Snapshot(state, 1, 10, 0, 0, "", 100.0, 0.0, **more)


def test_a_queued_run_says_what_it_waits_for_and_on_which_axes() -> None:
    running = program("arcs.gcode", tuple(range(12)), "running", 1.0)
    elsewhere = program("other.gcode", (20,), "running", 1.0)
    later = program("later.gcode", (0,), "queued", 9.0)
    waiting = program("job.gcode", tuple(range(12)), "queued", 5.0)
    said = behind(waiting, (running, elsewhere, later, waiting))
    assert said == "arcs.gcode, axes 0-11"
    assert snapshot("queued", behind=said).shown_state == "queued behind arcs.gcode, axes 0-11"
    assert behind(program("job.gcode", (0,), "running", 5.0), (running,)) == ""


def test_a_run_says_for_which_input_it_waits() -> None:
    assert snapshot("running", waits_for="the input hot").shown_state == "waits for the input hot"
    assert snapshot("held", waits_for="the input door").shown_state == "held by the input door"
    assert snapshot("held").shown_state == "held"


def test_a_server_that_is_gone_is_said_instead_of_running(capsys: pytest.CaptureFixture[str]) -> None:
    display = PlainDisplay("job.gcode", clock=lambda: 0.0)
    display.update(snapshot("running"))
    display.update(snapshot("running", online=False))
    display.update(snapshot("finished", online=False))
    said = capsys.readouterr().err.splitlines()
    assert [line.split(",")[0] for line in said] == [
        "job.gcode: running",
        "job.gcode: the server is gone",
        "job.gcode: finished",
    ]


def test_a_latched_emergency_stop_is_said_before_any_fault_of_the_text(
    mcctl: Run, server: FakeServer, tmp_path: Path
) -> None:
    server.state = "estop"
    server.check_diagnostics = [{"code": "MC101", "message": "an unknown code", "line": 1, "column": 1}]
    file = tmp_path / "job.gcode"
    file.write_text("BAD\n", "utf-8")
    code, _, err = mcctl("run", str(file))
    assert code == 1
    assert "error[MC509]: cell: the emergency stop is latched" in err
    assert "MC101" not in err
    assert server.calls["open"] == 0


@pytest.mark.parametrize(
    ("on_disconnect", "accepted", "offered"),
    [("finish", True, True), ("finish", False, False), ("stop", True, False)],
)
async def test_ctrl_c_offers_to_leave_only_where_leaving_is_possible(
    monkeypatch: pytest.MonkeyPatch, on_disconnect: str, accepted: bool, offered: bool
) -> None:
    said: list[str] = []
    monkeypatch.setattr(interrupt, "say", lambda text, _style="": said.append(text))
    options: Any = SimpleNamespace(interactive=True, step=False, on_disconnect=on_disconnect)
    running: Any = SimpleNamespace(state="running")
    asked = interrupt.Interrupts(running, PlainDisplay("job"), options, lambda: accepted)
    monkeypatch.setattr(asked, "_answer", answered("c"))
    monkeypatch.setattr(asked, "_state", answered("running"))
    try:
        assert not await asked._ask()
    finally:
        asked.close()
    assert ("[l]eave" in said[0]) is offered


def answered(text: str) -> Callable[[], Any]:
    async def answer() -> str:
        return text

    return answer


@pytest.mark.parametrize(("text", "index"), [("X", 0), ("y", 1), ("7", 7), ("[7]", 7), ("0", 0)])
def test_an_axis_is_named_by_its_letter_or_its_number(text: str, index: int) -> None:
    assert axis_of(text, INFO).index == index


@pytest.mark.parametrize("text", ["E", "e", "A", "3"])
def test_an_axis_is_named_by_a_letter_of_the_dialect_too(text: str) -> None:
    info = wire_value(Info, "printer", "1", (1,), "i", 0.0, 0.001, axes=(*AXES, EXTRUDER))
    assert axis_of(text, info).index == 3


@pytest.mark.parametrize("text", ["Z", "W", "3", "", "-1", "XY", "[]", "[3]"])
def test_an_axis_that_the_machine_lacks_is_refused_with_those_it_has(text: str) -> None:
    with pytest.raises(RequestRefused, match="it has X, Y, 7") as refused:
        axis_of(text, INFO)
    assert refused.value.code == "MC507"


class Jogged:
    """A machine that notes its jogs."""

    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []
        self._number = 0

    async def jog(self, axis: int, *, velocity: float, hold_s: float, program: str | None = None) -> str:
        self.calls.append((axis, velocity, hold_s, program))
        if program is None:
            self._number += 1
        return program or f"j{self._number}"

    async def abort(self, program: str) -> list[str]:
        self.calls.append(("abort", program))
        return [program]


async def typed(*keys: str) -> AsyncIterator[str]:
    for key in keys:
        # the time between repetitions, without waiting for it
        loop: Any = asyncio.get_running_loop()
        loop.time.advance(0.1)
        yield key


@pytest.fixture
async def stepped_time(monkeypatch: pytest.MonkeyPatch) -> None:
    class Time:
        now = 0.0

        def __call__(self) -> float:
            return self.now

        def advance(self, seconds: float) -> None:
            self.now += seconds

    monkeypatch.setattr(asyncio.get_running_loop(), "time", Time())


@pytest.mark.usefixtures("stepped_time")
async def test_a_held_key_keeps_the_axis_moving_and_the_other_one_turns_it_round() -> None:
    machine: Any = Jogged()
    await jog_by_keys(machine, AXES[0], 20.0, typed("+", "+", "+", "-", "q"))
    assert machine.calls == [
        (0, 20.0, FIRST_HOLD_S, None),
        (0, 20.0, NEXT_HOLD_S, "j1"),
        (0, 20.0, NEXT_HOLD_S, "j1"),
        ("abort", "j1"),
        (0, -20.0, FIRST_HOLD_S, None),
        ("abort", "j2"),
    ]


@pytest.mark.usefixtures("stepped_time")
async def test_any_other_key_and_the_end_of_the_input_stop_the_axis() -> None:
    machine: Any = Jogged()
    await jog_by_keys(machine, AXES[0], None, typed("\x1b[A", "x", "\x1b[B"))
    assert machine.calls == [
        (0, 10.0, FIRST_HOLD_S, None),
        ("abort", "j1"),
        (0, -10.0, FIRST_HOLD_S, None),
        ("abort", "j2"),
    ]


def test_a_jog_needs_a_distance_or_keys_and_says_its_unit(mcctl: Run) -> None:
    assert mcctl("jog", "X", "5", "--velocity", "2")[1].startswith("cell: axis X goes by 5 mm at 2 mm/s")
    # its sign is the distance's, and the axis goes no faster than it may
    assert " goes by 5 mm at 200 mm/s " in mcctl("jog", "X", "5", "--velocity", "-9999")[1]
    code, _, err = mcctl("jog", "X")
    assert code == 2
    assert "either a distance or --keys" in err


def test_a_jog_of_an_axis_that_is_not_homed_says_so(mcctl: Run, server: FakeServer) -> None:
    server.unhomed.add(1)
    assert "not homed: slowly, and without soft limits" in mcctl("jog", "Y", "5")[1]
    assert "not homed" not in mcctl("jog", "X", "5")[1]
    assert json.loads(mcctl("jog", "Y", "5", "--json")[1])["homed"] is False


def test_help_keeps_its_brackets(mcctl: Run) -> None:
    shown = " ".join(mcctl("jog", "--help")[1].replace("│", " ").split())
    assert "signed [mm, deg]." in shown
    assert "[mm/s, deg/s]; default" in shown


def test_an_error_of_zenoh_is_said_without_places_in_its_sources() -> None:
    raw = "Unable to connect to any of [tcp/127.0.0.1:9]. Timeout! at /build/zenoh/net/orchestrator.rs:388."
    assert plain(RuntimeError(raw)) == "Unable to connect to any of [tcp/127.0.0.1:9]. Timeout!"
