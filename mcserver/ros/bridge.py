"""The bridge's process: a node of ROS 2 for each machine that can be reached."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import zenoh
from mcclient import MotionError, NobodyAnswers
from mcclient.fleet import FleetLink, keep_link

from mcserver.ros.machine_node import NodeOptions, serve_machine
from mcserver.ros.node import RosSession

LOOK_S = 1.0
CONNECT_S = 3.0
# a machine that is not found so often in a row is gone
MISSED = 2


class Bridge:
    """Nodes of the machines that are there, until `run` is cancelled.

    Args:
        say: tells a person which machines are shown, and why one is not.
    """

    def __init__(self, options: NodeOptions, say: Callable[[str], None]) -> None:
        self._options = options
        self._say = say
        self._nodes: dict[str, asyncio.Task[None]] = {}
        self._refused: set[str] = set()
        self._waited = False

    async def run(self) -> None:
        """Run until it is cancelled."""
        await keep_link(self._watch, connect=self._options.connect, config_file=self._options.config_file)

    async def _watch(self, link: FleetLink) -> None:
        options = self._options
        try:
            session = await RosSession.open(
                options.ros_connect or options.connect,
                options.domain,
                timeout_s=CONNECT_S,
                config_file=None if options.ros_connect else options.config_file,
            )
        except zenoh.ZError as error:
            raise NobodyAnswers("MC530", f"the network cannot be reached for ROS: {error}") from error
        missed: dict[str, int] = {}
        try:
            while True:
                found = await link.find(timeout_s=LOOK_S)
                wanted = self.shown(found)
                for name in wanted:
                    missed[name] = 0
                    if name not in self._nodes or self._nodes[name].done():
                        self._nodes[name] = asyncio.create_task(self._serve(session, name))
                for name in [each for each in self._nodes if each not in wanted]:
                    missed[name] = missed.get(name, 0) + 1
                    if missed[name] >= MISSED:
                        await self._end(name)
                await asyncio.sleep(LOOK_S)
        finally:
            for name in list(self._nodes):
                await self._end(name)
            await session.close()

    def shown(self, found: list[str]) -> list[str]:
        """Return which machines are shown; of those whose names are the same in ROS the first one is."""
        only = self._options.machine
        if only is not None:
            if only not in found and not self._waited:
                self._waited = True
                self._say(f"waiting for {only}; there are {', '.join(found) or 'no machines'}")
            return [each for each in found if each == only]
        first: dict[str, str] = {}
        for name in found:
            namespace = self._options.namespace(name)
            shown = first.setdefault(namespace, name)
            if shown != name and name not in self._refused:
                self._refused.add(name)
                self._say(f"MC083: {name} is {namespace} in ROS, as {shown} is: it is not shown")
        return list(first.values())

    async def _serve(self, session: RosSession, name: str) -> None:
        try:
            await serve_machine(session, name, self._options, self._say)
        except* MotionError as errors:
            for error in errors.exceptions:
                self._say(f"{name}: {error}")

    async def _end(self, name: str) -> None:
        task = self._nodes.pop(name)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
