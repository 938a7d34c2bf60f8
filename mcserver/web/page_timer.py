"""A page says to its browser that it lives, and refreshes what it shows as fast as the browser draws.

A browser that draws slower than it is sent what to draw would show older and older states as new ones, and
press by press the answers would come later, until its link is given up. It confirms signs of life, and where
it is behind nothing but answers is sent to it: what it has not seen is drawn later, from what is then.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from nicegui import ui

# between two signs of life; a browser that has not confirmed one by then is slower than what it is sent [s]
BEAT_S = 0.5
# so many later it may never have got it, as where its link broke
LOST_BEATS = 20


class PageTimer:
    """Signs of life of one page, and which of them its browser has come to; ``send``: a script to it."""

    def __init__(self, send: Callable[[str], None]) -> None:
        self._send = send
        self._sign = self._confirmed = self._waited = 0

    @property
    def is_behind(self) -> bool:
        """Whether the browser has not yet come to what it was sent a while ago."""
        return self._confirmed < self._sign and self._waited > 0

    def beat(self) -> None:
        """Send a sign of life, once the one before is confirmed or lost: a page that gets none says so."""
        if self._confirmed == self._sign or self._waited == LOST_BEATS:
            self._sign += 1
            self._waited = 0
            self._send(f"mcAlive({self._sign})")
        else:
            self._waited += 1

    def on_confirmed(self, sign: int) -> None:
        """Take the number of a sign of life that the browser has come to."""
        self._confirmed = max(self._confirmed, min(sign, self._sign))

    def start(self, may_see: Callable[[], bool], refresh: Mapping[float, Callable[[], object]]) -> None:
        """Begin, at the page that is being built; it is loaded anew once its visitor may see it no more.

        Args:
            refresh: what shows the newest state, by the period of its calls [s].
        """

        def beat() -> None:
            self.beat()
            sees = may_see()
            for each in timers:
                each.active = sees
            if not sees:
                ui.navigate.reload()

        ui.timer(BEAT_S, beat)
        timers = [
            ui.timer(period_s, lambda show=show: None if self.is_behind else show())
            for period_s, show in refresh.items()
        ]
