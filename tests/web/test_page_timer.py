"""What a page holds back from a browser that draws slower than it is sent what to draw, without a browser."""

from __future__ import annotations

from mcserver.web.page_timer import LOST_BEATS, PageTimer


def test_a_browser_is_behind_until_it_has_come_to_the_last_sign_of_life() -> None:
    signs: list[str] = []
    timer = PageTimer(signs.append)
    timer.beat()
    assert not timer.is_behind
    # another one would make what is old look new
    timer.beat()
    assert timer.is_behind
    timer.on_confirmed(0)
    assert timer.is_behind
    timer.on_confirmed(1)
    assert not timer.is_behind
    timer.beat()
    assert signs == ["mcAlive(1)", "mcAlive(2)"]
    # one that was never sent
    timer.on_confirmed(7)
    timer.beat()
    for _ in range(LOST_BEATS):
        timer.beat()
        assert timer.is_behind
    assert signs[2:] == ["mcAlive(3)"]
    timer.beat()
    assert signs[3:] == ["mcAlive(4)"]
    timer.on_confirmed(4)
    assert not timer.is_behind
