"""A dry run: where a program will go, how long it takes and what slows it down, before anything moves."""

from __future__ import annotations

import html
from collections.abc import Callable

from mcclient import MotionError
from mcclient.types import RunRoleWord, SimulateReply
from nicegui import ui

from mcserver.web.actions import Actions, show_error
from mcserver.web.dialogs import NamedDialog
from mcserver.web.formatting import axis_name, clock_text, diagnostics_html, program_excerpt
from mcserver.web.jobs import PATH_POINTS, Switches, path_from_line
from mcserver.web.panels.linked_text import LinkedText
from mcserver.web.panels.picture import tips_of
from mcserver.web.space import Space
from mcserver.web.translation import t

# Lines that are listed as slower than they were asked to be, and from which factor on.
SLOW_LINES = 8
SLOW_FROM = 1.05


async def show_dry_run(
    actions: Actions,
    name: str,
    text: str,
    from_line: int,
    switches: Switches,
    run: Callable[[SimulateReply], bool],
) -> None:
    """Simulate a program from where the axes are, and show it with a button that runs it.

    Args:
        run: begins it; whether it was.
    """
    if not actions.allowed("simulate"):
        return
    waiting = ui.notification(
        t("{name} is being simulated", name=name), spinner=True, timeout=None, position="bottom"
    )
    try:
        machine = actions.link.connected()
        status = await machine.status()
        start = dict(zip(status.axes.index, status.axes.setpoint, strict=True))
        role: RunRoleWord = "operator" if actions.visitor.may("open") else "agent"
        report = await machine.simulate(
            text, positions=start, path_points=PATH_POINTS, role=role, **switches._asdict()
        )
    except MotionError as error:
        show_error(error)
        return
    finally:
        waiting.dismiss()

    with NamedDialog(t("Dry run of {name}", name=name)) as dialog, ui.card().classes("mc-dry-run"):
        dialog.on("hide", dialog.delete)
        with ui.row().classes("w-full items-center justify-between no-wrap"):
            ui.label(t("Dry run of {name}", name=name)).classes("font-bold break-all")
            ui.button(t("Close"), on_click=dialog.close).props("flat")
        ui.html(report_html(text, report, from_line), sanitize=False).classes("w-full overflow-x-auto")
        if not report.ok or report.path is None:
            dialog.open()
            return
        with ui.element("div").classes("mc-path-and-text"):
            space = Space(t("the path of {name}", name=name), f"/machine/{actions.link.name}/model").classes(
                "mc-trail"
            )
            linked = LinkedText(text.removesuffix("\n").split("\n"), space, from_line)
        path = path_from_line(report.path, from_line)
        axes = dict(zip(status.axes.index, status.axes.position, strict=True))

        def draw() -> None:
            space.plan(path)
            space.place(axes, tips_of(status), 0, {})
            linked.show()

        def start_it() -> None:
            if run(report):
                dialog.close()

        space.on("ready", draw, args=[])
        word = t("Run it") if from_line <= 1 else t("Run it from line {line}", line=from_line)
        ui.button(word, on_click=start_it).props("color=positive")
    dialog.open()


def report_html(text: str, report: SimulateReply, from_line: int = 1) -> str:
    """Return the report of a simulation as HTML: its time, the axes' travel, faults and slow lines."""
    faults = report.diagnostics
    listed = diagnostics_html(faults)
    if not report.ok:
        faulty = {each.line: each.message for each in faults if each.severity == "error"}
        return listed + program_excerpt(text.split("\n"), min(faulty, default=1), faulty)
    whole = " " + t("for the whole program") if from_line > 1 else ""
    length = t("{length:.1f} mm at feed rates", length=report.feed_length_mm)
    return (
        f"<p><b>{clock_text(report.duration_s)}</b>{whole}, {length}</p>"
        f"{listed}{_extents(report)}{_slow_lines(report)}"
    )


def _extents(report: SimulateReply) -> str:
    rows = "".join(
        f"<tr><td>{axis_name(int(index))}</td><td class=n>{axis.min:.3f}</td>"
        f"<td class=n>{axis.max:.3f}</td><td class=n>{axis.position:.3f} {axis.unit}</td></tr>"
        for index, axis in report.axes.items()
        if axis.max > axis.min
    )
    if not rows:
        return f"<p>{t('no axis moves')}</p>"
    head = (
        f"<tr><th>{t('Axis')}</th><th class=n>{t('from')}</th><th class=n>{t('to')}</th>"
        f"<th class=n>{t('ends at')}</th></tr>"
    )
    return f'<table class="mc-positions">{head}{rows}</table>'


def _slow_lines(report: SimulateReply) -> str:
    slow = [
        (line.stretched_by, line.line, line.bound_by)
        for line in report.lines
        if line.bound_by and line.stretched_by is not None and line.stretched_by >= SLOW_FROM
    ]
    said = [
        t("line {line}: {factor:.2f} × its time, {bound}", line=line, factor=factor, bound=t(bound))
        for factor, line, bound in sorted(slow, reverse=True)[:SLOW_LINES]
    ]
    rows = "".join(f"<li>{html.escape(each)}</li>" for each in said)
    return f"<p>{t('Slower than asked:')}</p><ul>{rows}</ul>" if rows else ""
