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
from mcserver.web.formatting import page_hint
from mcserver.web.link import MachineLink
from mcserver.web.sessions import Visitor

log = logging.getLogger(__name__)

Action = Callable[[Machine], Awaitable[object]]


def show_refusal(message: str, hint: str = "") -> None:
    """A sentence and its remedy, until it is closed. Below: above are the buttons that stop, on a phone."""
    ui.notify(
        message + (f" — {page_hint(hint)}" if hint else ""),
        type="negative",
        position="bottom",
        close_button="close",
        timeout=8000,
    )


def show_role_refusal(method: str) -> None:
    """Say which roles may call a method."""
    show_refusal(f"This needs the role {roles_named(BY_NAME[method].roles)}", "log in as somebody who has it")


class Actions:
    """Bound to one visitor and one machine.

    Args:
        visitor: who acts. link: on what.
    """

    def __init__(self, visitor: Visitor, link: MachineLink) -> None:
        self.visitor = visitor
        self.link = link

    def allowed(self, method: str) -> bool:
        """Whether the visitor may call a method; says so where not."""
        if self.visitor.may(method):
            return True
        show_role_refusal(method)
        return False

    async def do(self, method: str, name: str, action: Action) -> bool:
        """Carry an action out, where the visitor may call its method; whether it was."""
        return self.allowed(method) and await self._carry_out(name, action)

    async def _carry_out(self, name: str, action: Action) -> bool:
        log.info("%s: %s by %s", self.link.name, name, self.visitor.name)
        self.link.acts.append((time.time(), self.visitor.name, name))
        try:
            await action(self.link.connected())
        except (MotionError, McError) as error:
            show_refusal(f"{name}: {error.message} [{error.code}]", error.hint)
            return False
        return True

    async def emergency_stop(self) -> None:
        """Every visitor may stop; what waits in the queue does not start either."""
        self.link.jobs.stopped = True
        self.link.jobs.clear()
        reason = f"by {self.visitor.name} on the page"
        # whoever has the button before them may press it: a login that has just ended does not matter
        if await self._carry_out("emergency stop", lambda machine: machine.estop(reason)):
            ui.notify("emergency stop confirmed", type="warning", position="bottom")
