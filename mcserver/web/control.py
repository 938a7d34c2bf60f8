"""Who drives a machine by this page: one browser at a time, until it is gone or its login ends.

Kept by the page's process, as all visitors of a machine share it. Other clients (``mcctl``, SDKs) are no
visitors: leases on axes are what keeps them apart.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from mcserver.net.method_table import BY_NAME
from mcserver.net.roles import MOVERS
from mcserver.web.sessions import Visitor

# a page that is loaded anew, or whose link was cut, is back within this time [s]
AWAY_S = 10.0
# Calls of those who may move that move nothing: a recording, and a no to a run.
_MOVE_NOTHING = frozenset({"reject", "record_start", "record_stop", "record_save"})


def needs_control(method: str) -> bool:
    """Whether a method is for who drives: what everybody may call, such as a stop, never is."""
    return BY_NAME[method].roles <= MOVERS and method not in _MOVE_NOTHING


class Driver(NamedTuple):
    """A browser that drives, and who sits before it."""

    browser: str
    visitor: Visitor

    @property
    def name(self) -> str:
        """As others read it: two browsers of one person are two."""
        return f"{self.visitor.name} (browser {self.browser[:4]})"


class Control:
    """Who drives one machine.

    Args:
        clock: seconds, never stepping.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._driver: Driver | None = None
        # since when the driver's browser has no link
        self._away_since: float | None = None

    @property
    def driver(self) -> Driver | None:
        """Who drives; nobody any more whose browser is gone, whose login has ended or whose role is gone."""
        away = self._away_since is not None and self._clock() - self._away_since > AWAY_S
        if self._driver is not None and (away or not self._driver.visitor.may("open")):
            self._driver = None
        return self._driver

    def other(self, browser: str) -> Driver | None:
        """Who drives beside this browser; None: nobody does."""
        driver = self.driver
        return None if driver is None or driver.browser == browser else driver

    def other_person(self, name: str) -> Driver | None:
        """Who drives, where it is another one than this person who has only left their page; None: nobody."""
        driver = self.driver
        left = self._away_since is not None and driver is not None and driver.visitor.name == name
        return None if left else driver

    def take(self, driver: Driver) -> None:
        """Give control to a browser, whoever had it."""
        self._driver, self._away_since = driver, None

    def give_back(self, browser: str) -> None:
        """Take control from a browser that wants it no more; from no other one."""
        if self._driver is not None and self._driver.browser == browser:
            self._driver = None

    def leave(self, browser: str) -> None:
        """A browser has no link any more: closed, loaded anew, or cut off."""
        if self._driver is not None and self._driver.browser == browser:
            self._away_since = self._clock()

    def come(self, driver: Driver) -> None:
        """A browser has a link: control stays with a person whose page is built anew."""
        had = self.driver
        if had is not None and self._away_since is not None and had.visitor.name == driver.visitor.name:
            self.take(driver)
