"""An armed program is this very text, once, for a limited time, by who asked, from where it was simulated."""

from __future__ import annotations

import pytest

from mcserver.errors import ServiceError
from mcserver.planning.start_state import StartState
from mcserver.service.arming import (
    CLIENT_REQUESTS,
    MAX_REQUESTS,
    MAX_TEXT,
    WAIT_S,
    Arming,
    Extent,
    RunRequest,
    RunState,
    hash_of,
)

TEXT = "G1010\nG01 X10 F600"
START = StartState({0: 0.0, 1: 0.5})
FREE: frozenset[int] = frozenset()


class Bench:
    """Requests under a clock that the test moves."""

    def __init__(self) -> None:
        self.now = 0.0
        self.arming = Arming(lambda: self.now)

    def ask(self, client: str = "bot.a-1", text: str = TEXT) -> RunRequest:
        wanted = RunRequest(
            client, hash_of(text), text, "", (0,), START, 1.0, (Extent(0, 0.0, 10.0, "mm"),), 0.0
        )
        return self.arming.request(wanted)

    def arm(self, operator: str = "anna.mcctl-1", text: str = TEXT, **options: float) -> RunRequest:
        return self.arming.arm(operator, hash_of(text), **{"seconds": 60.0, "override": 0.5, **options})

    def start(self, client: str = "bot.a-1", text: str = TEXT, changed: tuple[str, ...] = ()) -> RunRequest:
        return self.arming.start(client, text, FREE, lambda _run: list(changed))


@pytest.fixture
def bench() -> Bench:
    return Bench()


def code_of(refused: pytest.ExceptionInfo[ServiceError]) -> str:
    return refused.value.code


def test_what_is_armed_starts_once_with_the_operators_override(bench: Bench) -> None:
    bench.ask()
    bench.arm()
    started = bench.start()
    assert (started.override, started.operator, started.axes) == (0.5, "anna.mcctl-1", (0,))
    with pytest.raises(ServiceError, match="MC571: "):
        bench.start()


def test_nothing_starts_without_being_armed(bench: Bench) -> None:
    with pytest.raises(ServiceError) as unknown:
        bench.start()
    bench.ask()
    with pytest.raises(ServiceError) as waiting:
        bench.start()
    assert code_of(unknown) == code_of(waiting) == "MC571"


@pytest.mark.parametrize(
    "changed", [f"{TEXT} ", TEXT.replace("X10", "X11"), f"{TEXT}\n", TEXT.lower(), "", f"\ufeff{TEXT}"]
)
def test_a_changed_text_is_not_the_armed_one(bench: Bench, changed: str) -> None:
    bench.ask()
    bench.arm()
    with pytest.raises(ServiceError, match="MC571: "):
        bench.start(text=changed)


def test_another_client_does_not_start_it(bench: Bench) -> None:
    bench.ask()
    bench.arm()
    for client in ("bot.a-2", "anna.mcctl-1"):
        with pytest.raises(ServiceError, match="MC573: "):
            bench.start(client)
    bench.start()


def test_an_arming_is_over_after_its_time(bench: Bench) -> None:
    bench.ask()
    bench.arm(seconds=5.0)
    bench.now = 5.0
    with pytest.raises(ServiceError, match="MC571: "):
        bench.start()
    assert bench.arming.requests() == []


def test_what_has_changed_since_the_simulation_is_named_and_refuses_the_start(bench: Bench) -> None:
    bench.ask()
    bench.arm()
    with pytest.raises(ServiceError, match="since it was simulated, X stands 2 mm from") as refused:
        bench.start(changed=("X stands 2 mm from where it was",))
    assert code_of(refused) == "MC572"
    # nothing was used up: what is as it was again may start
    bench.start()


def test_axes_in_use_refuse_the_start_and_keep_the_arming(bench: Bench) -> None:
    bench.ask()
    bench.arm()
    with pytest.raises(ServiceError, match="MC572: "):
        bench.arming.start("bot.a-1", TEXT, frozenset({0, 1}), lambda _run: [])
    bench.arming.start("bot.a-1", TEXT, frozenset({1}), lambda _run: [])


def test_who_asks_may_not_arm_whatever_connection_he_takes(bench: Bench) -> None:
    bench.ask()
    for operator in ("bot.a-1", "bot.mcctl-7"):
        with pytest.raises(ServiceError, match="MC575: "):
            bench.arm(operator)


