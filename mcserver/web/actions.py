"""What a visitor does to a machine: the role is checked each time, a refusal is shown with its remedy."""

from __future__ import annotations

import logging
import time
from collections.abc import Awaitable, Callable

from mcclient import Machine, MotionError
from nicegui import ui

from mcserver.errors import McError
from mcserver.net.method_table import BY_NAME
from mcserver.net.roles import roles_named
from mcserver.web.control import Driver, needs_control
from mcserver.web.delays import MAX_ORDER_DELAY_S, event_delay_s, late_press
from mcserver.web.formatting import page_hint
from mcserver.web.link import MachineLink
from mcserver.web.translation import mark, t

log = logging.getLogger(__name__)

Action = Callable[[Machine], Awaitable[object]]


def show_refusal(message: str, hint: str = "") -> None:
    """A sentence and its remedy, until it is closed. Below: above are the buttons that stop, on a phone."""
    ui.notify(
        t(message) + (f" — {page_hint(hint)}" if hint else ""),
        type="negative",
        position="bottom",
        close_button=t("close"),
        timeout=8000,
    )


def show_error(error: MotionError | McError) -> None:
    """Show what was refused, its code and its remedy."""
    show_refusal(f"{t(error.message)} [{error.code}]", error.hint)


def show_role_refusal(method: str) -> None:
    """Say which roles may call a method."""
    show_refusal(role_text(method), t("log in as somebody who has it"))


def role_text(method: str) -> str:
    """Return which roles may call a method."""
    return t("This needs the role {roles}", roles=roles_named(BY_NAME[method].roles))


def was_late() -> bool:
    """Whether what was pressed is too old to be done; says so where it is (MC604)."""
    delay_s = event_delay_s.get()
    if delay_s <= MAX_ORDER_DELAY_S:
        return False
    show_error(late_press(delay_s))
    return True


class Actions:
    """Bound to one visitor, one browser and one machine.

    Args:
        driver: who acts. link: on what.
    """

    def __init__(self, driver: Driver, link: MachineLink) -> None:
        self.driver = driver
        self.visitor = driver.visitor
        self.link = link

    def has_role(self, method: str) -> bool:
        """Whether the visitor's role may call a method; says so where not."""
        if self.visitor.may(method):
            return True
        show_role_refusal(method)
        return False

    def allowed(self, method: str) -> bool:
        """Whether the visitor may call a method; says so where not.

        What moves something takes control where nobody has it, and is refused where somebody else has, and
        where it was held up on the way.
        """
        if not self.has_role(method):
            return False
        if not needs_control(method):
            return True
        if was_late():
            return False
        if self.has_control:
            return True
        other = self.link.control.other(self.driver.browser)
        if other is not None:
            show_refusal(
                t("{name} has control [MC078]", name=other.name), t("press Take control, or ask for it")
            )
            return False
        self.take_control()
        return True

    @property
    def has_control(self) -> bool:
        """Whether this browser drives the machine."""
        driver = self.link.control.driver
        return driver is not None and driver.browser == self.driver.browser

    def take_control(self) -> None:
        """Drive the machine from now on, whoever did."""
        self.link.control.take(self.driver)
        self.note(mark("takes control"))

    def note(self, what: str) -> None:
        """Write down for all visitors what this one has done."""
        log.info("%s: %s by %s", self.link.name, what, self.visitor.name)
        self.link.acts.append((time.time(), self.visitor.name, what))

    async def do(self, method: str, name: str, action: Action) -> bool:
        """Carry an action out, where the visitor may call its method; whether it was."""
        return self.allowed(method) and await self._carry_out(name, action)

    async def _carry_out(self, name: str, action: Action) -> bool:
        self.note(name)
        try:
            await action(self.link.connected())
        except (MotionError, McError) as error:
            show_refusal(f"{t(name)}: {t(error.message)} [{error.code}]", error.hint)
            return False
        return True

    async def hold(self) -> None:
        """Hold what runs; what is still being checked does not start."""
        await self._stop("hold", mark("hold"), lambda machine: machine.hold())

    async def abort(self) -> None:
        """End what runs; what is still being checked does not start."""
        await self._stop("abort", mark("abort"), lambda machine: machine.abort())

    async def _stop(self, method: str, name: str, order: Action) -> None:
        async def stop(machine: Machine) -> None:
            self.link.jobs.stop_checking()
            await order(machine)

        await self.do(method, name, stop)

    async def emergency_stop(self) -> None:
        """Every visitor may stop; what waits in the queue does not start either."""
        self.link.jobs.stop()
        reason = f"by {self.visitor.name} on the page"
        # whoever has the button before them may press it: a login that has just ended does not matter
        if await self._carry_out(mark("emergency stop"), lambda machine: machine.estop(reason)):
            ui.notify(t("emergency stop confirmed"), type="warning", position="bottom")
