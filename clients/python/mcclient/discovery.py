"""Which machines are there: from the servers' liveliness tokens."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Sequence
from pathlib import Path

from mcclient.calls import Caller
from mcclient.errors import MotionError, NobodyAnswers, SeveralMachines
from mcclient.keys import ALL_MACHINES, Keys, machine_and_instance
from mcclient.presence import Presence
from mcclient.transport import Arrived, Link, endpoints_of
from mcclient.types import Info
from mcclient.wire import decode

CONNECT_S = 3.0


async def machines(link: Link, *, timeout_s: float) -> list[str]:
    """Names of all machines that are there now, sorted."""
    live = await link.live_keys(ALL_MACHINES, timeout_s=timeout_s)
    return sorted({machine_and_instance(key)[0] for key in live})


async def find_machine(link: Link, name: str | None, *, timeout_s: float) -> str:
    """The machine named, or the only one that is there.

    Raises:
        NobodyAnswers: MC530 none comes within the time.
        SeveralMachines: MC531 none is named and more than one is there.
    """
    found: dict[str, None] = {}
    arrived = asyncio.Event()

    def on_token(token: Arrived) -> None:
        if not token.gone:
            found[machine_and_instance(token.key)[0]] = None
            arrived.set()

    subscription = link.watch_tokens(Keys(name).live if name else ALL_MACHINES, on_token)
    try:
        async with asyncio.timeout(timeout_s):
            await arrived.wait()
    except TimeoutError:
        others = await machines(link, timeout_s=timeout_s) if name else []
        raise _nobody(name, others) from None
    finally:
        subscription.close()
    if name:
        return name
    # one has come; the query is answered with all that the network knows
    found.update(dict.fromkeys(await machines(link, timeout_s=timeout_s)))
    if len(found) > 1:
        names = sorted(found)
        raise SeveralMachines(
            "MC531",
            f"{len(names)} machines are there: {', '.join(names)}",
            f"name one, such as --machine {names[0]}",
            details={"machines": names},
        )
    return next(iter(found))


async def list_machines(
    connect: str | Sequence[str] | None = None,
    *,
    timeout_s: float = CONNECT_S,
    config_file: Path | None = None,
) -> list[tuple[str, Info | MotionError]]:
    """Every machine that is there, with its info or why it gave none.

    Raises:
        NobodyAnswers: MC530 the endpoint cannot be reached.
    """
    link = await Link.open(endpoints_of(connect), timeout_s=timeout_s, config_file=config_file)
    try:
        found: list[tuple[str, Info | MotionError]] = []
        for name in await machines(link, timeout_s=timeout_s):
            caller = Caller(link, Keys(name), "", Presence(name))
            try:
                found.append((name, decode(Info, await caller.call("info", deadline_s=timeout_s))))
            except MotionError as error:
                found.append((name, error))
        return found
    finally:
        await link.close()


def _nobody(name: str | None, others: Iterable[str]) -> NobodyAnswers:
    names = list(others)
    if name and names:
        return NobodyAnswers(
            "MC530",
            f"no machine {name!r} is there",
            f"those that are: {', '.join(names)}",
            details={"machines": names},
        )
    who = f"machine {name!r}" if name else "any machine"
    return NobodyAnswers(
        "MC530",
        f"the network is reached, but not {who}",
        "start a server (mcserver run), or name another endpoint with --connect",
    )
