"""Values as operators read them."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence

from mcclient import AxisInfo, Diagnostic, MachineStatus, ProgramStatus
from mcclient.types import ENDED

from mcserver.web.translation import mark, t

LETTERS = "XYZABC"
CONTEXT_LINES = 6
DIAGNOSTICS_SHOWN = 50
# Of a number that is typed in [mm, deg, min]: a finger that has slipped, not a machine of a kilometre.
MOST = 1e6
# Characters of a program's line.
LINE_SHOWN = 200


def axis_name(index: int) -> str:
    """X Y Z A B C for axes 0-5, else ``[n]``, as programs write them (D-02)."""
    return LETTERS[index] if index < len(LETTERS) else f"[{index}]"


def clock_text(seconds: float | None) -> str:
    """``1:05`` or ``2:03:04``; a dash where it is not known."""
    if seconds is None:
        return "–"
    whole = max(0, round(seconds))
    hours, minutes = divmod(whole // 60, 60)
    return f"{hours}:{minutes:02}:{whole % 60:02}" if hours else f"{minutes}:{whole % 60:02}"


def remaining_text(program: ProgramStatus) -> str:
    """Time until a program's end; a lower bound where only what is planned of it is known, an estimate while
    its simulation is under way. Pauses are counted beside it."""
    if program.duration_s is None and program.eta_s is not None:
        return f"≥ {clock_text(program.eta_s)}"
    shown = clock_text(program.eta_s)
    if program.simulated < 1.0:
        shown = f"≈ {shown}"
    if program.pauses > 1:
        return t("{time} + {count} pauses", time=shown, count=program.pauses)
    return t("{time} + 1 pause", time=shown) if program.pauses else shown


def size_text(size: float) -> str:
    """``12 KiB`` or ``3.4 MiB``."""
    for unit in ("B", "KiB", "MiB"):
        if size < 1024.0:
            return f"{size:.0f} {unit}" if unit != "MiB" else f"{size:.1f} {unit}"
        size /= 1024.0
    return f"{size:.2f} GiB"


def position_text(value: float) -> str:
    """Thousandths, without a negative zero."""
    text = f"{value:.3f}"
    return text if text != "-0.000" else "0.000"


def velocity_text(value: float) -> str:
    """Tenths, without a negative zero."""
    text = f"{value:.1f}"
    return text if text != "-0.0" else "0.0"


def limits_text(axis: AxisInfo) -> str:
    """Travel of an axis with its unit."""
    if axis.min_position is None and axis.max_position is None:
        return t("unlimited")
    low = "-∞" if axis.min_position is None else f"{axis.min_position:g}"
    high = "∞" if axis.max_position is None else f"{axis.max_position:g}"
    return f"{low} … {high} {axis.unit}"


def banner(status: MachineStatus | None, online: bool) -> tuple[str, str]:
    """The one word for a machine's state (`t` says it), and its kind for the colour: an emergency stop before
    all else."""
    if status is None or not online:
        return mark("offline"), "offline"
    if status.state == "estop":
        return mark("EMERGENCY STOP"), "estop"
    if status.state == "fault":
        return "fault", "fault"
    states = {program.state for program in status.programs}
    for state, kind in (("held", "held"), ("paused", "held"), ("running", "moving"), ("ending", "moving")):
        if state in states:
            return state, kind
    if "moving" in status.axes.state or "speed" in status.axes.state:
        return "moving", "moving"
    return "ready", "ready"


def current_program(status: MachineStatus | None) -> ProgramStatus | None:
    """The program to show: one that runs, else one that waits, else the one that ended last."""
    if status is None or not status.programs:
        return None
    order = {"running": 0, "held": 0, "paused": 0, "ending": 1, "queued": 2}
    return min(status.programs, key=lambda each: (order.get(each.state, 3), -each.opened_at))


def is_live(program: ProgramStatus | None) -> bool:
    """Whether a program has not ended."""
    return program is not None and program.state not in ENDED


def program_excerpt(
    lines: Sequence[str], now: int, faulty: dict[int, str], context: int = CONTEXT_LINES
) -> str:
    """HTML of ``context`` lines before and after line ``now`` (from 1); it and faulty ones are marked."""
    first = max(1, min(now - context, len(lines) - 2 * context))
    rows = []
    for number in range(first, min(len(lines), first + 2 * context) + 1):
        text = html.escape(f"{number:>6}  {lines[number - 1][:LINE_SHOWN]}")
        kind = "bad" if number in faulty else "now" if number == now else "mark"
        rows.append(f'<span class="{kind}" data-line="{number}">{text or " "}</span>')
        if number in faulty:
            rows.append(f'<span class="mark">        {html.escape(t(faulty[number]))}</span>')
    return f'<pre class="mc-program" tabindex="0" aria-label="{t("Program text")}">{"".join(rows)}</pre>'


def diagnostics_html(diagnostics: Sequence[Diagnostic], head: str = "", lines: Sequence[str] = ()) -> str:
    """HTML of what was found in a program or a machine file: in the colour of a fault where one is among it.

    Args:
        head: stands above, as HTML. lines: of the program, of which those that are named are shown.
    """
    if not diagnostics:
        return ""
    rows = [
        f"<li>{'' if each.severity == 'error' else t('warning, ')}{_place(each)}"
        f"{html.escape(t(each.message))} [{html.escape(each.code)}]"
        + _named_line(lines, each.line)
        + (f"<br>= {html.escape(page_hint(each.hint))}" if each.hint else "")
        + "</li>"
        for each in diagnostics[:DIAGNOSTICS_SHOWN]
    ]
    kind = "mc-faults" if any(each.severity == "error" for each in diagnostics) else "mc-warnings"
    return f'<div class="{kind}">{head}<ul>{"".join(rows)}</ul></div>'


def _named_line(lines: Sequence[str], number: int) -> str:
    if not 0 < number <= len(lines):
        return ""
    return f"<br><code>{html.escape(lines[number - 1][:LINE_SHOWN])}</code>"


def _place(diagnostic: Diagnostic) -> str:
    if not diagnostic.line:
        return ""
    if not diagnostic.column:
        return t("line {line}: ", line=diagnostic.line)
    return t("line {line}, column {column}: ", line=diagnostic.line, column=diagnostic.column)


# what the page has in the place of a command
_COMMANDS = {
    "home": mark("press Home in the card Homing"),
    "reference": mark("give the position in the card Homing"),
    "reset": mark("press Reset"),
    "resume": mark("press Resume"),
    "tables": mark("press Change a tool …"),
    "zero": mark("use Zero or Set in the card Position"),
    "run": mark("run it from the line"),
    "continue": mark("press Continue"),
    "arm": mark("use the card Runs to arm"),
    "programs": mark("the card of what was broken off"),
    "status": mark("the card Position"),
    "send": mark("type"),
    "record": mark("the card Recordings"),
    "drives": mark("the card Drives"),
    "list": mark("the page of all machines"),
    # of the SDK that runs the page's programs
    "program": mark("run it again"),
}
_COMMAND = re.compile(
    r"(?:machine\.continue_program\([^)]*\), or )?`?mcctl"
    rf" ({'|'.join(_COMMANDS)})\b"
    r"(?: (?:--[a-z-]+|[A-Z][A-Z0-9=.-]*|\[\d+\]|\d+|list))*`?"
    r"|open another one with machine\.(program)\(\)"
)


def page_hint(hint: str) -> str:
    """Return a remedy with the page's own buttons in the place of commands of a terminal."""
    return _COMMAND.sub(lambda found: t(_COMMANDS[found[1] or found[2]]), t(hint))


def channel_text(kind: str, value: float, unit: str) -> str:
    """An input's or output's value: on, off, or a number with its unit."""
    if kind == "digital":
        return t("on") if value else t("off")
    return f"{value:g} {unit}".rstrip()
