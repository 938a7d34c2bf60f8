"""Every machine that can be reached, asked for its state once a second with one query for all of them."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from pathlib import Path

from mcclient import MachineStatus, MotionError
from mcclient.fleet import FleetLink, keep_link

from mcserver.web.control import needs_control
from mcserver.web.jobs import JobQueue
from mcserver.web.link import MachineLink
from mcserver.web.past import Past
from mcserver.web.store import ProgramStore
from mcserver.web.translation import mark

PERIOD_S = 1.0
# machines that are asked for their groups and tags in a look
MARKS_AT_ONCE = 20
# between two questions to the history [s]
LOOK_BACK_S = 300.0
# an offline machine stays in the table this long
REMEMBERED_S = 24 * 3600.0
# connected at a time; each is a Zenoh session. Those that nobody looks at give their place up
MAX_LINKS = 64
# of one visitor
VISITOR_LINKS = 32
# a machine that a text is to be run on has so long to be connected
CONNECTED_S = 10.0
# what a text is called that was given to several machines
FLEET_TEXT = "text of the fleet's page"
# a connection that nobody looks at any more stays this long
UNUSED_S = 120.0


class Seen:
    """One machine of the fleet: its newest state, and when it came [s, never stepping]."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.status: MachineStatus | None = None
        self.seen_at = time.monotonic()
        self.online = True
        # what its machine file says that people find it by; asked for once a start of its server
        self.group = ""
        self.tags: tuple[str, ...] = ()
        self.asked = ""


