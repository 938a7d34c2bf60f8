"""The emergency stop: on a session of its own at the highest priority, sent until it is confirmed.

This is a function of a program over a network and no safety function: machines need a circuit of their own.
"""

from __future__ import annotations

import asyncio
import secrets
from pathlib import Path

import zenoh

from mcclient.discovery import find_machine, new_client_id
from mcclient.errors import MotionError, NoAnswerInTime
from mcclient.keys import Keys, live_key
from mcclient.presence import Presence
from mcclient.transport import Arrived, Link, user_of
from mcclient.wire import encode, unpack

REPEAT_S = 0.05
# Numbers of stops, which all copies of one have: no counter of requests comes to them.
LEAST_NUMBER = 1 << 32
MOST_NUMBER = 1 << 53


async def emergency_stop(
    machine: str | None = None,
    connect: tuple[str, ...] = (),
    *,
    client: str = "estop",
    reason: str = "",
    timeout_s: float = 5.0,
    config_file: Path | None = None,
) -> str:
    """Stops every axis of the machine, and returns its name once the server has confirmed.

    Raises:
        NobodyAnswers: MC530 the machine is not there; MC532 (`NoAnswerInTime`) no confirmation within the
            time: use the machine's own circuit.
        SeveralMachines: MC531 none is named and more than one is there.
    """
    link = await Link.open(connect, timeout_s=timeout_s, config_file=config_file)
    try:
        name = await find_machine(link, machine, timeout_s=timeout_s)
        presence = Presence(name, await link.live_keys(live_key(name), timeout_s=timeout_s))
        link.believe(presence.is_server)
        keys = Keys(name, new_client_id(client, user_of(config_file)))
        await send_until_confirmed(link, keys, reason=reason, timeout_s=timeout_s)
    finally:
        await link.close()
    return name


async def send_until_confirmed(
    link: Link, keys: Keys, *, reason: str, timeout_s: float, number: int | None = None
) -> None:
    """Puts the stop again and again until an event or a state says that it is latched.

    Args:
        number: of this stop, the same in copies sent over other connections; None: a random one.

    Raises:
        NoAnswerInTime: MC532 no confirmation within the time.
    """
    confirmed = asyncio.Event()

    def on_event(arrived: Arrived) -> None:
        if _field(arrived, "kind") == "estop":
            confirmed.set()

    def on_state(arrived: Arrived) -> None:
        if _field(arrived, "state") == "estop":
            confirmed.set()

    subscriptions = [
        link.subscribe(keys.event, on_event, limit=256),
        link.subscribe(keys.state, on_state, limit=4),
    ]
    if number is None:
        number = LEAST_NUMBER + secrets.randbelow(MOST_NUMBER - LEAST_NUMBER)
    payload = encode({"request": number, "client": keys.client, "reason": reason[:200]})
    clock = asyncio.get_running_loop().time
    deadline = clock() + timeout_s
    try:
        while not confirmed.is_set():
            if clock() >= deadline:
                raise NoAnswerInTime(
                    "MC532",
                    f"{keys.machine} has not confirmed the emergency stop within {timeout_s:g} s",
                    "use the machine's own emergency stop circuit",
                )
            await link.put(keys.emergency_stop, payload, priority=zenoh.Priority.REAL_TIME, express=True)
            try:
                async with asyncio.timeout(min(REPEAT_S, max(0.001, deadline - clock()))):
                    await confirmed.wait()
            except TimeoutError:
                continue
    finally:
        for subscription in subscriptions:
            subscription.close()


def _field(arrived: Arrived, name: str) -> object:
    try:
        message = unpack(arrived.payload)
    except MotionError:
        return None
    return message.get(name) if isinstance(message, dict) else None