@pytest.mark.parametrize("sha256", ["", hash_of(TEXT)[:7], "0" * 64, hash_of(TEXT) + "0"])
def test_a_hash_that_names_no_waiting_text_arms_nothing(bench: Bench, sha256: str) -> None:
    bench.ask()
    with pytest.raises(ServiceError, match="MC570: "):
        bench.arming.arm("anna.mcctl-1", sha256, seconds=60.0, override=1.0)


def test_asking_again_takes_the_arming_back(bench: Bench) -> None:
    bench.ask()
    bench.arm()
    assert bench.ask().state is RunState.WAITING
    with pytest.raises(ServiceError):
        bench.start()


def test_a_request_made_anew_has_another_number_and_forgets_its_operator(bench: Bench) -> None:
    first = bench.ask()
    bench.arm()
    again = bench.ask()
    assert again.number != first.number
    assert (again.operator, again.override) == ("", 1.0)
    with pytest.raises(ServiceError, match="MC570: "):
        bench.arming.arm("anna", hash_of(TEXT), seconds=60.0, override=1.0, number=first.number)
    bench.arming.arm("anna", hash_of(TEXT), seconds=60.0, override=1.0, number=again.number)
    assert bench.arming.find(hash_of(TEXT)[:8]).operator == "anna"


def test_an_emergency_stop_takes_every_arming_back(bench: Bench) -> None:
    bench.ask()
    bench.arm()
    bench.arming.disarm()
    with pytest.raises(ServiceError):
        bench.start()
    bench.arm()
    bench.start()


def test_requests_end_with_the_client_that_made_them(bench: Bench) -> None:
    bench.ask()
    bench.ask(text="G01 X1")
    bench.ask("other.b-1", "G01 X2")
    assert [each.text for each in bench.arming.client_gone("bot.a-1")] == [TEXT, "G01 X1"]
    assert [each.client for each in bench.arming.requests()] == ["other.b-1"]
    # the successor of an agent that has crashed asks for the same text
    bench.ask("bot.a-2")


def test_only_its_own_user_withdraws_a_request(bench: Bench) -> None:
    bench.ask()
    with pytest.raises(ServiceError, match="MC573: "):
        bench.arming.withdraw("anna.mcctl-1", hash_of(TEXT))
    bench.arming.withdraw("bot.a-2", hash_of(TEXT)[:8])
    assert bench.arming.requests() == []
    with pytest.raises(ServiceError, match="MC570: "):
        bench.arming.withdraw("bot.a-1", hash_of(TEXT))


@pytest.mark.parametrize("armed", [False, True])
def test_a_rejected_run_does_not_start_and_says_why(bench: Bench, armed: bool) -> None:
    number = bench.ask().number
    if armed:
        bench.arm()
    with pytest.raises(ServiceError, match="MC570: "):
        bench.arming.reject("anna.mcctl-1", hash_of(TEXT), "too fast", number=number + 1)
    bench.arming.reject("anna.mcctl-1", hash_of(TEXT), "too fast", number=number)
    with pytest.raises(ServiceError, match="too fast") as refused:
        bench.start()
    assert code_of(refused) == "MC576"
    with pytest.raises(ServiceError):
        bench.arm()
    # asked for anew it waits anew
    assert bench.ask().reason == ""


def test_what_has_started_or_was_rejected_waits_no_more_and_leaves_room(bench: Bench) -> None:
    for number in range(3 * MAX_REQUESTS):
        text = f"G01 X{number}"
        bench.ask(text=text)
        if number % 2:
            bench.arming.reject("anna.mcctl-1", hash_of(text), "no")
        else:
            bench.arm(text=text)
            bench.start(text=text)
    assert len(bench.arming.requests()) <= MAX_REQUESTS + 1


def test_requests_are_bounded_and_forgotten(bench: Bench) -> None:
    with pytest.raises(ServiceError) as long:
        bench.ask(text="x" * (MAX_TEXT + 1))
    for number in range(CLIENT_REQUESTS):
        bench.ask(text=f"G01 X{number}")
    bench.ask(text="G01 X0")
    with pytest.raises(ServiceError) as own:
        bench.ask(text="G01 X99")
    for number in range(MAX_REQUESTS - CLIENT_REQUESTS):
        bench.ask(f"client{number}", text=f"G01 Y{number}")
    with pytest.raises(ServiceError) as full:
        bench.ask("last", text="G01 Z1")
    assert code_of(long) == code_of(own) == code_of(full) == "MC574"
    bench.now = WAIT_S
    assert bench.arming.requests() == []


def test_two_clients_do_not_share_a_request(bench: Bench) -> None:
    bench.ask()
    with pytest.raises(ServiceError, match="MC573: "):
        bench.ask("other")
