"""Runs that somebody asked for, such as an agent: what would happen, and the buttons to arm or reject it."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from functools import partial
from typing import Any

from nicegui import ui

from mcserver.gcode.text.source import split_lines
from mcserver.web.actions import Actions
from mcserver.web.formatting import axis_name, clock_text, diagnostics_html, position_text
from mcserver.web.run_requests import RunToArm

SECONDS = {30: "30 s", 60: "1 min", 300: "5 min", 1800: "30 min"}
STANDING = {0: "this run", 900: "and for 15 min", 3600: "and for 1 h"}
OVERRIDES = {10: "10 %", 25: "25 %", 50: "50 %", 75: "75 %", 100: "100 %"}


class ArmingPanel:
    """A part for each request: who asks, picture, extents, duration and text; and what is approved for a
    while, which ends here too. Hidden without any.
    """

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._known: tuple[tuple[str, int], ...] = ()
        self._states: dict[tuple[str, int], ui.label] = {}
        self._buttons: dict[tuple[str, int], tuple[ui.button, ui.button]] = {}
        self._approvals: dict[str, ui.label] = {}
        self._card = ui.card().classes("mc-card")
        with self._card:
            ui.html("<h2>Runs to arm</h2>", sanitize=False)
            self._list = ui.column().classes("w-full gap-4").props('role=region aria-label="Runs to arm"')
            self._standing = ui.column().classes("w-full gap-1").props('role=region aria-label="Approved"')
        self._card.set_visibility(False)

    def update(self) -> None:
        """Show what is asked for now; a request that was made anew is built anew, with what it is now."""
        shown = self._actions.link.run_requests.shown
        keys = tuple(each.key for each in shown)
        if keys != self._known:
            self._known = keys
            self._build(shown)
        approvals = self._actions.link.run_requests.approvals
        if [each["sha256"] for each in approvals] != [*self._approvals]:
            self._build_approvals(approvals)
        for run in approvals:
            self._approvals[run["sha256"]].set_text(_approval_text(run))
        self._card.set_visibility(bool(shown or approvals))
        for each in shown:
            self._states[each.key].set_text(_state_text(each))
            arm, reject = self._buttons[each.key]
            arm.set_enabled(each.run["state"] == "waiting" and not each.run.get("changed"))
            reject.set_enabled(each.run["state"] in ("waiting", "armed"))

    def _build(self, shown: tuple[RunToArm, ...]) -> None:
        self._states, self._buttons = {}, {}
        self._list.clear()
        with self._list:
            for each in shown:
                self._one(each)

    def _one(self, each: RunToArm) -> None:
        run = each.run
        with ui.column().classes("w-full gap-1").props(f'data-run="{run["sha256"][:12]}"'):
            ui.html(_heading(each), sanitize=False)
            # numbers alone: the picture has no word of whoever wrote the program
            ui.html(f'<div class="overflow-x-auto">{each.picture}</div>', sanitize=False).classes("w-full")
            ui.html(_warnings(each) + _extents(each) + _effects(each), sanitize=False).classes("w-full")
            with ui.expansion(f"Program, {len(each.text.splitlines())} lines").classes("w-full"):
                ui.html(_listing(each.text), sanitize=False).classes("w-full max-h-80 overflow-auto")
            with ui.row().classes("w-full items-center gap-2"):
                seconds = ui.select(SECONDS, value=60, label="Within").classes("min-w-24")
                override = ui.select(OVERRIDES, value=100, label="Override up to").classes("min-w-28")
                # all that stays inside of this run's envelope
                standing = ui.select(STANDING, value=0, label="Approve").classes("min-w-32")
                arm = ui.button(
                    "Arm once", on_click=partial(self._arm, each, seconds, override, standing)
                ).props("color=warning")
                reason = ui.input(
                    "Reason", validation={"at most 500 characters": lambda said: len(said) <= 500}
                )
                reject = ui.button("Reject", on_click=partial(self._reject, each, reason)).props("outline")
                self._buttons[each.key] = arm, reject
            self._states[each.key] = ui.label("").props("aria-live=polite")

    def _build_approvals(self, approvals: Sequence[dict[str, Any]]) -> None:
        self._approvals = {}
        self._standing.clear()
        with self._standing:
            for run in approvals:
                with ui.row().classes("w-full items-center gap-2"):
                    self._approvals[run["sha256"]] = ui.label("")
                    ui.button("End", on_click=partial(self._end, run["sha256"])).props("outline")

    async def _end(self, sha256: str) -> None:
        await self._actions.do(
            "reject", f"end the approval {sha256[:12]}", lambda machine: machine.reject(sha256)
        )

    async def _reject(self, each: RunToArm, reason: ui.input) -> None:
        run, said = each.run, str(reason.value or "")[:500]
        await self._actions.do(
            "reject",
            f"reject {run['sha256'][:12]}",
            lambda machine: machine.reject(run["sha256"], said, number=run["number"]),
        )

    async def _arm(
        self, each: RunToArm, seconds: ui.select, override: ui.select, standing: ui.select
    ) -> None:
        run = each.run
        await self._actions.do(
            "arm",
            f"arm {run['sha256'][:12]}",
            # what is on the screen: the same text asked for anew since is another run
            lambda machine: machine.arm(
                run["sha256"],
                seconds=float(seconds.value),
                override=float(override.value),
                number=run["number"],
                standing_s=float(standing.value),
            ),
        )


def _heading(each: RunToArm) -> str:
    """HTML: who asks for what; names are data that anybody may have written."""
    run = each.run
    name = f"“{html.escape(run['name'])}”, " if run["name"] else ""
    return (
        f"<b>{html.escape(run['client'])}</b> asks for {name}{clock_text(run['duration_s'])} "
        f'<span class="text-xs">({run["duration_s"]:.3f} s)</span> '
        f"<code>{html.escape(run['sha256'][:12])}</code>"
    )


def _warnings(each: RunToArm) -> str:
    """HTML: what the check and the simulation warn of, each with the line that it is about."""
    more = f" and {each.unshown} more" if each.unshown else ""
    head = f"<b>{len(each.warnings)} warning{'s' * (len(each.warnings) != 1)}{more}</b>"
    return diagnostics_html(each.warnings, head, split_lines(each.text))


def _extents(each: RunToArm) -> str:
    """HTML: how far each axis goes, over every cycle of the simulation."""
    rows = "".join(_axis_row(part) for part in each.run["extents"])
    for tool in each.run.get("tools", []):
        for letter, low, high in zip("XYZ", tool["low"], tool["high"], strict=True):
            speed = f"{tool['speed']:.1f} mm/s" if letter == "X" else ""
            rows += _row(f"tool {tool['tool']} {letter}", low, f"{position_text(high)} mm", speed)
    head = "<tr><th>Axis</th><th class=n>from</th><th class=n>to</th><th class=n>up to</th></tr>"
    return f'<table class="mc-positions">{head}{rows}</table>'


def _axis_row(part: dict[str, Any]) -> str:
    unit = html.escape(part["unit"])
    speed = f"{part.get('speed', 0.0):.1f} {unit}/s"
    if part.get("turns"):
        name = axis_name(part["axis"])
        return f"<tr><td>{name}</td><td class=n colspan=2>turns</td><td class=n>{speed}</td></tr>"
    return _row(axis_name(part["axis"]), part["low"], f"{position_text(part['high'])} {unit}", speed)


def _row(name: str, low: float, high: str, speed: str) -> str:
    return (
        f"<tr><td>{name}</td><td class=n>{position_text(low)}</td><td class=n>{high}</td>"
        f"<td class=n>{speed}</td></tr>"
    )


def _effects(each: RunToArm) -> str:
    """HTML: what the run leaves changed for those that come after it."""
    effects = each.run.get("effects", [])
    if not effects:
        return ""
    items = "".join(f"<li>{html.escape(effect)}</li>" for effect in effects)
    return f"<p>Afterwards, for every later program, this run</p><ul class='mc-effects'>{items}</ul>"


def _listing(text: str) -> str:
    """HTML: the whole program with its line numbers."""
    lines = text.splitlines()
    width = len(str(len(lines)))
    shown = "\n".join(f"{number:{width}}  {html.escape(line)}" for number, line in enumerate(lines, 1))
    return f'<pre class="mc-program" tabindex="0" aria-label="Program to arm">{shown}</pre>'


def _approval_text(run: dict[str, Any]) -> str:
    left, limit = clock_text(run["remaining_s"]), f"{run['override']:g} %"
    return (
        f"{run['client']} may run what stays inside of {run['sha256'][:12]} for another {left}, "
        f"up to {limit}: approved by {run['operator']}"
    )


def _state_text(each: RunToArm) -> str:
    run = each.run
    left = f"{math.ceil(run['remaining_s'])} s"
    changed = run.get("changed", [])
    if changed:
        return f"cannot start as it was simulated: {'; '.join(changed)}. It has to be asked for again"
    if run["state"] == "waiting":
        beyond = run.get("beyond", [])
        outside = f". Outside of what is approved for a while: {'; '.join(beyond)}" if beyond else ""
        return f"waits for an operator, for another {left}{outside}"
    if run["state"] == "armed":
        return f"armed by {run['operator']} up to {run['override']:g} %: may be started once within {left}"
    if run["state"] == "rejected":
        return f"rejected by {run['operator']}" + (f": {run['reason']}" if run["reason"] else "")
    return "started"
