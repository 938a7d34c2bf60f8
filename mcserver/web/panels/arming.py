"""Runs that somebody asked for, such as an agent: what would happen, and the buttons to arm or reject it."""

from __future__ import annotations

import html
import math
from functools import partial
from typing import Any

from mcclient.switches import switches_said
from nicegui import ui

from mcserver.gcode.text.source import split_lines
from mcserver.web.actions import Actions
from mcserver.web.formatting import axis_name, clock_text, diagnostics_html, position_text
from mcserver.web.panels.card import card
from mcserver.web.panels.kept_rows import KeptRows
from mcserver.web.run_requests import RunToArm
from mcserver.web.translation import mark, t

SECONDS = {30: "30 s", 60: "1 min", 300: "5 min", 1800: "30 min"}
STANDING = {0: mark("this run"), 900: mark("and for 15 min"), 3600: mark("and for 1 h")}
OVERRIDES = {10: "10 %", 25: "25 %", 50: "50 %", 75: "75 %", 100: "100 %"}


class ArmingPanel:
    """A part for each request: who asks, picture, extents, duration and text; and what is approved for a
    while, which ends here too. Hidden without any.
    """

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._shown: dict[tuple[str, int], RunToArm] = {}
        self._buttons: dict[tuple[str, int], tuple[ui.button, ui.button]] = {}
        with card(t("Runs to arm")) as self._card:
            self._list = KeptRows(self._one)
            self._list.element.props(f'role=region aria-label="{t("Runs to arm")}"')
            self._standing = KeptRows(self._approval)
            self._standing.element.props(f'role=region aria-label="{t("Approved")}"')
        self._card.set_visibility(False)

    def update(self) -> None:
        """Show what is asked for now; a request that was made anew is built anew, with what it is now."""
        requests = self._actions.link.run_requests
        self._shown = {each.key: each for each in requests.shown}
        self._list.show({key: _state_text(each) for key, each in self._shown.items()})
        self._standing.show({run["sha256"]: _approval_text(run) for run in requests.approvals})
        self._card.set_visibility(bool(requests.shown or requests.approvals))
        for key in self._buttons.keys() - self._shown.keys():
            del self._buttons[key]
        for key, each in self._shown.items():
            arm, reject = self._buttons[key]
            arm.set_enabled(each.run["state"] == "waiting" and not each.run.get("changed"))
            reject.set_enabled(each.run["state"] in ("waiting", "armed"))

    def _one(self, key: tuple[str, int]) -> ui.label:
        each = self._shown[key]
        run = each.run
        with ui.column().classes("w-full gap-1 mb-4").props(f'data-run="{run["sha256"][:12]}"'):
            ui.html(_heading(each), sanitize=False)
            # numbers alone: the picture has no word of whoever wrote the program
            ui.html(f'<div class="overflow-x-auto">{each.picture}</div>', sanitize=False).classes("w-full")
            ui.html(_warnings(each) + _extents(each) + _effects(each), sanitize=False).classes("w-full")
            with ui.expansion(t("Program, {count} lines", count=len(each.text.splitlines()))).classes(
                "w-full"
            ):
                ui.html(_listing(each.text), sanitize=False).classes("w-full max-h-80 overflow-auto")
            with ui.row().classes("w-full items-center gap-2"):
                seconds = ui.select(SECONDS, value=60, label=t("Within")).classes("min-w-24")
                override = ui.select(OVERRIDES, value=100, label=t("Override up to")).classes("min-w-28")
                # all that stays inside of this run's envelope
                standing = ui.select(
                    {each: t(text) for each, text in STANDING.items()}, value=0, label=t("Approve")
                ).classes("min-w-32")
                arm = ui.button(
                    t("Arm once"), on_click=partial(self._arm, each, seconds, override, standing)
                ).props("color=warning")
                reason = ui.input(
                    t("Reason"), validation={t("at most 500 characters"): lambda said: len(said) <= 500}
                )
                reject = ui.button(t("Reject"), on_click=partial(self._reject, each, reason)).props("outline")
                self._buttons[key] = arm, reject
            return ui.label("").props("aria-live=polite")

    def _approval(self, sha256: str) -> ui.label:
        with ui.row().classes("w-full items-center gap-2"):
            text = ui.label("")
            ui.button(t("End"), on_click=partial(self._end, sha256)).props("outline")
        return text

    async def _end(self, sha256: str) -> None:
        await self._actions.do(
            "reject",
            mark("end the approval {sha256}", sha256=sha256[:12]),
            lambda machine: machine.reject(sha256),
        )

    async def _reject(self, each: RunToArm, reason: ui.input) -> None:
        run, said = each.run, str(reason.value or "")[:500]
        await self._actions.do(
            "reject",
            mark("reject {sha256}", sha256=run["sha256"][:12]),
            lambda machine: machine.reject(run["sha256"], said, number=run["number"]),
        )

    async def _arm(
        self, each: RunToArm, seconds: ui.select, override: ui.select, standing: ui.select
    ) -> None:
        run = each.run
        await self._actions.do(
            "arm",
            mark("arm {sha256}", sha256=run["sha256"][:12]),
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
    asked = t(
        "{client} asks for {run}",
        client=f"<b>{html.escape(run['client'])}</b>",
        run=f"{name}{clock_text(run['duration_s'])}",
    )
    return (
        f"{asked} "
        f'<span class="text-xs">({run["duration_s"]:.3f} s)</span> '
        f"<code>{html.escape(run['sha256'][:12])}</code>"
    )


def _warnings(each: RunToArm) -> str:
    """HTML: what the check and the simulation warn of, each with the line that it is about."""
    shown = len(each.warnings)
    head = t("Warnings: {count}", count=shown + each.unshown)
    if each.unshown:
        head += t(", the first {count} shown", count=shown)
    head = f"<b>{head}</b>"
    return diagnostics_html(each.warnings, head, split_lines(each.text))


def _extents(each: RunToArm) -> str:
    """HTML: how far each axis goes, over every cycle of the simulation."""
    rows = "".join(_axis_row(part) for part in each.run["extents"])
    for tool in each.run.get("tools", []):
        for letter, low, high in zip("XYZ", tool["low"], tool["high"], strict=True):
            speed = f"{tool['speed']:.1f} mm/s" if letter == "X" else ""
            rows += _row(
                t("tool {number} {letter}", number=tool["tool"], letter=letter),
                low,
                f"{position_text(high)} mm",
                speed,
            )
    head = (
        f"<tr><th>{t('Axis')}</th><th class=n>{t('from')}</th><th class=n>{t('to')}</th>"
        f"<th class=n>{t('up to')}</th></tr>"
    )
    return f'<table class="mc-positions">{head}{rows}</table>'


def _axis_row(part: dict[str, Any]) -> str:
    unit = html.escape(part["unit"])
    speed = f"{part.get('speed', 0.0):.1f} {unit}/s"
    if part.get("turns"):
        name = axis_name(part["axis"])
        return f"<tr><td>{name}</td><td class=n colspan=2>{t('turns')}</td><td class=n>{speed}</td></tr>"
    return _row(axis_name(part["axis"]), part["low"], f"{position_text(part['high'])} {unit}", speed)


def _row(name: str, low: float, high: str, speed: str) -> str:
    return (
        f"<tr><td>{name}</td><td class=n>{position_text(low)}</td><td class=n>{high}</td>"
        f"<td class=n>{speed}</td></tr>"
    )


def _effects(each: RunToArm) -> str:
    """HTML: switches of the run, and what it leaves changed for those that come after it."""
    run, effects = each.run, each.run.get("effects", [])
    switched = switches_said(run["block_delete"], run["optional_stop"])
    said = "".join(f"<p>{t(what)}</p>" for what in switched)
    if not effects:
        return said
    items = "".join(f"<li>{html.escape(t(effect))}</li>" for effect in effects)
    after = t("Afterwards, for every later program, this run")
    return f"{said}<p>{after}</p><ul class='mc-effects'>{items}</ul>"


def _listing(text: str) -> str:
    """HTML: the whole program with its line numbers."""
    lines = text.splitlines()
    width = len(str(len(lines)))
    shown = "\n".join(f"{number:{width}}  {html.escape(line)}" for number, line in enumerate(lines, 1))
    return f'<pre class="mc-program" tabindex="0" aria-label="{t("Program to arm")}">{shown}</pre>'


def _approval_text(run: dict[str, Any]) -> str:
    return t(
        "{client} may run what stays inside of {sha256} for another {time}, up to {override:g} %:"
        " approved by {operator}",
        client=run["client"],
        sha256=run["sha256"][:12],
        time=clock_text(run["remaining_s"]),
        override=run["override"],
        operator=run["operator"],
    )


def _state_text(each: RunToArm) -> str:
    run = each.run
    left, by, override = f"{math.ceil(run['remaining_s'])} s", run.get("operator"), run.get("override")
    changed = run.get("changed", [])
    if changed:
        what = "; ".join(map(t, changed))
        return t("cannot start as it was simulated: {what}. It has to be asked for again", what=what)
    if run["state"] == "waiting":
        beyond = "; ".join(map(t, run.get("beyond", [])))
        outside = t("Outside of what is approved for a while: {what}", what=beyond) if beyond else ""
        waits = t("waits for an operator, for another {time}", time=left)
        return f"{waits}. {outside}" if outside else waits
    if run["state"] == "armed":
        return t(
            "armed by {operator} up to {override:g} %: may be started once within {time}",
            operator=by,
            override=override,
            time=left,
        )
    if run["state"] == "rejected":
        return t("rejected by {operator}", operator=by) + (f": {run['reason']}" if run["reason"] else "")
    return t("started")
