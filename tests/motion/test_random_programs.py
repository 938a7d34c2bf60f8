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


# 21290: all of line 39 and before is handed over as far as it is settled, which is where such a corner
# begins. 40186: one ends within the rise behind a rest, from which a curve is driven quicker than by knots.
# 42043: two of them meet, and no time is left between.
@pytest.mark.parametrize("seed", [21290, 40186, 42043])
def test_no_plan_is_cut_where_a_corner_in_a_time_of_its_own_begins_or_ends(seed: int) -> None:
    machine, moves, commits = program_of(seed)
    assert broken_laws(plan(machine, moves, commits=commits)) == []


# 48265: entered with a speed that it could stop from, but not come down to any other that leaves it its T.
# 100790: that speed was 1e-9 of it above what a stop is planned from.
@pytest.mark.parametrize("seed", [48265, 100790])
def test_a_line_that_would_end_before_its_t_stops_where_no_slower_speed_can_be_reached(seed: int) -> None:
    machine, moves, commits = program_of(seed)
    assert broken_laws(plan(machine, moves, commits=commits)) == []


# Entered for a stop, or for a T, by other rows of their limits than they were planned with again: these stood
# at speeds that hung on the fastest line of all. 395: what came behind left it no profile but one too short;
# the stop that it was entered for keeps its T. 3000253: the speed at its start could not be lowered, that
# at its end could.
@pytest.mark.parametrize("seed", [93, 391, 395, 588, 3000253])
def test_a_line_keeps_the_t_that_it_was_entered_for_whatever_comes_behind_it(seed: int) -> None:
    machine, moves, commits = timed_program_of(seed)
    assert broken_laws(plan(machine, moves, commits=commits)) == []


# 6000034: a line that cannot keep its T ended before it, behind one whose end is slowed down to keep its own.
@pytest.mark.parametrize("seed", [6000034])
def test_a_late_line_beside_a_slowed_one_does_not_end_before_its_t(seed: int) -> None:
    machine, moves, commits = program_of(seed)
    assert broken_laws(plan(machine, moves, commits=commits)) == []


# 97041: the greatest velocity of an axis was passed where speed turned between two nodes; 101241: an F.
@pytest.mark.parametrize("seed", [97041, 101241])
def test_a_stretch_that_is_solved_as_a_whole_keeps_its_speeds_between_nodes(seed: int) -> None:
    machine, moves, commits = program_of(seed)
    assert broken_laws(plan(machine, moves, commits=commits)) == []


# 2004369: limits of an arc were looked at as if the corner behind it had not trimmed it.
@pytest.mark.parametrize("seed", [2004369])
def test_a_rounded_corner_changes_no_limits_of_the_arcs_beside_it(seed: int) -> None:
    machine, moves, commits = program_of(seed)
    assert broken_laws(plan(machine, moves, commits=commits)) == []


# 70886: rows of an exact path by luck ask for a jerk that a path of such vertices does not have between them.
# 21260: a change to 100 % began so near to it that u stayed between rows, where a vertex was passed.
@pytest.mark.parametrize("seed", [70886, 21260])
def test_an_exact_path_asks_for_no_more_between_rows_than_its_vertices_do(seed: int) -> None:
    machine, moves, commits = program_of(seed)
    assert broken_under_orders(plan(machine, moves, commits=commits), seed) == []


# Rows left too little of an acceleration for a whole stop, and an emergency took more of it after four cycles
# of search. 164: it followed a slow change to its end, and took longer than an abort.
@pytest.mark.parametrize(
    ("draw", "seed"),
    [(program_of, 29), (program_of, 164), (program_of, 328), (wide_program_of, 72), (wide_program_of, 426)],
)
def test_a_stop_in_the_flow_of_a_program_keeps_path_and_limits(draw: Draw, seed: int) -> None:
    machine, moves, commits = draw(seed)
    assert broken_by_stops(plan(machine, moves, commits=commits), seed) == []


# 9800437: steps of acceleration left less room than a change within the jerk limit. 9800994: an override
# slowed down by more than the stop that replaced it. 9801260, 9804377: both.
@pytest.mark.parametrize("seed", [9800437, 9800994, 9801260, 9804377])
def test_an_emergency_stop_takes_no_longer_than_an_abort(seed: int) -> None:
    machine, moves, commits = program_of(seed)
    assert broken_by_stops(plan(machine, moves, commits=commits), seed) == []


def test_a_rise_above_100_percent_goes_in_parts_where_rows_take_all_of_a_jerk() -> None:
    # more than 100 % was wished for: only whole changes were tried, until one was made that passes the limits
    machine, moves, commits = wide_program_of(5166)
    assert broken_under_orders(plan(machine, moves, commits=commits), 5166) == []


def test_broken_limits_are_named() -> None:
    machine = alike(2, velocity=200.0, acceleration=1000.0, jerk=50_000.0)
    motion = plan(machine, [at_speed(0.2, line_curve(machine, (0, 1), (0.0, 0.0), (0.2, 0.0)))])
    motion.machine = alike(2, velocity=100.0, acceleration=500.0, jerk=1000.0)
    broken = " ".join(broken_laws(motion))
    assert all(name in broken for name in ("velocity", "acceleration", "jerk"))


# 9: a line with a T of its own was cut inside, and what was left of it asked for all of T. 32: speeds at both
# ends of a late line were raised until it ended before its T. 139: a curve that ends with a chord was left
# with a step of velocity. 581: a curve was looked at in too few places on a line much longer than its knots
# are apart. 1285: the end of a line under way became a curve, which left the rest no room to slow
# down. 81100: speeds beside a line with a T were found with other limits than it was planned with.
@pytest.mark.parametrize("seed", [9, 32, 139, 581, 1285, 81100])
def test_a_program_of_what_machines_seldom_do_keeps_every_law(seed: int) -> None:
    machine, moves, commits = wide_program_of(seed)
    assert broken_laws(plan(machine, moves, commits=commits)) == []


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