class Fleet:
    """The machines behind some endpoints, and a `MachineLink` for each that somebody looks at.

    Args:
        connect: Zenoh endpoints. config_file: a Zenoh configuration. folder: of the programs kept.
        past: what `mcserver history` has written; None: nothing is known.

    Attributes:
        running_today: share of the day in which a program ran, by machine [%].
    """

    def __init__(
        self, connect: tuple[str, ...], config_file: Path | None, folder: Path, past: Past | None = None
    ) -> None:
        self.past = past
        self.running_today: dict[str, float] = {}
        self._aside: asyncio.Future[None] | None = None
        self._look_back_at = 0.0
        self.machines: dict[str, Seen] = {}
        self.failure = ""
        self._connect = connect
        self._config_file = config_file
        self._folder = folder
        # used longest ago first
        self._links: OrderedDict[str, MachineLink] = OrderedDict()
        self._closing: set[asyncio.Task[None]] = set()
        self._link: FleetLink | None = None
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Begin to look; in a running loop."""
        self._task = asyncio.ensure_future(self._run())

    def knows(self, name: str) -> bool:
        """Whether there is such a machine, or was one that this page has programs of."""
        return name in self.machines or name in self._links or (self._folder / name).is_dir()

    def link(self, name: str, visitor: str) -> MachineLink:
        """The connection to one machine that is known, made on first use.

        Args:
            visitor: who wants to look at it.

        Raises:
            MotionError: MC063 too many machines are looked at, or there is no such machine.
        """
        link = self._links.get(name)
        if link is None:
            if not self.knows(name):
                raise MotionError(
                    "MC063",
                    mark("no machine {name} has been seen", name=name),
                    mark("is its server running?"),
                )
            self._make_room(visitor)
            store = ProgramStore(self._folder / name)
            link = self._links[name] = MachineLink(name, self._connect, self._config_file, store)
        self._links.move_to_end(name)
        link.used_at = time.monotonic()
        return link

    def release_unused(self) -> None:
        """End the connections that nobody has looked at for `UNUSED_S`."""
        before = time.monotonic() - UNUSED_S
        for link in self.links:
            if not link.in_use and link.used_at < before:
                self._release(link)

    def _make_room(self, visitor: str) -> None:
        if sum(visitor in link.visitors for link in self.links) >= VISITOR_LINKS:
            raise MotionError(
                "MC063",
                mark("you look at {count} machines", count=VISITOR_LINKS),
                mark("close some of their pages"),
            )
        if len(self._links) < MAX_LINKS:
            return
        unused = next((link for link in self.links if not link.in_use), None)
        if unused is None:
            raise MotionError(
                "MC063",
                mark("{count} machines are looked at", count=MAX_LINKS),
                mark("close pages, or serve some from another page"),
            )
        self._release(unused)

    def _release(self, link: MachineLink) -> None:
        del self._links[link.name]
        task = asyncio.ensure_future(link.close())
        self._closing.add(task)
        task.add_done_callback(self._closing.discard)

    def opened(self, name: str) -> MachineLink | None:
        """The connection to one machine, where there is one."""
        return self._links.get(name)

    @property
    def links(self) -> list[MachineLink]:
        return list(self._links.values())

    async def order(self, method: str, names: list[str], visitor: str) -> dict[str, BaseException]:
        """Give ``hold``, ``abort`` or ``reset`` to several machines at once; what failed, by machine.

        Args:
            visitor: who gives it.
        """

        async def give(link: FleetLink, name: str) -> None:
            if needs_control(method):
                self._refuse_driven(name, visitor)
            elif name in self._links:
                self._links[name].jobs.stop_checking()
            await link.order(name, method)

        return await self._each(names, give)

    async def emergency_stop(self, names: list[str], reason: str) -> dict[str, BaseException]:
        """Stop several machines, whoever drives them, and empty their queues; what failed, by machine."""
        for name in names:
            if name in self._links:
                self._links[name].jobs.stop()
        return await self._each(names, lambda link, name: link.estop(name, reason))

    async def run(
        self, names: list[str], text: str, visitor: str, file: tuple[str, bytes] | None = None
    ) -> dict[str, BaseException]:
        """Queue a text on several machines; what failed, by machine.

        Args:
            visitor: who wants it. file: name and content, kept at each machine and run instead of the text.
        """

        async def start(_: FleetLink, name: str) -> None:
            link = self.link(name, visitor)
            self._refuse_driven(name, visitor)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(CONNECTED_S):
                    while link.machine is None:
                        await asyncio.sleep(CONNECTED_S / 100)
            link.connected()
            if file is None:
                link.jobs.add_text(FLEET_TEXT, text, visitor)
            else:
                link.store.write(*file)
                link.jobs.add(file[0], visitor)

        return await self._each(names, start)

    def _refuse_driven(self, name: str, visitor: str) -> None:
        """Refuse what moves a machine that somebody drives at its own page."""
        link = self._links.get(name)
        driver = None if link is None else link.control.other_person(visitor)
        if driver is not None:
            raise MotionError(
                "MC078",
                mark("{name} has control", name=driver.name),
                mark("ask for it, or take control at its page"),
            )

    def jobs_of(self, name: str) -> JobQueue | None:
        """Return the programs of this page on a machine; None: nobody has looked at it of late."""
        link = self._links.get(name)
        return None if link is None else link.jobs

    async def _each(
        self, names: list[str], act: Callable[[FleetLink, str], Awaitable[None]]
    ) -> dict[str, BaseException]:
        """Do something to several machines at once; what failed, by machine."""
        if self._link is None:
            failure = MotionError("MC530", self.failure or mark("not connected"))
            return dict.fromkeys(names, failure)
        link = self._link
        answers = await asyncio.gather(*(act(link, name) for name in names), return_exceptions=True)
        return {name: answer for name, answer in zip(names, answers, strict=True) if answer is not None}

    async def close(self) -> None:
        """End all connections; programs under way stop along their paths."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        if self._aside is not None:
            self._aside.cancel()
            await asyncio.gather(self._aside, return_exceptions=True)
        ending = [asyncio.ensure_future(link.close()) for link in self.links]
        await asyncio.gather(*ending, *self._closing, return_exceptions=True)

    async def _run(self) -> None:
        def lost(error: MotionError) -> None:
            self.failure = error.message

        await keep_link(self._watch, lost, connect=self._connect, config_file=self._config_file)

    async def _watch(self, link: FleetLink) -> None:
        self.failure, self._link = "", link
        try:
            while True:
                await self._look(link)
                if self._aside is None or self._aside.done():
                    # nobody waits for what is not asked each second
                    self._aside = asyncio.ensure_future(self._look_aside(link))
                self.release_unused()
                await asyncio.sleep(PERIOD_S)
        finally:
            self._link = None

    async def _ask_marks(self, link: FleetLink) -> None:
        """Ask some machines that have started for their groups and tags; one that does not say has none."""
        new = [
            (seen, seen.status.instance)
            for seen in self.machines.values()
            if seen.online and seen.status is not None and seen.asked != seen.status.instance
        ][:MARKS_AT_ONCE]
        answers = await asyncio.gather(*(link.info(seen.name) for seen, _ in new), return_exceptions=True)
        for (seen, instance), info in zip(new, answers, strict=True):
            seen.asked = instance
            if not isinstance(info, BaseException):
                seen.group, seen.tags = info.group, tuple(info.tags)

    async def _look_aside(self, link: FleetLink) -> None:
        """Ask for what changes seldom: groups and tags, and how long machines have run today."""
        await self._ask_marks(link)
        if self.past is not None and time.monotonic() >= self._look_back_at:
            self._look_back_at = time.monotonic() + LOOK_BACK_S
            self.running_today = await self.past.running_today()

    async def _look(self, link: FleetLink) -> None:
        now = time.monotonic()
        for name, status in (await link.states(timeout_s=PERIOD_S)).items():
            seen = self.machines.setdefault(name, Seen(name))
            seen.status, seen.seen_at, seen.online = status, now, True
        for seen in list(self.machines.values()):
            seen.online = now - seen.seen_at < 4.0 * PERIOD_S
            if now - seen.seen_at > REMEMBERED_S:
                del self.machines[seen.name]
