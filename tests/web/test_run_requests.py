"""What the page shows of runs that wait for an operator."""

from __future__ import annotations

from typing import Any

import pytest
from mcclient import MotionError, RequestRefused

from mcserver.web.panels.arming import (
    _approval_text,
    _effects,
    _extents,
    _heading,
    _listing,
    _state_text,
    _warnings,
)
from mcserver.web.run_requests import RunRequests, RunToArm

NASTY = '"><script>alert(1)</script>\x1b[2J'


def request(sha256: str = "ab" * 32, number: int = 1, **more: Any) -> dict[str, Any]:
    return {
        "sha256": sha256,
        "client": f"bot.agent-1{NASTY}",
        "name": NASTY,
        "state": "waiting",
        "axes": [0, 1],
        "duration_s": 1.5,
        "extents": [
            {"axis": 0, "low": 0.0, "high": 10.0, "unit": "mm"},
            {"axis": 1, "low": -5.0, "high": 0.0, "unit": "mm"},
        ],
        "remaining_s": 60.0,
        "override": 100.0,
        "operator": "",
        "block_delete": False,
        "optional_stop": True,
        "number": number,
        **more,
    }


class OneMachine:
    """Answers as a machine with some requests; counts what it was asked."""

    name = "cell"

    def __init__(self) -> None:
        self.requests = [request()]
        self.over: set[str] = set()
        self.previews = 0
        self.approvals: list[dict[str, Any]] = []

    async def run_approvals(self) -> list[dict[str, Any]]:
        return self.approvals

    async def run_requests(self) -> list[dict[str, Any]]:
        return self.requests

    async def run_preview(self, sha256: str) -> dict[str, Any]:
        self.previews += 1
        if sha256 in self.over:
            raise RequestRefused("MC570", "nothing waits", "look again")
        (run,) = [each for each in self.requests if each["sha256"] == sha256]
        path = {"time_s": [0.0, 1.0, 1.5], "positions": [[0.0, 10.0, 0.0], [0.0, -5.0, -5.0]], "tools": []}
        return {"run": run, "text": f"G01 X10 ({NASTY})\n", "path": path}


async def test_each_request_is_drawn_once_and_its_state_is_followed() -> None:
    machine, requests = OneMachine(), RunRequests()
    await requests.refresh(machine)  # type: ignore[arg-type]
    (first,) = requests.shown
    assert "<polyline" in first.picture
    machine.requests = [request(state="armed")]
    await requests.refresh(machine)  # type: ignore[arg-type]
    assert requests.shown[0].run["state"] == "armed"
    assert machine.previews == 1
    # asked for anew it is another run
    machine.requests = [request(number=2)]
    await requests.refresh(machine)  # type: ignore[arg-type]
    assert requests.shown[0].key != first.key
    assert machine.previews == 2


async def test_a_request_that_is_over_while_it_is_looked_at_hides_no_other() -> None:
    machine, requests = OneMachine(), RunRequests()
    machine.requests = [request("cd" * 32), request()]
    machine.over = {"cd" * 32}
    await requests.refresh(machine)  # type: ignore[arg-type]
    assert [each.run["sha256"] for each in requests.shown] == ["ab" * 32]


async def test_what_is_approved_for_a_while_is_followed_beside_the_requests() -> None:
    machine, requests = OneMachine(), RunRequests()
    machine.approvals = [request(operator=f"alice{NASTY}", override=50.0, remaining_s=754.0)]
    await requests.refresh(machine)  # type: ignore[arg-type]
    (run,) = requests.approvals
    for words in ("for another 12:34", "up to 50 %", "approved by alice"):
        assert words in _approval_text(run)


async def test_who_may_not_see_requests_is_shown_none() -> None:
    class Silent(OneMachine):
        async def run_requests(self) -> list[dict[str, Any]]:
            raise MotionError("MC530", "nobody answers", "may this user see them?")

    with pytest.raises(MotionError):
        await RunRequests().refresh(Silent())  # type: ignore[arg-type]


async def test_words_of_who_asks_never_become_part_of_the_page() -> None:
    machine, requests = OneMachine(), RunRequests()
    await requests.refresh(machine)  # type: ignore[arg-type]
    (each,) = requests.shown
    shown = _heading(each) + _extents(each) + _listing(each.text) + each.picture
    assert "<script" not in shown
    assert "&lt;script&gt;" in shown
    # the picture has no word of theirs at all
    assert "script" not in each.picture


def test_what_a_run_leaves_changed_and_how_fast_it_is_stands_on_its_card() -> None:
    tool = {"tool": 1, "low": [0.0, 1.0, 2.0], "high": [10.0, 11.0, 12.0], "speed": 55.0}
    turning = {"axis": 3, "low": 0.0, "high": 720.0, "unit": "deg", "speed": 360.0, "turns": True}
    run = request(effects=[f"moves G54 X by 300 mm{NASTY}"], tools=[tool])
    run["extents"] = [{**run["extents"][0], "speed": 100.0}, turning]
    each = RunToArm(run, "", "")
    assert "moves G54 X by 300 mm" in _effects(each)
    assert "<script" not in _effects(each)
    for words in ("100.0 mm/s", "turns", "360.0 deg/s", "tool 1 Z", "12.000 mm", "55.0 mm/s"):
        assert words in _extents(each)
    assert _effects(RunToArm(request(), "", "")) == ""


async def test_what_a_simulation_warns_of_stands_on_the_card_with_its_line() -> None:
    class Warned(OneMachine):
        async def run_preview(self, sha256: str) -> dict[str, Any]:
            warning = {"code": "MC321", "message": f"enters {NASTY}", "line": 1, "severity": "warning"}
            return {**await super().run_preview(sha256), "warnings": [warning], "unshown_warnings": 7}

    requests = RunRequests()
    await requests.refresh(Warned())  # type: ignore[arg-type]
    shown = _warnings(requests.shown[0])
    for words in ("Warnings: 8, the first 1 shown", "line 1: enters", "[MC321]", "<code>G01 X10 ("):
        assert words in shown
    assert "<script" not in shown
    assert _warnings(RunToArm(request(), "", "")) == ""


def test_a_run_that_can_no_longer_start_says_why() -> None:
    each = RunToArm(request(changed=["G54 X moved by 300 mm"]), "", "")
    assert _state_text(each).startswith("cannot start as it was simulated: G54 X moved by 300 mm")


def test_a_listing_has_every_line_with_its_number() -> None:
    shown = _listing("\n".join(f"G01 X{number}" for number in range(300)))
    assert "  1  G01 X0" in shown
    assert "300  G01 X299" in shown


def test_a_request_is_named_by_hash_and_number() -> None:
    assert RunToArm(request(number=7), "", "").key == ("ab" * 32, 7)
