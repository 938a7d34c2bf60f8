"""What one browser holds down: buttons of the jog pads, of axes and of tools, one at a time."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from nicegui import events, ui

from mcserver.web.actions import Actions, show_error
from mcserver.web.delays import event_delay_s
from mcserver.web.jogging import HeldJog, Move


@dataclass(frozen=True)
class JogPad:
    """The buttons of one pad, ``data-jog`` names it.

    Attributes:
        method: what a press needs to be allowed.
        step: carries out a press of a step (what is pressed, its direction ±1).
        move: the move of a press that is held; None: steps are chosen, or there is no such button.
    """

    method: str
    step: Callable[[str, int], Awaitable[None]]
    move: Callable[[str, int], Move | None]


class HeldButtons:
    """Passes what the browser's part (static/page.js) says on to the pad that is pressed."""

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._held: HeldJog | None = None
        self._pads: dict[str, JogPad] = {}
        ui.on("mc_jog", self._on_jog)

    def add(self, name: str, pad: JogPad) -> None:
        self._pads[name] = pad

    async def release(self) -> None:
        """Stop what this browser holds: it has gone."""
        if self._held is not None:
            await self._held.release()

    async def _on_jog(self, event: events.GenericEventArguments) -> None:
        message: dict[str, Any] = event.args
        kind = message.get("kind")
        if kind == "release":
            await self.release()
            return
        try:
            press, pad = int(message["press"]), self._pads[message["pad"]]
            what, direction = str(message["what"]), 1 if int(message["direction"]) > 0 else -1
        except (KeyError, TypeError, ValueError):
            return
        if kind == "press" and not self._actions.allowed(pad.method):
            return
        if not self._actions.has_control:
            # it was taken away, or the login has ended
            await self.release()
            return
        machine = self._actions.link.machine
        if machine is None:
            return
        if self._held is None:
            self._held = HeldJog(machine, show_error)
        self._held.machine = machine
        if kind == "keep":
            await self._held.keep(press, event_delay_s.get())
        elif kind == "press":
            move = pad.move(what, direction)
            if move is None:
                await pad.step(what, direction)
            else:
                await self._held.press(press, move, event_delay_s.get())
