"""Many machines over one link: their states by one query, and an operator's orders to each."""

from __future__ import annotations

import asyncio
import itertools
import logging
from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import Self

from mcclient.calls import Caller
from mcclient.discovery import CONNECT_S, new_client_id
from mcclient.errors import MotionError
from mcclient.estop import send_until_confirmed
from mcclient.keys import ALL_MACHINES, Keys, machine_of_call, server_of
from mcclient.presence import Presence
from mcclient.transport import Link, endpoints_of, user_of
from mcclient.types import EventsReply, Info, MachineStatus, Tables
from mcclient.wire import decode

log = logging.getLogger(__name__)

ORDER_S = 3.0
RETRY_S = 2.0
# in which machines answer
STATES_S = 1.0


class FleetLink:
    """One session to all machines that can be reached; made by `open`."""

    def __init__(self, link: Link, client: str) -> None:
        self._link = link
        self._client = client
        self._live: list[str] = []
        # every request of this client has a number of its own
        self._numbers = itertools.count(1)

    @classmethod
    async def open(
        cls,
        connect: str | Sequence[str] | None = None,
        *,
        timeout_s: float = CONNECT_S,
        config_file: Path | None = None,
    ) -> Self:
        """Connects.

        Raises:
            ConfigurationError: MC537. NobodyAnswers: MC530 the endpoint cannot be reached.
        """
        link = await Link.open(endpoints_of(connect), timeout_s=timeout_s, config_file=config_file)
        return cls(link, new_client_id("fleet", user_of(config_file)))

    async def states(self, *, timeout_s: float) -> dict[str, MachineStatus]:
        """Return the state of every machine that answers within the time, by name.

        A machine's state is taken from the session of its own server alone: the one whose liveliness token
        it has.
        """
        await self.find(timeout_s=timeout_s)
        servers = {(each.machine, each.session) for each in map(server_of, self._live)}
        key = f"mc/@v1/*/@rpc/{self._client}/status"
        found: dict[str, MachineStatus] = {}
        for reply in await self._link.query(key, None, timeout_s=timeout_s):
            machine = machine_of_call(reply.key)
            if not reply.ok or (machine, reply.source) not in servers:
                continue
            try:
                found[machine] = decode(MachineStatus, reply.payload)
            except MotionError:
                # of another version: as if it were not there
                continue
        # access rules for some machines alone let no question to all through: each is asked by itself
        missing = [machine for machine in self.names if machine not in found]
        answers = await asyncio.gather(*(self._state_of(machine, timeout_s) for machine in missing))
        return found | {
            machine: status for machine, status in zip(missing, answers, strict=True) if status is not None
        }

    async def find(self, *, timeout_s: float) -> list[str]:
        """Names of the machines that are there now, sorted."""
        self._live = await self._link.live_keys(ALL_MACHINES, timeout_s=timeout_s)
        return self.names

    @property
    def names(self) -> list[str]:
        """Names of the machines that were there at the last look, sorted."""
        return sorted({server_of(key).machine for key in self._live})

    def _caller(self, machine: str) -> Caller:
        presence = Presence(machine, self._live)
        return Caller(self._link, Keys(machine, self._client), presence, numbers=self._numbers)

    async def _state_of(self, machine: str, timeout_s: float) -> MachineStatus | None:
        try:
            return decode(MachineStatus, await self._caller(machine).call("status", deadline_s=timeout_s))
        except MotionError:
            return None

    async def events(self, machine: str, since: int, limit: int = 1000) -> EventsReply:
        """Events of one machine from number ``since`` on, as far as its server still has them.

        Raises:
            MotionError: it does not answer, or refuses.
        """
        reply = await self._caller(machine).call(
            "events", {"since": since, "limit": limit}, deadline_s=ORDER_S
        )
        return decode(EventsReply, reply)

    async def info(self, machine: str) -> Info:
        """Return what one machine is: its axes, tools, inputs and outputs.

        Raises:
            MotionError: it does not answer, or refuses.
        """
        return decode(Info, await self._caller(machine).call("info", deadline_s=ORDER_S))

    async def tables(self, machine: str) -> Tables:
        """Work offsets and tools that programs of one machine start with.

        Raises:
            MotionError: it does not answer, or refuses.
        """
        return decode(Tables, await self._caller(machine).call("tables", deadline_s=ORDER_S))

    async def order(self, machine: str, method: str, **fields: object) -> None:
        """``hold``, ``resume``, ``abort`` or ``override`` for every program of one machine, or its ``reset``.

        Args:
            fields: of the method's request, such as ``program`` for one of them alone.

        Raises:
            MotionError: it does not answer, or refuses.
        """
        request = {} if method == "reset" else {"program": None}
        await self._caller(machine).call(method, request | fields, deadline_s=ORDER_S)

    async def estop(self, machine: str, reason: str = "", *, timeout_s: float = 5.0) -> None:
        """Emergency stop of one machine; returns once its server has confirmed.

        Raises:
            NoAnswerInTime: MC532.
        """
        keys = Keys(machine, self._client)
        await send_until_confirmed(self._link, keys, reason=reason, timeout_s=timeout_s)

    async def close(self) -> None:
        await self._link.close()


async def keep_link(
    use: Callable[[FleetLink], Awaitable[None]],
    lost: Callable[[MotionError], None] | None = None,
    *,
    connect: Sequence[str] = (),
    config_file: Path | None = None,
) -> None:
    """Use a link to all machines, and another one whenever that breaks, until it is cancelled.

    Why one breaks or is not to be had is logged, once as long as it is the same.

    Args:
        use: ends by a `MotionError` where the network cannot be asked. lost: is told of each.
        connect: endpoints; empty: this computer. config_file: a Zenoh configuration.
    """
    said = ""
    while True:
        try:
            link = await FleetLink.open(connect or None, config_file=config_file)
            said = ""
            try:
                await use(link)
            finally:
                await link.close()
        except MotionError as error:
            if error.message != said:
                said = error.message
                log.warning("%s; trying again", said)
            if lost is not None:
                lost(error)
        await asyncio.sleep(RETRY_S)


async def keep_states(
    see: Callable[[FleetLink, Mapping[str, MachineStatus]], Awaitable[None]],
    lost: Callable[[MotionError], None] | None = None,
    *,
    period_s: float,
    connect: Sequence[str] = (),
    config_file: Path | None = None,
) -> None:
    """Show the states of all machines again and again, over another link whenever one breaks.

    Args:
        see: is given the link and the states of those that answer, by name. lost: as in `keep_link`.
        period_s: pause between two looks.
    """

    async def watch(link: FleetLink) -> None:
        while True:
            await see(link, await link.states(timeout_s=STATES_S))
            await asyncio.sleep(period_s)

    await keep_link(watch, lost, connect=connect, config_file=config_file)
