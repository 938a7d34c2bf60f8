"""What the planner says of where the plan ends."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

from mcserver.executor.shm.feedback import SlotView
from mcserver.planning.planner import END_PERIOD_S, PipelineMaker, Planner, PlannerPort
from mcserver.planning.planner_messages import Begin, PipelineRequest, Validated


def test_the_end_of_the_plan_is_said_anew_while_rows_are_handed_over_all_the_time() -> None:
    now = [0.0]
    pipeline = SimpleNamespace(planned_line=1, planned_end_u=0.0, pump=lambda *_: True, take_reports=list)
    port = SimpleNamespace(
        poll_events=list, sink=lambda _: None, views=lambda slots: [SlotView(0.0, 1.0) for _ in slots]
    )
    pipelines = SimpleNamespace(make=lambda *_: pipeline)
    planner = Planner(cast("PlannerPort", port), cast("PipelineMaker", pipelines), lambda: now[0])
    planner.handle(Begin(cast("PipelineRequest", SimpleNamespace(program="p")), 0, False, 0.0))

    def ends() -> list[tuple[int, float]]:
        return [(each.through, each.end_u) for each in planner.turn() if isinstance(each, Validated)]

    assert ends() == [(1, 0.0)]
    now[0], pipeline.planned_line, pipeline.planned_end_u = 0.1, 2, 4000.0
    assert ends() == [(2, 0.0)]
    now[0] = END_PERIOD_S
    assert ends() == [(2, 4000.0)]
    now[0] = 2.0 * END_PERIOD_S
    assert ends() == []
