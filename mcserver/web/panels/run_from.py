"""A run that begins in the middle: where the axes are, where the program would be there, and the question."""

from __future__ import annotations

import html
from collections.abc import Mapping

from mcclient import MachineStatus, MotionError
from mcclient.types import SimulateReply
from nicegui import ui

from mcserver.errors import McError
from mcserver.web.actions import Actions, show_refusal
from mcserver.web.dialogs import ask
from mcserver.web.formatting import axis_name, is_live, position_text
from mcserver.web.jobs import SIMULATED_BYTES

# What counts as being there already [mm, deg].
NEAR = 0.001


async def ask_run_from(actions: Actions, name: str, from_line: int) -> bool:
    """Show where a stored program would be at the line, and ask; whether it shall run from there."""
    try:
        text = actions.link.store.read(name)
        machine = actions.link.connected()
        status = await machine.status()
    except (MotionError, McError) as error:
        show_refusal(f"{error.message} [{error.code}]", error.hint)
        return False
    lines = text.split("\n")
    if not 1 <= from_line <= len(lines):
        show_refusal(f"{name} has no line {from_line}", f"it has {len(lines)} lines")
        return False
    now = dict(zip(status.axes.index, status.axes.setpoint, strict=True))
    before = "\n".join(lines[: from_line - 1])
    there: dict[int, float] | None = None
    if len(before) <= SIMULATED_BYTES:
        try:
            there = end_of(await machine.simulate(before, positions=now))
        except MotionError as error:
            show_refusal(f"where the axes would be is not known: {error.message} [{error.code}]", error.hint)
    shown = start_html(lines[from_line - 1], now, there, status)
    return await ask(
        f"Run {name} from line {from_line}?",
        f"Run from line {from_line}",
        colour="positive",
        details=lambda: ui.html(shown, sanitize=False).classes("w-full overflow-x-auto"),
    )


def end_of(report: SimulateReply) -> dict[int, float] | None:
    """Return where the axes end by a simulation [mm, deg]; None where it found a fault."""
    return {int(index): axis.position for index, axis in report.axes.items()} if report.ok else None


def start_html(
    line: str, now: Mapping[int, float], there: Mapping[int, float] | None, status: MachineStatus
) -> str:
    """Return the line and, of each axis that is elsewhere, both places, as HTML.

    Args:
        now: where the axes are. there: where the program would have them before the line; None: not known.
    """
    shown = f'<pre class="mc-program" tabindex="0" aria-label="First line">{html.escape(line[:200])}</pre>'
    if any(is_live(program) for program in status.programs):
        shown += "<p>Another program is open: the axes will be where it leaves them.</p>"
    off = [
        axis_name(axis)
        for axis, word in zip(status.axes.index, status.axes.state, strict=True)
        if word == "off" and (there is None or axis in there)
    ]
    if off:
        shown += f"<p>Without energy: {', '.join(off)}. Lines before this one that energize do not run.</p>"
    if there is None:
        return shown + "<p><b>Where the program would have its axes before this line is not known.</b></p>"
    rows = "".join(
        f"<tr><td>{axis_name(axis)}</td><td class=n>{position_text(now.get(axis, 0.0))}</td>"
        f"<td class=n>{position_text(at)}</td></tr>"
        for axis, at in sorted(there.items())
        if abs(at - now.get(axis, 0.0)) > NEAR
    )
    if not rows:
        return shown + "<p>The axes are where the program has them before this line.</p>"
    head = "<tr><th>Axis</th><th class=n>is at</th><th class=n>program starts this line at</th></tr>"
    return (
        shown
        + f'<table class="mc-positions"><thead>{head}</thead><tbody>{rows}</tbody></table>'
        + "<p><b>The axes are elsewhere.</b> Units, feed rate and modes are those of the lines before, but "
        "none of these lines moves: the first motion goes from where the axes are, through whatever is "
        "between.</p>"
    )
