"""The time left of a run, against the truth, over programs of all kinds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
from mcclient.cli.progress import Snapshot, eta_text

from mcserver.gcode.switches import Switches
from mcserver.machine.machine_file import builtin_text, parse_machine
from mcserver.planning.line_marks import LineMarks
from mcserver.service import forecasts
from mcserver.service.arming import hash_of
from mcserver.service.program_options import ProgramOptions
from mcserver.service.timeline import RunClock, Timeline
from mcserver.simulation.line_times import LineTimes
from mcserver.simulation.simulation import simulate
from tests.cli.command import EXAMPLES
from tests.service.conftest import Bench

IDEAL = parse_machine(builtin_text("cartesian").replace('kind = "simulated"', 'kind = "ideal"'))
PROGRAMS = {
    "arcs": (EXAMPLES / "arcs.gcode").read_text("utf-8"),
    "one long line": "G1010\nG01 X1000 F3000",
    "slow end": "G1010\n" + "G01 X10 F6000\nX0\n" * 20 + "G01 Y100 F600",
    "dwells": "G1010\nG04 P2\nG01 X50 F600\nG04 P3\nG00 X0\nG04 P1",
    "blending": "G1010\nG64 P0.1\n"
    + "".join(f"G01 X{i % 7} Y{i % 5} F{600 + 90 * (i % 9)}\n" for i in range(80)),
}


@pytest.fixture(scope="module", params=sorted(PROGRAMS))
def report(request: pytest.FixtureRequest) -> dict[str, Any]:
    answer = simulate(PROGRAMS[request.param], IDEAL).report
    assert answer["ok"], answer["diagnostics"]
    return answer


def marks_of(report: Mapping[str, Any]) -> LineMarks:
    times = LineTimes()
    for each in report["lines"]:
        times.started(each["line"], each["start_s"])
        times.ended(each["line"], each["end_s"])
    return times.all_marks(report["duration_s"], max((each["line"] for each in report["lines"]), default=0))


def timeline(report: Mapping[str, Any]) -> Timeline:
    return Timeline(marks_of(report))


def done_at(report: dict[str, Any], time_s: float) -> int:
    return max((each["line"] for each in report["lines"] if each["end_s"] <= time_s), default=0)


@pytest.mark.parametrize("override", [1.0, 0.5])
def test_the_time_left_is_true_at_10_50_and_90_percent(report: dict[str, Any], override: float) -> None:
    clock = RunClock(1, timeline(report))
    whole = report["duration_s"] / override
    step = 0.1
    asked = [round(whole * share / step) for share in (0.1, 0.5, 0.9)]
    for count in range(asked[-1] + 1):
        now = count * step
        left = clock.observe(now, done_at(report, now * override), override, running=True)
        if count in asked:
            assert left == pytest.approx(whole - now, abs=0.02 * whole)
            assert clock.fraction() == pytest.approx(now / whole, abs=0.02)


def test_the_whole_duration_is_known_at_the_start(report: dict[str, Any]) -> None:
    clock = RunClock(1, timeline(report))
    assert clock.observe(5.0, 0, 1.0, running=True) == pytest.approx(report["duration_s"], abs=0.01)


def test_no_time_passes_while_a_program_is_held() -> None:
    report = {"duration_s": 10.0, "lines": [{"line": 1, "start_s": 0.0, "end_s": 10.0}]}
    clock = RunClock(1, timeline(report))
    clock.observe(0.0, 0, 1.0, running=True)
    assert clock.observe(4.0, 0, 1.0, running=True) == pytest.approx(6.0)
    assert clock.observe(9.0, 0, 1.0, running=False) == pytest.approx(6.0)
    assert clock.observe(10.0, 0, 0.5, running=True) == pytest.approx(11.0)


def test_a_line_that_takes_longer_than_simulated_keeps_the_time_of_those_behind_it() -> None:
    lines = [{"line": 1, "start_s": 0.0, "end_s": 2.0}, {"line": 3, "start_s": 2.0, "end_s": 6.0}]
    clock = RunClock(1, timeline({"duration_s": 6.0, "lines": lines}))
    clock.observe(0.0, 0, 1.0, running=True)
    assert clock.observe(5.0, 0, 1.0, running=True) == pytest.approx(4.0)


def test_a_run_from_a_later_line_has_the_time_of_the_rest() -> None:
    lines = [{"line": n, "start_s": n - 1.0, "end_s": float(n)} for n in range(1, 11)]
    clock = RunClock(8, timeline({"duration_s": 10.0, "lines": lines}))
    assert clock.total_s == pytest.approx(3.0)
    assert clock.observe(0.0, 7, 1.0, running=True) == pytest.approx(3.0)
    assert clock.fraction() == pytest.approx(0.0)


def test_a_program_without_times_is_over_at_once() -> None:
    clock = RunClock(1, timeline({"duration_s": 0.0, "lines": []}))
    assert clock.observe(0.0, 0, 0.0, running=True) == 0.0
    assert clock.fraction() == 1.0


def test_the_simulated_time_goes_before_every_estimate() -> None:
    common = {
        "state": "running",
        "first": 1,
        "total": 10,
        "line": 2,
        "done": 1,
        "text": "",
        "override": 100.0,
    }
    assert Snapshot(**common, elapsed_s=1.0, planned_s=2.0).eta_s == pytest.approx(9.0)  # type: ignore[arg-type]
    known = Snapshot(**common, elapsed_s=1.0, planned_s=2.0, remaining_s=4.0, share=0.2)  # type: ignore[arg-type]
    assert (known.eta_s, known.fraction) == (4.0, 0.2)
    assert eta_text(known) == "0:04"


def test_a_time_left_that_is_no_simulation_says_what_it_is() -> None:
    def shown(done: int, total: int | None = 10, **more: Any) -> str:
        return eta_text(Snapshot("running", 5, total, 5, done, "", 100.0, 30.0, **more))

    # on the way to its first line, and of a stream, only what is planned is known
    assert shown(4, planned_s=2.0) == "at least 0:02"
    assert shown(7, None, planned_s=2.0) == "at least 0:02"
    assert shown(7, planned_s=2.0) == "about 0:30"
    assert shown(4) == "-"


def test_a_simulation_that_comes_late_finds_the_time_that_a_long_line_has_run() -> None:
    report = {"duration_s": 60.0, "lines": [{"line": 1, "start_s": 0.0, "end_s": 60.0}]}
    clock = RunClock(1)
    for second in range(13):
        assert clock.observe(float(second), 0, 1.0, running=True) is None
    assert clock.fraction() is None
    clock.foresee(timeline(report))
    assert clock.observe(13.0, 0, 1.0, running=True) == pytest.approx(47.0)
    assert clock.fraction() == pytest.approx(13.0 / 60.0)


def test_a_line_counts_from_where_the_one_before_it_ended_though_nobody_looked() -> None:
    lines = [{"line": 1, "start_s": 0.0, "end_s": 2.0}, {"line": 2, "start_s": 2.0, "end_s": 12.0}]
    clock = RunClock(1, timeline({"duration_s": 12.0, "lines": lines}))
    clock.observe(0.0, 0, 1.0, running=True)
    assert clock.observe(9.0, 1, 1.0, running=True, done_at=2.0) == pytest.approx(3.0)


TIMES = {"ok": True, "duration_s": 12.0, "lines": [{"line": 1, "start_s": 0.0, "end_s": 12.0}]}


@pytest.mark.parametrize("early", [True, False])
async def test_a_simulation_of_the_text_tells_the_time_of_its_program(bench: Bench, early: bool) -> None:
    service = bench.service
    if early:
        service.forecasts.take(hash_of("move"), marks_of(TIMES))
    program = await service.open("hmi", ProgramOptions(sha256=hash_of("move")))
    other = await service.open("hmi", ProgramOptions(sha256=hash_of("another text")))
    if not early:
        assert program.status().duration_s is None
        service.forecasts.take(hash_of("move"), marks_of(TIMES))
    service.forecasts.estimate()
    found = {each.program: each for each in await service.known(program_id=None, ended=False, limit=9)}
    status = found[program.program]
    assert (status.duration_s, status.eta_s, status.progress) == (12.0, 12.0, 0.0)
    assert found[other.program].duration_s is None


async def test_the_times_of_a_text_are_those_with_the_switches_of_its_program(bench: Bench) -> None:
    service, sha256, skipping = bench.service, hash_of("move"), Switches(block_delete=True)
    service.forecasts.take(sha256, marks_of(TIMES))
    program = await service.open("hmi", ProgramOptions(sha256=sha256, switches=skipping))
    assert program.status().duration_s is None
    service.forecasts.take(sha256, marks_of({**TIMES, "duration_s": 13.0}), switches=skipping)
    assert program.status().duration_s == 13.0


async def test_a_simulation_under_way_gives_an_estimate_that_says_so(bench: Bench) -> None:
    sha256 = hash_of("long")
    program = await bench.service.open("hmi", ProgramOptions(sha256=sha256))
    part = LineMarks([0, 25], [0.0, 5.0], 5.0, 25, complete=False, pauses=(7, 20))
    bench.service.forecasts.take(sha256, part, total=100)
    status = program.status()
    assert (status.duration_s, status.simulated, status.pauses) == (20.0, 0.25, 2)
    assert not bench.service.forecasts.knows(sha256)
    bench.service.forecasts.take(
        sha256, LineMarks([0, 100], [0.0, 16.0], 16.0, 100, pauses=(7, 20)), total=100
    )
    status = program.status()
    assert (status.duration_s, status.simulated) == (16.0, 1.0)
    assert bench.service.forecasts.knows(sha256)


async def test_of_many_simulations_the_newest_are_kept(bench: Bench) -> None:
    for number in range(forecasts.TEXTS + 1):
        bench.service.forecasts.take(hash_of(f"text {number}"), marks_of(TIMES))
    first, second = [
        await bench.service.open("hmi", ProgramOptions(sha256=hash_of(f"text {n}"))) for n in (0, 1)
    ]
    assert (first.status().duration_s, second.status().duration_s) == (None, 12.0)


def test_dwells_take_their_time_whatever_the_override() -> None:
    run = simulate("G1010\nG1 X10 F1200\nG4 P8\nG1 X0", IDEAL)
    clock, report = RunClock(1, Timeline(run.marks())), run.report
    moves = report["duration_s"] - 8.0
    assert clock.observe(0.0, 0, 0.2, running=True) == pytest.approx(8.0 + moves / 0.2, abs=0.01)
    dwell = next(each for each in report["lines"] if each["line"] == 3)
    clock.observe(0.0, 2, 1.0, running=True)
    behind = report["duration_s"] - dwell["end_s"]
    assert clock.observe(2.0, 2, 0.2, running=True) == pytest.approx(6.0 + behind / 0.2, abs=0.01)
    assert clock.remaining_s() == pytest.approx(6.0 + behind, abs=0.01)


async def test_the_time_left_is_not_known_where_nothing_planned_is_left(bench: Bench) -> None:
    program = await bench.service.open("hmi", ProgramOptions())
    assert program.slot is not None
    u = bench.port.slots()[program.slot].u
    program.planned_end_u = u + 500.0
    bench.service.forecasts.estimate()
    assert program.eta_s is not None
    assert program.eta_s > 0.0
    program.planned_end_u = u
    bench.service.forecasts.estimate()
    assert program.eta_s is None
