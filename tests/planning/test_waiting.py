"""Programs that wait for each other to leave: none waits for good but for what a person has at rest."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.errors import Diagnostic
from mcserver.executor.shm.feedback import AxisCondition, FeedbackState, SlotFeedback, SlotState
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.planning.shared_space import Mask, SharedSpace, Tenant, Wait
from mcserver.planning.waiting import LOCKED_S, LOOK_S, Waiting

WIDTH = 4
TOUCHING = Diagnostic("MC320", "'ram' would come too near to 'shuttle'", line=1)


def columns(*numbers: int) -> Mask:
    return np.isin(np.arange(WIDTH), numbers)


def machine() -> Machine:
    axis = '[[axis]]\nindex = {}\ntype = "linear"\nmax_velocity = 200.0\nmax_acceleration = 2000.0\n'
    return parse_machine('[machine]\nname = "hall"\n' + "".join(axis.format(each) for each in range(WIDTH)))


class Hall:
    """A feedback that is set by hand, and the space of its programs; program i moves axis i."""

    def __init__(self) -> None:
        nothing = np.zeros(WIDTH)
        self.now = FeedbackState(
            time=0.0,
            cycle=0,
            late_cycles=0,
            line=0,
            estop=False,
            setpoint=nothing,
            velocity=nothing.copy(),
            actual=nothing,
            actual_velocity=nothing,
            torque=nothing,
            condition=np.full(WIDTH, AxisCondition.HOLDING, np.int8),
            slots=tuple(SlotFeedback(0.0, 1.0, SlotState.RUNNING, 1) for _ in range(WIDTH)),
            interlocked=False,
            inputs=nothing,
            outputs=nothing,
            owners=np.zeros(0, np.int64),
            homed=0,
        )
        self.space = SharedSpace(machine(), lambda: self.now)

    def enter(self, number: int, *lease: int) -> Tenant:
        tenant = Tenant(f"p{number}", number, columns(*(lease or (number,))))
        self.space.enter(tenant)
        return tenant

    def show(self, number: int, state: SlotState, *, moves: bool = False, endless: bool = False) -> None:
        slots = list(self.now.slots)
        slots[number] = replace(slots[number], state=state)
        self.now.velocity[number] = float(moves or endless)
        still = AxisCondition.SPEED if endless else AxisCondition.HOLDING
        self.now.condition[number] = AxisCondition.MOVING if moves else still
        self.now = replace(self.now, slots=tuple(slots))

    def pass_look(self) -> None:
        self.now = replace(self.now, cycle=self.now.cycle + 1, time=(self.now.cycle + 1) * LOOK_S)


@dataclass
class Walker:
    """A program that goes from cell to cell; where another one is, it waits."""

    hall: Hall
    number: int
    script: list[int]
    where: int = field(init=False)
    state: str = "running"
    held: bool = False
    moving: int = 0

    def __post_init__(self) -> None:
        # a place of its own
        self.where = -1 - self.number
        self.tenant = self.hall.enter(self.number)
        self.waiting = Waiting(self.hall.space, self.tenant)

    def end(self, state: str) -> None:
        self.state = state
        self.tenant.ended = self.hall.now.time
        self.hall.show(self.number, SlotState.FINISHED if state == "finished" else SlotState.FAULTED)

    def step(self, walkers: list[Walker]) -> None:
        """What a pipeline's piece of work does."""
        if self.state != "running" or self.held or self.moving:
            return
        if not self.script:
            self.end("finished")
            return
        if self.waiting.fault is not None and not self.waiting.due:
            return
        there = [each for each in walkers if each is not self and each.where == self.script[0]]
        if not there:
            self.where, self.moving = self.script.pop(0), 2
            self.waiting.end()
            self.hall.show(self.number, SlotState.RUNNING, moves=True)
            return
        others = self.hall.space.movers(columns(self.number, there[0].number), self.tenant)
        assert others == [f"p{each.number}" for each in there if each.state == "running"]
        fault: Diagnostic | None = TOUCHING
        if others:
            fault = self.waiting.before(TOUCHING, others)
            if fault is not None:
                assert "wait for each other" in fault.message
                assert not set_free(self, walkers)
        if fault is not None:
            self.waiting.end()
            self.end("faulted")

    def pass_look(self) -> None:
        if self.state == "running":
            self.moving = max(0, self.moving - 1)
            state = SlotState.HELD if self.held and not self.moving else SlotState.RUNNING
            self.hall.show(self.number, state, moves=self.moving > 0)


def set_free(asking: Walker, walkers: list[Walker]) -> bool:
    """Whether any order of what the others do would set a program free, by trying them all."""
    first = tuple((each.where, tuple(each.script)) for each in walkers)
    seen, ahead = {first}, [first]
    while ahead:
        state = ahead.pop()
        taken = {where for where, _ in state}
        if asking.script[0] not in taken:
            return True
        for number, (_, script) in enumerate(state):
            if number != asking.number and walkers[number].state == "running" and script:
                after = (*state[:number], (script[0], script[1:]), *state[number + 1 :])
                if script[0] not in taken and after not in seen:
                    seen.add(after)
                    ahead.append(after)
    return False


