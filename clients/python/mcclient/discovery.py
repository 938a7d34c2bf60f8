"""Which machines are there: from the servers' liveliness tokens."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Iterable, Sequence
from pathlib import Path

from mcclient.calls import Caller
from mcclient.errors import ConfigurationError, MotionError, NobodyAnswers, SeveralMachines
from mcclient.keys import ALL_MACHINES, Keys, is_name, live_key, server_of
from mcclient.presence import Presence
from mcclient.transport import Link, endpoints_of, user_of
from mcclient.types import Info
from mcclient.wire import decode

CONNECT_S = 3.0
LOOK_AGAIN_S = 0.05


def new_client_id(name: str, user: str = "") -> str:
    """A client id that nobody else has: ``user.name-random``, so that access rules know the user by it.

    Raises:
        ConfigurationError: MC537 it cannot be part of a key.
    """
    client = (f"{user}." if user else "") + f"{name}-{secrets.token_hex(6)}"
    if not is_name(client):
        raise ConfigurationError(
            "MC537", f"{client!r} is no client id", "names have letters, digits, '-', '_' and '.', 63 at most"
        )
    return client


async def machines(link: Link, key: str = ALL_MACHINES, *, timeout_s: float) -> list[str]:
    """Names of the machines that are there now, sorted; ``key``: of their liveliness tokens."""
    live = await link.live_keys(key, timeout_s=timeout_s)
    return sorted({server_of(key).machine for key in live})


async def find_machine(link: Link, name: str | None, *, timeout_s: float) -> str:
    """Return the machine named, or the only one that is there.

    Raises:
        NobodyAnswers: MC530 none comes within the time.
        SeveralMachines: MC531 none is named and more than one is there.
    """
    key = live_key(name) if name else ALL_MACHINES
    clock = asyncio.get_running_loop().time
    until = clock() + timeout_s
    # Only queries: beside a subscription to the same tokens, or just after its end, Zenoh answers a query
    # from what it has heard so far, and a part of the machines would be taken for all.
    while not (found := await machines(link, key, timeout_s=timeout_s)):
        if clock() > until:
            others = await machines(link, timeout_s=timeout_s) if name else []
            raise _nobody(name, others)
        await asyncio.sleep(LOOK_AGAIN_S)
    if name:
        return name
    if len(found) > 1:
        raise SeveralMachines(
            "MC531",
            f"{len(found)} machines are there: {', '.join(found)}",
            f"name one, such as --machine {found[0]}",
            details={"machines": found},
        )
    return found[0]


async def list_machines(
    connect: str | Sequence[str] | None = None,
    *,
    timeout_s: float = CONNECT_S,
    config_file: Path | None = None,
) -> list[tuple[str, Info | MotionError]]:
    """Return every machine that is there, with its info or why it gave none.

    Raises:
        NobodyAnswers: MC530 the endpoint cannot be reached.
    """
    link = await Link.open(endpoints_of(connect), timeout_s=timeout_s, config_file=config_file)
    try:
        found: list[tuple[str, Info | MotionError]] = []
        live = await link.live_keys(ALL_MACHINES, timeout_s=timeout_s)
        client = new_client_id("list", user_of(config_file))
        for name in sorted({server_of(key).machine for key in live}):
            presence = Presence(name, live)
            link.believe(presence.is_server)
            caller = Caller(link, Keys(name, client), presence)
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
