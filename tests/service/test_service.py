"""Programs from opening to end, on a fake executor."""

from __future__ import annotations

import asyncio
import shutil
import sqlite3
from collections.abc import AsyncIterator
from contextlib import closing
from pathlib import Path

import pytest

from mcserver.errors import RejectedLines, ServiceError
from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.gcode.semantics.modal import ModalState
from mcserver.service.commit_record import commit_record_path
from mcserver.service.program import Program
from mcserver.service.program_options import ProgramOptions
from mcserver.service.reports import Event, Fault
from mcserver.service.service import CLIENT_PROGRAMS
from mcserver.service.stop_latch import CONFIRM_PERIOD_S
from tests.service.conftest import LIMIT_S, Bench
from tests.service.fakes import executed_lines
from tests.service.simulated_machine import SimulatedDisk


async def test_lines_run_and_are_done(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    taken = await bench.service.lines.submit("hmi", program.program, 1, ["G90", "move", "move"])
    assert taken.journaled == 3
    ack = await bench.until_acked(program.program, done=3)
    assert (ack.accepted, ack.state) == (3, "running")
    bench.service.lines.close("hmi", program.program)
    await bench.until_acked(program.program, state="finished")
    assert executed_lines(bench.pipelines, program.program) == [1, 2, 3]


async def test_a_line_that_needs_no_time_is_done_without_motion(bench: Bench) -> None:
    program = await bench.opened("G90")
    assert (await bench.until_acked(program.program, done=1)).accepted == 1


async def test_a_streamed_gap_is_answered_by_an_acknowledgement(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    bench.service.lines.stream(program.program, 3, ["move"])
    await bench.until(lambda: any(ack.expected == 1 for ack in bench.acks))


async def test_a_faulty_line_can_be_sent_again_mended(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    with pytest.raises(RejectedLines) as rejected:
        await bench.service.lines.submit("hmi", program.program, 1, ["move", "bad", "move"])
    assert rejected.value.details["expected"] == 2
    assert rejected.value.diagnostics[0].line == 2
    await bench.service.lines.submit("hmi", program.program, 2, ["move", "move"])
    await bench.until_acked(program.program, done=3)
    assert executed_lines(bench.pipelines, program.program) == [1, 2, 3]


async def test_lines_streamed_behind_a_faulty_one_are_not_executed(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    bench.service.lines.stream(program.program, 1, ["bad"])
    bench.service.lines.stream(program.program, 2, ["move"])
    await bench.until(lambda: any(ack.rejected == 1 for ack in bench.acks))
    bench.service.lines.stream(program.program, 3, ["move"])
    await bench.until(lambda: any(ack.expected == 1 for ack in bench.acks))
    assert executed_lines(bench.pipelines, program.program) == []


async def test_a_fault_found_while_planning_ends_the_program_as_rejected(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    bench.service.lines.stream(program.program, 1, ["move", "fatal", "move"])
    ack = await bench.until_acked(program.program, state="rejected")
    assert (ack.rejected, ack.done) == (2, 1)


async def test_a_closed_program_that_holds_a_faulty_line_ends_as_rejected(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    bench.service.lines.stream(program.program, 1, ["move", "bad"])
    bench.service.lines.close("hmi", program.program)
    await bench.until_acked(program.program, state="rejected")


async def test_close_with_a_last_line_refuses_while_it_is_missing(bench: Bench) -> None:
    program = await bench.opened("move")
    with pytest.raises(ServiceError, match="MC505: "):
        bench.service.lines.close("hmi", program.program, last=2)
    bench.service.lines.close("hmi", program.program, last=1)
    await bench.until_acked(program.program, state="finished")


async def test_a_closed_program_takes_no_more_lines(bench: Bench) -> None:
    bench.pipelines.gate.clear()
    program = await bench.opened("wait")
    bench.service.lines.close("hmi", program.program)
    with pytest.raises(ServiceError, match="MC510: "):
        await bench.service.lines.submit("hmi", program.program, 2, ["move"])


async def test_another_client_may_not_submit(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    with pytest.raises(ServiceError, match="MC504: "):
        await bench.service.lines.submit("other", program.program, 1, ["move"])


async def test_disjoint_programs_run_side_by_side_and_others_wait(bench: Bench) -> None:
    first = await bench.service.open("a", ProgramOptions(axes=[0]))
    second = await bench.service.open("b", ProgramOptions(axes=[1]))
    third = await bench.service.open("c", ProgramOptions(axes=[0, 1]))
    assert [first.state, second.state, third.state] == ["running", "running", "queued"]
    bench.service.lines.close("a", first.program)
    await bench.until_acked(first.program, state="finished")
    assert third.state == "queued"
    bench.service.lines.close("b", second.program)
    await bench.until_acked(third.program, state="running")


async def test_lines_of_a_queued_program_are_taken_and_run_later(bench: Bench) -> None:
    first = await bench.service.open("a")
    second = await bench.service.open("b")
    await bench.service.lines.submit("b", second.program, 1, ["move"])
    assert second.state == "queued"
    bench.service.lines.close("a", first.program)
    await bench.until_acked(second.program, done=1)


async def test_an_axis_that_the_machine_lacks_is_refused(bench: Bench) -> None:
    with pytest.raises(ServiceError, match="no axis 7") as refused:
        await bench.service.open("hmi", ProgramOptions(axes=[0, 7]))
    assert refused.value.code == "MC507"


async def test_a_client_that_goes_takes_its_own_stopping_programs_along(bench: Bench) -> None:
    other = await bench.service.open("other", ProgramOptions(axes=[1]))
    program = await bench.service.open("hmi", ProgramOptions(axes=[0]))
    await bench.service.lines.submit("hmi", program.program, 1, ["wait", "move"])
    bench.service.absences.gone("hmi")
    await bench.until_acked(program.program, state="aborted")
    assert not other.over
    assert ("abort", 1) in bench.port.calls


async def test_a_program_waits_for_its_client_for_its_grace(bench: Bench) -> None:
    program = await bench.service.open("hmi", ProgramOptions(grace_s=60.0))
    await bench.service.lines.submit("hmi", program.program, 1, ["wait", "move"])
    bench.service.absences.gone("hmi")
    bench.service.absences.back("hmi")
    bench.service.absences.gone("hmi")
    assert not program.over
    bench.service.absences.leave("hmi")
    await bench.until_acked(program.program, state="aborted")


async def test_a_program_ends_as_it_chose_once_its_grace_is_over_and_a_client_that_is_back_in_time_goes_on(
    bench: Bench,
) -> None:
    gone = await bench.service.open("other", ProgramOptions(axes=[1], grace_s=0.02))
    program = await bench.service.open("hmi", ProgramOptions(axes=[0], grace_s=0.01))
    await bench.service.lines.submit("hmi", program.program, 1, ["wait", "move"])
    for client in ("hmi", "other"):
        bench.service.absences.gone(client)
    bench.service.absences.back("hmi")
    # the longer grace of the two is over now
    await bench.until_acked(gone.program, state="aborted")
    assert not program.over


async def test_a_client_that_goes_lets_its_finishing_programs_end(bench: Bench) -> None:
    program = await bench.service.open("hmi", ProgramOptions(on_disconnect="finish"))
    await bench.service.lines.submit("hmi", program.program, 1, ["wait", "move"])
    bench.service.absences.gone("hmi")
    bench.pipelines.gate.set()
    assert (await bench.until_acked(program.program, state="finished")).done == 2


async def test_hold_and_resume_reach_the_executor(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    bench.service.hold(None)
    assert program.state == "held"
    bench.service.resume(program.program)
    assert program.state == "running"
    assert [call for call in bench.port.calls if call[0] in ("set_hold", "resume")] == [
        ("set_hold", True, 0),
        ("resume", 0),
    ]


async def test_a_queued_program_that_was_held_begins_held(bench: Bench) -> None:
    first = await bench.service.open("a")
    second = await bench.service.open("b")
    bench.service.hold(second.program)
    bench.service.abort(first.program)
    await bench.until_acked(second.program, state="held")
    assert bench.port.calls[-1][0] == "begin"
    assert bench.port.calls[-1][-1] is True


async def test_an_override_of_all_holds_for_programs_to_come(bench: Bench) -> None:
    bench.service.set_override(0.5, None)
    program = await bench.service.open("hmi")
    assert program.status().override == 50.0


async def test_a_fault_of_an_idle_axis_ends_no_program_and_one_of_the_machine_all(bench: Bench) -> None:
    program = await bench.opened("wait")
    bench.port.happen(EventKind.FAULT, -1, 0, code=411, axis=1)
    await bench.until(lambda: bench.service.latch.state == "fault")
    assert bench.service.program(program.program).state == "running"
    bench.port.happen(EventKind.FAULT, -1, 0, code=413, axis=-1)
    ack = await bench.until_acked(program.program, state="faulted")
    assert ack.fault is not None
    assert ack.fault.code == "MC413"


async def test_a_stall_of_the_cycle_ends_only_the_programs_that_the_executor_names(bench: Bench) -> None:
    held = await bench.service.open("hmi", ProgramOptions(axes=[0]))
    moving = await bench.service.open("hmi", ProgramOptions(axes=[1]))
    for program in (held, moving):
        await bench.service.lines.submit("hmi", program.program, 1, ["wait"])
    stalled = int(FaultCode.CYCLE_STALLED)
    bench.port.happen(EventKind.FAULT, -1, 0, code=stalled, axis=-1, values=(0.2, 0.05))
    bench.port.happen(EventKind.FAULT, moving.slot or 0, 1, code=stalled, axis=-1, values=(0.2, 0.05))
    await bench.until_acked(moving.program, state="faulted")
    assert held.state == "running"


async def test_a_fault_ends_the_program_and_names_axis_and_line(bench: Bench) -> None:
    program = await bench.opened("wait")
    bench.port.happen(EventKind.FAULT, 0, 1, code=411, axis=1)
    ack = await bench.until_acked(program.program, state="faulted")
    assert ack.fault is not None
    assert (ack.fault.code, ack.fault.axis, ack.fault.line) == ("MC411", 1, 1)
    assert bench.service.latch.state == "fault"
    bench.service.reset(None)
    assert bench.service.latch.state == "ready"


async def test_a_program_may_clear_a_latched_fault_with_g1000(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    bench.port.happen(EventKind.FAULT, 0, 1, code=411, axis=1, time=-10.0)
    await bench.until_acked(program.program, state="faulted")
    bench.service.latch.refresh_faults({0: "standstill", 1: "fault", 2: "standstill"})
    assert bench.service.latch.state == "fault"
    assert (await bench.service.open("hmi")).state == "running"
    bench.service.latch.refresh_faults({0: "standstill", 1: "standstill", 2: "standstill"})
    assert bench.service.latch.state == "ready"
    assert "reset" in bench.kinds()


async def test_an_emergency_stop_is_latched_confirmed_once_and_ends_programs(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    bench.service.latch.emergency_stop("hmi", "door")
    bench.service.latch.emergency_stop("hmi", "door")
    await bench.until_acked(program.program, state="faulted")
    assert bench.kinds().count("estop") == 1
    assert bench.service.latch.state == "estop"
    with pytest.raises(ServiceError, match="MC509: "):
        await bench.service.open("hmi")
    bench.service.reset(None)
    assert bench.service.latch.state == "ready"


async def test_a_stop_that_is_latched_already_is_confirmed_again_under_its_number(bench: Bench) -> None:
    bench.service.latch.emergency_stop("hmi", "door")
    await asyncio.sleep(CONFIRM_PERIOD_S)
    for _ in range(50):
        bench.service.latch.emergency_stop("other", "door")
    stops = [event for event in bench.events if event.kind == "estop"]
    assert len(stops) == 2
    assert stops[0] == stops[1]
    bench.service.reset(None)
    bench.service.latch.emergency_stop("hmi", "again")
    assert bench.events[-2].kind == "reset"
    assert bench.events[-1].seq == stops[0].seq + 2


async def test_a_copy_is_answered_by_the_newest_stop_also_where_the_machine_stopped_itself(
    bench: Bench,
) -> None:
    bench.service.latch.emergency_stop("hmi", "door")
    bench.service.reset(None)
    bench.service.latch.stopped_by_machine(
        Fault(code="MC411", message="an input stopped the machine", hint="", t=0.0)
    )
    own = bench.events[-1]
    await asyncio.sleep(CONFIRM_PERIOD_S)
    bench.service.latch.confirm_copy()
    assert own.kind == "estop"
    assert bench.events[-1] == own


async def test_reset_waits_for_motion_to_come_to_rest(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    bench.port.stops_at_once = False
    bench.service.latch.emergency_stop("", "")
    with pytest.raises(ServiceError, match="MC509: "):
        bench.service.reset(None)
    bench.port.happen(EventKind.STOPPED, 0)
    await bench.until_acked(program.program, state="faulted")
    bench.service.reset(None)


async def test_a_program_that_the_executor_still_stops_after_a_reset_says_so(bench: Bench) -> None:
    bench.service.latch.emergency_stop("hmi", "door")
    bench.service.reset(None)
    program = await bench.service.open("hmi")
    # what outlives programs still comes to rest
    bench.port.happen(EventKind.FAULT, 0, code=400)
    await bench.until_acked(program.program, state="faulted")
    assert program.fault is not None
    assert program.fault.code == "MC400"
    assert bench.service.latch.state == "ready"


async def test_single_line_mode_starts_one_line_a_step(bench: Bench) -> None:
    program = await bench.service.open("hmi", ProgramOptions(step=True))
    await bench.service.lines.submit("hmi", program.program, 1, ["move", "move"])
    assert program.done == 0
    bench.service.step("hmi", program.program)
    await bench.until_acked(program.program, done=1)
    assert executed_lines(bench.pipelines, program.program) == [1]


async def test_a_defect_of_the_planner_ends_the_program_and_not_the_service(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    bench.service.lines.stream(program.program, 1, ["crash"])
    ack = await bench.until_acked(program.program, state="faulted")
    assert ack.fault is not None
    assert ack.fault.code == "MC516"
    told = next(event for event in bench.events if event.kind == "fault")
    assert (told.fault, told.program) == (ack.fault, program.program)
    again = await bench.service.open("hmi")
    await bench.service.lines.submit("hmi", again.program, 1, ["move"])
    await bench.until_acked(again.program, done=1)


async def test_a_pause_is_resumed(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    bench.port.happen(EventKind.PAUSED, 0, 4)
    await bench.until_acked(program.program, state="paused")
    bench.service.resume(program.program)
    assert program.state == "running"
    assert bench.port.calls[-1] == ("end_pause", 0)


async def test_the_resume_of_a_hold_leaves_the_pause_to_its_own_confirmation(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    bench.service.hold(program.program)
    bench.port.happen(EventKind.PAUSED, 0, 4)
    await bench.until_acked(program.program, state="paused")
    bench.service.resume(program.program)
    assert ("end_pause", 0) not in bench.port.calls
    assert program.state == "paused"
    bench.service.resume(program.program)
    assert bench.port.calls[-1] == ("end_pause", 0)
    assert program.state == "running"


async def test_line_reports_say_how_long_and_how_much_longer(bench: Bench) -> None:
    await bench.opened("move")
    await bench.until(lambda: "lines.ended" in bench.kinds())
    report = next(event for event in bench.events if event.kind == "lines.ended").lines[0]
    assert report.line == 1
    assert report.requested_s == 0.5
    assert report.stretched_by is not None


async def test_events_are_numbered_without_a_gap(bench: Bench) -> None:
    for client in ("a", "b"):
        program = await bench.service.open(client)
        bench.service.abort(program.program)
        await bench.until_acked(program.program, state="aborted")
    assert [event.seq for event in bench.events] == list(range(1, len(bench.events) + 1))
    assert bench.service.events.since(3, 2) == bench.events[2:4]


async def test_lines_before_the_start_line_reach_the_pipeline_as_modal_text(bench: Bench) -> None:
    program = await bench.service.open("hmi", ProgramOptions(start_line=3, before=["G20", "G91"]))
    await bench.service.lines.submit("hmi", program.program, 3, ["move"])
    await bench.until_acked(program.program, done=3)
    assert bench.pipelines.made[program.program].request.start.modal == ModalState(
        inch=True, incremental=True
    )
    assert executed_lines(bench.pipelines, program.program) == [3]


async def test_too_long_a_line_is_rejected_like_a_faulty_one(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    with pytest.raises(RejectedLines) as rejected:
        await bench.service.lines.submit("hmi", program.program, 1, ["G01 " + "X" * 9000])
    assert rejected.value.code == "MC513"


@pytest.fixture
async def full_disk(tmp_path: Path) -> AsyncIterator[tuple[Bench, SimulatedDisk]]:
    disks: list[SimulatedDisk] = []

    def connect(path: Path) -> SimulatedDisk:
        disks.append(SimulatedDisk(path))
        return disks[-1]

    made = Bench(tmp_path / "journal.db", connect=connect)
    made.service.start()
    yield made, disks[0]
    disks[0].full = False
    await made.service.stop()


async def fill(bench: Bench, disk: SimulatedDisk, program: Program) -> None:
    """Fill the disk; line 2 is the first one that the journal cannot take."""
    disk.full = True
    bench.service.lines.stream(program.program, 2, ["move"])
    await bench.until(lambda: any(event.reason == "MC519" for event in bench.events))


async def test_with_a_full_disk_submits_are_refused_and_not_left_waiting(
    full_disk: tuple[Bench, SimulatedDisk], caplog: pytest.LogCaptureFixture
) -> None:
    bench, disk = full_disk
    program = await bench.opened("move")
    await fill(bench, disk, program)
    async with asyncio.timeout(LIMIT_S):
        for lines in (["move"], ["move"], ["move", "move"]):
            with pytest.raises(ServiceError, match="MC519: "):
                await bench.service.lines.submit("hmi", program.program, 2, lines)
        with pytest.raises(ServiceError, match="MC519: "):
            bench.service.lines.close("hmi", program.program)
        with pytest.raises(ServiceError, match="MC519: "):
            await bench.service.open("hmi")
    assert program.journaled == 1
    assert "cannot be written" in caplog.text
    assert executed_lines(bench.pipelines, program.program) == [1]


async def test_what_was_refused_with_a_full_disk_runs_once_when_there_is_room(
    full_disk: tuple[Bench, SimulatedDisk],
) -> None:
    bench, disk = full_disk
    program = await bench.opened("move")
    await fill(bench, disk, program)
    with pytest.raises(ServiceError):
        await bench.service.lines.submit("hmi", program.program, 2, ["move"])
    bench.service.lines.stream(program.program, 3, ["move"])
    disk.full = False
    await bench.until(lambda: program.journaled >= 2)
    taken = await bench.service.lines.submit("hmi", program.program, 2, ["move", "move"])
    assert taken.journaled == 3
    closed = await bench.service.lines.close("hmi", program.program)
    assert closed.journaled == 3
    await bench.until_acked(program.program, state="finished", done=3)
    assert executed_lines(bench.pipelines, program.program) == [1, 2, 3]


async def test_one_client_cannot_hold_all_programs(bench: Bench) -> None:
    for _ in range(CLIENT_PROGRAMS):
        await bench.service.open("greedy")
    with pytest.raises(ServiceError, match="MC508: "):
        await bench.service.open("greedy")
    assert (await bench.service.open("modest")).state == "queued"


async def test_the_next_start_says_once_that_a_program_of_a_killed_server_has_ended(tmp_path: Path) -> None:
    killed = Bench(tmp_path / "journal.db")
    killed.service.start()
    program = await killed.opened("G90")
    await killed.until_acked(program.program, done=1)
    await killed.service.journal_written()
    journal, found = tmp_path / "journal.db", tmp_path / "found.db"
    with closing(sqlite3.connect(journal)) as left, closing(sqlite3.connect(found)) as copy:
        left.backup(copy)
    shutil.copy(commit_record_path(journal), commit_record_path(found))
    await killed.service.stop()

    said: list[Event] = []
    for instance in ("two", "three"):
        again = Bench(found, instance)
        again.service.start()
        await again.service.journal_written()
        assert again.kinds()[0] == "server.started"
        said += [event for event in again.events if event.kind == "program.ended"]
        await again.service.stop()
    (end,) = said
    assert (end.program, end.client, end.state, end.line) == (program.program, "hmi", "interrupted", 1)
    assert (end.instance, end.reason) == ("two", "the server that ran it went away")


@pytest.mark.parametrize("start_line", [1, 2])
@pytest.mark.parametrize("before", [False, True])
async def test_a_resumption_of_a_program_that_never_was_is_refused(
    bench: Bench, start_line: int, before: bool
) -> None:
    lines = ["G90"] * (start_line - 1) if before else []
    with pytest.raises(ServiceError, match="MC503: "):
        await bench.service.open(
            "hmi", ProgramOptions(resume_of="nobody-1", start_line=start_line, before=lines)
        )
