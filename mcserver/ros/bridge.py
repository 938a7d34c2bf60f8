"""The bridge's process: a node of ROS 2 for each machine that can be reached."""

from __future__ import annotations

import asyncio
import logging

import zenoh
from mcclient import MotionError, NobodyAnswers
from mcclient.fleet import FleetLink, keep_link

from mcserver.ros.machine_node import NodeOptions, serve_machine
from mcserver.ros.node import RosSession

log = logging.getLogger(__name__)

LOOK_S = 1.0
CONNECT_S = 3.0
# a machine that is not found so often in a row is gone
MISSED = 2


class Bridge:
    """Nodes of the machines that are there, until `run` is cancelled."""

    def __init__(self, options: NodeOptions) -> None:
        self._options = options
        self._nodes: dict[str, asyncio.Task[None]] = {}
        self._refused: set[str] = set()

    async def run(self) -> None:
        """Run until it is cancelled."""
        await keep_link(
            self._watch, self._lost, connect=self._options.connect, config_file=self._options.config_file
        )

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
                wanted = self._shown(found)
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

    def _shown(self, found: list[str]) -> list[str]:
        """Return which machines are shown; of those whose names are the same in ROS the first one is."""
        if self._options.machine is not None:
            return [each for each in found if each == self._options.machine]
        first: dict[str, str] = {}
        for name in found:
            namespace = self._options.namespace(name)
            shown = first.setdefault(namespace, name)
            if shown != name and name not in self._refused:
                self._refused.add(name)
                log.warning("MC083: %s is %s in ROS, as %s is: it is not shown", name, namespace, shown)
        return list(first.values())

    async def _serve(self, session: RosSession, name: str) -> None:
        try:
            await serve_machine(session, name, self._options)
        except* MotionError as errors:
            for error in errors.exceptions:
                log.warning("%s: %s", name, error)

    async def _end(self, name: str) -> None:
        task = self._nodes.pop(name)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    def _lost(self, error: MotionError) -> None:
        log.warning("%s; trying again", error.message)
