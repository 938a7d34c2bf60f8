"""Which machines are there: from the servers' liveliness tokens."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable

from mcclient.errors import NobodyAnswers, SeveralMachines
from mcclient.keys import ALL_MACHINES, Keys, machine_and_instance
from mcclient.transport import Arrived, Link

# a router may still be learning of tokens when the link has just come up
SETTLE_S = 0.1


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
        await asyncio.wait_for(arrived.wait(), timeout_s)
    except TimeoutError:
        others = await machines(link, timeout_s=timeout_s) if name else []
        raise _nobody(name, others) from None
    finally:
        subscription.close()
    if name:
        return name
    # one has come: so have the others that the network knows
    await asyncio.sleep(SETTLE_S)
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