scripts = st.lists(st.lists(st.integers(0, 3), max_size=5), min_size=2, max_size=WIDTH)
orders = st.lists(st.tuples(st.sampled_from(("step", "step", "look", "hold", "resume")), st.integers(0, 3)))


@settings(max_examples=300)
@given(scripts=scripts, orders=orders, turns=st.permutations(range(WIDTH)))
def test_none_waits_for_good_and_none_ends_that_another_one_would_set_free(
    scripts: list[list[int]], orders: list[tuple[str, int]], turns: list[int]
) -> None:
    hall = Hall()
    walkers = [Walker(hall, number, list(script)) for number, script in enumerate(scripts)]

    def look() -> None:
        hall.pass_look()
        for each in walkers:
            each.pass_look()

    for order, number in orders:
        walker = walkers[number % len(walkers)]
        if order == "look":
            look()
        elif order == "step":
            walker.step(walkers)
        elif walker.state == "running":
            walker.held = order == "hold"
    # nobody holds anything any more: each move takes two looks, and each knot four to come loose
    for walker in walkers:
        walker.held = False
    for _ in range(6 * sum(len(script) + 1 for script in scripts)):
        for number in turns:
            if number < len(walkers):
                walkers[number].step(walkers)
        look()
    assert {each.state for each in walkers} <= {"finished", "faulted"}


def lock(hall: Hall, *waits: tuple[Tenant, tuple[str, ...], float]) -> list[bool]:
    """Which of some programs that stand before each other have come to that last."""
    for tenant, programs, since in waits:
        tenant.wait = Wait(programs, since)
    return [hall.space.locked(tenant) for tenant, _, _ in waits]


def test_of_a_ring_of_programs_the_one_that_came_last_ends() -> None:
    hall = Hall()
    one, two, three = (hall.enter(number) for number in range(3))
    waits = [(one, ("p1",), 1.0), (two, ("p2",), 3.0), (three, ("p0",), 2.0)]
    assert lock(hall, *waits) == [False, True, False]


def test_who_waits_for_a_ring_that_it_is_not_in_goes_on_waiting() -> None:
    hall = Hall()
    one, two, three = (hall.enter(number) for number in range(3))
    waits = [(one, ("p1",), 1.0), (two, ("p0",), 2.0), (three, ("p0",), 9.0)]
    assert lock(hall, *waits) == [False, True, False]


def test_one_of_several_that_may_set_it_free_is_enough() -> None:
    hall = Hall()
    one, two, _ = (hall.enter(number) for number in range(3))
    assert lock(hall, (one, ("p1", "p2"), 1.0), (two, ("p0",), 2.0)) == [False, False]


@pytest.mark.parametrize("state", [SlotState.HELD, SlotState.PAUSED, SlotState.STOPPING])
def test_what_a_person_has_at_rest_and_what_is_ending_is_waited_for(state: SlotState) -> None:
    hall = Hall()
    one, two = (hall.enter(number) for number in range(2))
    hall.show(0, state)
    assert lock(hall, (one, ("p1",), 1.0), (two, ("p0",), 2.0)) == [False, False]


def test_who_still_moves_may_leave() -> None:
    hall = Hall()
    one, two = (hall.enter(number) for number in range(2))
    hall.show(0, SlotState.RUNNING, moves=True)
    assert lock(hall, (one, ("p1",), 1.0), (two, ("p0",), 2.0)) == [False, False]


def test_an_axis_that_turns_on_and_on_does_not_keep_programs_waiting() -> None:
    hall = Hall()
    one, two = hall.enter(0, 0, 3), hall.enter(1)
    hall.show(3, SlotState.RUNNING, endless=True)
    assert lock(hall, (one, ("p1",), 1.0), (two, ("p0",), 2.0)) == [False, True]


def test_who_lends_its_axes_at_a_pause_is_not_waited_for_by_who_has_them() -> None:
    hall = Hall()
    lender, borrower, third = hall.enter(0, 0, 1), hall.enter(1, 1), hall.enter(2)
    assert hall.space.movers(columns(0, 1), borrower) == []
    assert hall.space.movers(columns(0, 2), third) == ["p0"]
    hall.show(0, SlotState.PAUSED)
    # the lender is not resumed before the borrower ends, which waits for the third
    waits = [(borrower, ("p2",), 1.0), (third, ("p0",), 2.0)]
    assert lock(hall, *waits) == [False, True]
    assert lender.wait is None


def test_two_that_came_to_it_in_one_cycle_do_not_both_end() -> None:
    hall = Hall()
    tenants = [hall.enter(number) for number in range(2)]
    waits = [Waiting(hall.space, tenant) for tenant in tenants]
    ended = []
    for _ in range(round(LOCKED_S / LOOK_S) + 2):
        for number, waiting in enumerate(waits):
            if not ended and waiting.before(TOUCHING, [f"p{1 - number}"]) is not None:
                ended.append(number)
        hall.pass_look()
    assert ended == [0]
    assert waits[1].before(TOUCHING, ["p0"]) is None
