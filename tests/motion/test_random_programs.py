"""A few seeds of ``make laws``: chords, lines, arcs and timed lines mixed, as planned and under orders."""

from __future__ import annotations

import pytest

from tests.bench.motion_laws import Draw, broken_laws, program_of, timed_program_of
from tests.bench.order_laws import MOST_ROWS, broken_by_stops, broken_under_orders
from tests.bench.text_laws import broken_laws_of_text
from tests.bench.tool_programs import broken_laws_of_tools
from tests.bench.wide_programs import wide_program_of
from tests.motion.support import alike, at_speed, line_curve, plan


@pytest.mark.parametrize("seed", [1, 5, 84, 145, 594])
def test_a_random_program_keeps_every_law_also_under_orders(seed: int) -> None:
    machine, moves, commits = program_of(seed)
    motion = plan(machine, moves, commits=commits)
    assert broken_laws(motion) == []
    assert len(motion.position) <= MOST_ROWS
    assert broken_under_orders(motion, seed) == []


# Programs that once broke a law, and why.
BROKEN_ONCE = {
    # 21290: all of line 39 and before is handed over as far as it is settled, which is where such a corner
    # begins. 40186: one ends within the rise behind a rest, from which a curve is driven quicker than by
    # knots. 42043: two of them meet, and no time is left between.
    "a plan was cut where a corner in a time of its own begins or ends": (program_of, 21290, 40186, 42043),
    # 48265: entered with a speed that it could stop from, but not come down to any other that leaves it its
    # T. 100790: that speed was 1e-9 of it above what a stop is planned from.
    "a line that would end before its T did not stop": (program_of, 48265, 100790),
    # Entered for a stop, or for a T, by other rows of their limits than they were planned with again: these
    # stood at speeds that hung on the fastest line of all. 395: what came behind left it no profile but one
    # too short; the stop that it was entered for keeps its T. 3000253: the speed at its start could not be
    # lowered, that at its end could.
    "a line lost the T that it was entered for": (timed_program_of, 93, 391, 395, 588, 3000253),
    # a line that cannot keep its T ended before it, behind one whose end is slowed down to keep its own
    "a late line beside a slowed one ended before its T": (program_of, 6000034),
    # 97041: the greatest velocity of an axis was passed where speed turned between two nodes; 101241: an F
    "a stretch that is solved as a whole was too fast between nodes": (program_of, 97041, 101241),
    # limits of an arc were looked at as if the corner behind it had not trimmed it
    "a rounded corner changed the limits of an arc beside it": (program_of, 2004369),
    # 9: a line with a T of its own was cut inside, and what was left of it asked for all of T. 32: speeds at
    # both ends of a late line were raised until it ended before its T. 139: a curve that ends with a chord
    # was left with a step of velocity. 581: a curve was looked at in too few places on a line much longer
    # than its knots are apart. 1285: the end of a line under way became a curve, which left the rest no room
    # to slow down. 81100: speeds beside a line with a T were found with other limits than it was planned
    # with.
    # samples miss the greatest speed of an axis on it by 0.0003, beside what a stretch was given
    "an axis was too fast on an arc": (wide_program_of, 34000065),
    "what machines seldom do": (wide_program_of, 9, 32, 139, 581, 1285, 81100),
}


@pytest.mark.parametrize(
    ("draw", "seed"),
    [
        pytest.param(draw, seed, id=f"{why}-{seed}")
        for why, (draw, *seeds) in BROKEN_ONCE.items()
        for seed in seeds
    ],
)
def test_a_program_that_once_broke_a_law_keeps_every_law(draw: Draw, seed: int) -> None:
    machine, moves, commits = draw(seed)
    assert broken_laws(plan(machine, moves, commits=commits)) == []


# 70886: rows of an exact path by luck ask for a jerk that a path of such vertices does not have between them.
# 21260: a change to 100 % began so near to it that u stayed between rows, where a vertex was passed. 5166:
# more than 100 % was wished for where rows take all of a jerk: only whole changes were tried, until one was
# made that passes the limits.
@pytest.mark.parametrize(
    ("draw", "seed"), [(program_of, 70886), (program_of, 21260), (wide_program_of, 5166)]
)
def test_a_change_of_the_rate_keeps_the_limits_on_any_rows(draw: Draw, seed: int) -> None:
    machine, moves, commits = draw(seed)
    assert broken_under_orders(plan(machine, moves, commits=commits), seed) == []


# Rows left too little of an acceleration for a whole stop, and an emergency took more of it after four cycles
# of search. 164: it followed a slow change to its end, and took longer than an abort. 9800437: steps of
# acceleration left less room than a change within the jerk limit. 9800994: an override slowed down by more
# than the stop that replaced it. 9801260, 9804377: both.
@pytest.mark.parametrize(
    ("draw", "seed"),
    [
        *((program_of, seed) for seed in (29, 164, 328, 9800437, 9800994, 9801260, 9804377)),
        (wide_program_of, 72),
        (wide_program_of, 426),
    ],
)
def test_a_stop_in_the_flow_keeps_path_and_limits_and_takes_no_longer_than_an_abort(
    draw: Draw, seed: int
) -> None:
    machine, moves, commits = draw(seed)
    assert broken_by_stops(plan(machine, moves, commits=commits), seed) == []


def test_broken_limits_are_named() -> None:
    machine = alike(2, velocity=200.0, acceleration=1000.0, jerk=50_000.0)
    motion = plan(machine, [at_speed(0.2, line_curve(machine, (0, 1), (0.0, 0.0), (0.2, 0.0)))])
    motion.machine = alike(2, velocity=100.0, acceleration=500.0, jerk=1000.0)
    broken = " ".join(broken_laws(motion))
    assert all(name in broken for name in ("velocity", "acceleration", "jerk"))


# 30054: an override of 0 came in a long ramp that takes all of an acceleration; no change was gentle enough.
# 1309, 130091: a rapid followed a stop above 100 %. 92003: a line that begins in the same cycle did.
@pytest.mark.parametrize(
    ("seed", "orders"),
    [(1, False), (4, False), (5, True), (30054, True), (1309, True), (92003, True), (130091, True)],
)
def test_a_random_program_as_text_keeps_every_law_also_beside_a_planner(seed: int, orders: bool) -> None:
    broken, lines, _ = broken_laws_of_text(seed, orders=orders)
    assert lines > 0
    assert broken == []


# 68: a rounded corner took so much of a line with a turn that the Jacobian was another one there.
@pytest.mark.parametrize(("seed", "orders"), [(68, False), (5003, True)])
def test_a_random_program_of_a_tool_keeps_every_law_also_beside_a_planner(seed: int, orders: bool) -> None:
    broken, lines, _ = broken_laws_of_tools(seed, orders=orders)
    assert lines > 0
    assert broken == []
