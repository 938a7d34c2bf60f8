"""Health of the CAN buses: load, lost and late frames, as `mcserver drives health` counts them."""

from __future__ import annotations

import html
from collections.abc import Sequence

from mcclient import MotionError
from mcclient.types import BusHealth, NodeHealth
from nicegui import ui

from mcserver.web.actions import Actions, show_error
from mcserver.web.panels.card import card, scrolled
from mcserver.web.translation import t

SECONDS = 5.0


class BusPanel:
    """A button that has the server listen, and what it has counted."""

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        with card(t("Health of the buses")):
            self._button = ui.button(
                t("Listen for {seconds:g} s", seconds=SECONDS), on_click=self._listen
            ).props("outline")
            self._report = scrolled(t("Health of the buses")).props("aria-live=polite")

    async def _listen(self) -> None:
        if not self._actions.has_role("drives_health"):
            return
        self._button.set_enabled(False)
        try:
            machine = self._actions.link.connected()
            # of several engineers each gets the same answer
            found = await self._actions.link.answers.get(
                "drives_health", 0.0, lambda: machine.drives_health(SECONDS)
            )
            self._report.set_content("".join(map(bus_html, found)))
        except MotionError as error:
            show_error(error)
        finally:
            self._button.set_enabled(True)


def bus_html(bus: BusHealth) -> str:
    """Return one bus: its frames, and a row for each node."""
    counts = bus.counts
    lines = [
        t(
            "bus {bus}: {frames} frames in {seconds:.1f} s, load {load:.1%}, {errors} error frames",
            bus=bus.bus,
            frames=counts.frames,
            seconds=counts.duration_s,
            load=counts.load,
            errors=bus.error_frames,
        ),
        t(
            "SYNC {rate:.1f} Hz, longest gap {gap:.1f} ms by the server's clock",
            rate=counts.syncs / counts.duration_s,
            gap=counts.longest_sync_gap_s * 1e3,
        )
        if counts.syncs
        else t("no SYNC: no cycle runs"),
    ]
    strangers = [
        t("{cob_id}: {count} frames that belong to no node of the machine file", cob_id=each, count=count)
        for each, count in counts.strangers.items()
    ]
    emergencies = [
        t("node {node}: emergency {what}", node=node.node, what=each)
        for node in counts.nodes
        for each in node.emergencies
    ]
    titles = (
        t("Node"),
        t("Axes"),
        t("State"),
        t("Heartbeat gap [ms]"),
        t("Readings"),
        t("Late"),
        t("Lost"),
        t("Following error"),
    )
    rows = [_cells(node, bus.following_errors) for node in counts.nodes]
    return (
        "".join(f"<p>{html.escape(each)}</p>" for each in lines)
        + table_html(titles, rows)
        + "".join(f"<p>{html.escape(each)}</p>" for each in (*emergencies, *strangers))
    )


def table_html(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table; its cells are text as it is."""
    head = "".join(f"<th>{html.escape(each)}</th>" for each in titles)
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f'<table class="mc-table"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'


def _cells(node: NodeHealth, errors: dict[str, float]) -> list[str]:
    axes = list(map(str, node.axes))
    return [
        str(node.node),
        ", ".join(axes) or "–",
        node.state or t("no heartbeat"),
        f"{node.longest_gap_s * 1e3:.0f}",
        str(node.readings),
        str(node.late),
        str(node.lost),
        ", ".join(f"{errors[axis]:.4g}" for axis in axes if axis in errors) or "–",
    ]
