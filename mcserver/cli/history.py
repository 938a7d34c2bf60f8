"""``mcserver history``: the events, lines and states of a fleet as Parquet files."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mcserver.cli.console import narration
from mcserver.cli.options import ConnectOption, ZenohConfigOption
from mcserver.cli.serving import require_packages, run_until_stopped

if TYPE_CHECKING:
    from mcclient.fleet import FleetLink

    from mcserver.web.fleet_events import FleetEvents
    from mcserver.web.history import HistoryFolder
    from mcserver.web.history_store import HistoryStore

EVENTS_PERIOD_S = 1.0


def history(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Where the files go.")],
    connect: ConnectOption = None,
    zenoh: ZenohConfigOption = None,
    states: Annotated[
        float, typer.Option("--states", min=0.0, max=20.0, help="States a second of each machine; 0: none.")
    ] = 10.0,
    store: Annotated[
        str | None,
        typer.Option("--store", metavar="URL", help="Move the files there, such as s3://bucket/history."),
    ] = None,
    period: Annotated[
        float, typer.Option("--period", min=1.0, max=3600.0, help="Seconds between two writings of Parquet.")
    ] = 300.0,
) -> None:
    """Write events, line reports and states of all machines into Parquet files, until Ctrl-C."""
    require_packages("history", "history", ("duckdb", "mcclient"))
    from mcserver.web.history import HistoryFolder

    kept = HistoryFolder(folder, time.time, period)
    moved = _store_at(store)
    narration().print(f"history: {store or folder} (Ctrl-C ends)")

    async def run() -> None:
        async with asyncio.TaskGroup() as group:
            group.create_task(_run(kept, tuple(connect or ()), zenoh, states))
            if moved is not None:
                group.create_task(moved.keep_moving(folder, period))

    try:
        run_until_stopped(run())
    finally:
        kept.close()
        if moved is not None:
            moved.move(folder)


def _store_at(address: str | None) -> HistoryStore | None:
    if address is None:
        return None
    require_packages("history --store", "store", ("fsspec",))
    from mcserver.web.history_store import HistoryStore

    return HistoryStore(address)


async def _run(kept: HistoryFolder, connect: tuple[str, ...], zenoh: Path | None, states_hz: float) -> None:
    from mcclient.fleet import keep_link

    from mcserver.web.fleet_events import FleetEvents

    events = FleetEvents(history=True)

    async def watch(link: FleetLink) -> None:
        await _collect(kept, link, events, states_hz)

    await keep_link(watch, connect=connect, config_file=zenoh)


async def _collect(kept: HistoryFolder, link: FleetLink, events: FleetEvents, states_hz: float) -> None:
    """Ask all machines again and again; with one query for the states of all."""
    from mcserver.web.history import event_rows, state_row

    period_s = 1.0 / states_hz if states_hz else EVENTS_PERIOD_S
    asked_at = float("-inf")
    while True:
        begun = time.monotonic()
        found = await link.states(timeout_s=EVENTS_PERIOD_S)
        if states_hz:
            kept.append(state_row(name, status) for name, status in found.items())
        if begun - asked_at >= EVENTS_PERIOD_S:
            asked_at = begun
            for name, event in await events.poll(link, EVENTS_PERIOD_S):
                kept.append(event_rows(name, event))
        await asyncio.sleep(max(0.0, period_s - (time.monotonic() - begun)))
