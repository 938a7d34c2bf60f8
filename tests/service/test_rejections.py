"""Rejections are counted, so that lines and reports of before one are known as such."""

from __future__ import annotations

import pytest

from mcserver.errors import RejectedLines, ServiceError
from mcserver.service import line_intake
from tests.service.conftest import Bench
from tests.service.fakes import executed_lines


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A verdict is waited for, however busy the computer is."""
    monkeypatch.setattr(line_intake, "VERDICT_LIMIT_S", 30.0)


async def test_the_count_of_rejections_is_said_wherever_numbers_are(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    assert (program.ack().rejections, program.status().rejections) == (0, 0)
    for count in (1, 2):
        with pytest.raises(RejectedLines) as rejected:
            await bench.service.lines.submit("hmi", program.program, 1, ["bad", "move"], count - 1)
        assert rejected.value.details["rejections"] == count
        await bench.until(lambda count=count: any(ack.rejections == count for ack in bench.acks))
        assert program.status().rejections == count
    with pytest.raises(ServiceError) as refused:
        await bench.service.lines.submit("hmi", program.program, 7, ["move"], 2)
    assert refused.value.code == "MC505"
    assert refused.value.details["rejections"] == 2
    await bench.service.lines.submit("hmi", program.program, 1, ["move"], 2)
    # corrected: it is not rejected any more, and the count stays
    assert (program.ack().rejected, program.ack().rejections) == (0, 2)


async def test_lines_of_before_a_rejection_never_run_in_the_place_of_corrected_ones(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    bench.service.lines.stream(program.program, 1, ["move", "bad", "move"], 0)
    await bench.until(lambda: any(ack.rejections == 1 for ack in bench.acks))
    heard = len(bench.acks)
    # on their way when line 2 was rejected, or sent again by who has not heard of it
    bench.service.lines.stream(program.program, 2, ["move", "move"], 0)
    await bench.until(lambda: len(bench.acks) > heard)
    answer = bench.acks[-1]
    assert (answer.accepted, answer.rejected, answer.expected) == (1, 2, 0)
    with pytest.raises(ServiceError, match="given when 0 lines had been rejected") as refused:
        await bench.service.lines.submit("hmi", program.program, 2, ["move"], 0)
    assert refused.value.code == "MC505"
    assert (refused.value.details["expected"], refused.value.details["rejections"]) == (2, 1)
    assert executed_lines(bench.pipelines, program.program) == [1]
    await bench.service.lines.submit("hmi", program.program, 2, ["move", "move"], 1)
    await bench.until_acked(program.program, done=3)
    assert executed_lines(bench.pipelines, program.program) == [1, 2, 3]


async def test_a_line_of_before_a_rejection_is_not_taken_for_the_accepted_one_of_its_number(
    bench: Bench,
) -> None:
    program = await bench.service.open("hmi")
    with pytest.raises(RejectedLines):
        await bench.service.lines.submit("hmi", program.program, 1, ["bad"], 0)
    await bench.service.lines.submit("hmi", program.program, 1, ["move"], 1)
    with pytest.raises(ServiceError, match="MC505: "):
        await bench.service.lines.submit("hmi", program.program, 1, ["another"], 0)
    assert (await bench.service.lines.submit("hmi", program.program, 1, ["move"], 1)).journaled == 1


async def test_a_program_that_has_ended_says_so_to_lines_of_before_a_rejection(bench: Bench) -> None:
    program = await bench.service.open("hmi")
    with pytest.raises(RejectedLines):
        await bench.service.lines.submit("hmi", program.program, 1, ["bad"], 0)
    bench.service.lines.close("hmi", program.program)
    await bench.until_acked(program.program, state="rejected")
    with pytest.raises(ServiceError) as refused:
        await bench.service.lines.submit("hmi", program.program, 1, ["move"], 0)
    assert (refused.value.code, refused.value.details["state"]) == ("MC510", "rejected")
