"""``mcserver webhooks``: messages to other programs about programs that ended, faults and emergency stops."""

from __future__ import annotations

import asyncio
import logging
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mcserver.cli.console import narration
from mcserver.cli.options import ConnectOption, ZenohConfigOption
from mcserver.cli.serving import require_packages

if TYPE_CHECKING:
    from mcclient.fleet import FleetLink

    from mcserver.web.webhooks import Hook

PERIOD_S = 0.5


def webhooks(
    config: Annotated[Path, typer.Argument(metavar="FILE", help="The receivers (TOML): docs/webhooks.md.")],
    connect: ConnectOption = None,
    zenoh: ZenohConfigOption = None,
) -> None:
    """Tell other programs of programs that ended, faults and emergency stops, until Ctrl-C."""
    require_packages("webhooks", "web", ("httpx", "mcclient"))
    from mcserver.web.webhooks import read_hooks

    hooks = read_hooks(config)
    # it would log addresses, which may hold secrets
    logging.getLogger("httpx").setLevel(logging.WARNING)
    narration().print(f"webhooks: {', '.join(hook.name for hook in hooks)} (Ctrl-C ends)")
    try:
        asyncio.run(_run(hooks, tuple(connect or ()), zenoh))
    except KeyboardInterrupt:
        return


async def _run(hooks: list[Hook], connect: tuple[str, ...], zenoh: Path | None) -> None:
    import httpx
    from mcclient.fleet import keep_link

    from mcserver.web.fleet_events import FleetEvents
    from mcserver.web.webhooks import Receiver

    async with httpx.AsyncClient(follow_redirects=False) as client, asyncio.TaskGroup() as group:
        receivers = [Receiver(hook, client, time.time) for hook in hooks]
        for receiver in receivers:
            group.create_task(receiver.run())

        # one for all links: what happens while there is none is told by the next one
        events = FleetEvents(history=False)

        async def watch(link: FleetLink) -> None:
            while True:
                for machine, event in await events.poll(link, PERIOD_S):
                    for receiver in receivers:
                        receiver.take(machine, event)
                await asyncio.sleep(PERIOD_S)

        await keep_link(watch, connect=connect, config_file=zenoh)
