"""The runs that wait for an operator, as the page shows them: asked for again and again while it is open."""

from __future__ import annotations

import asyncio
import logging
from typing import Any, NamedTuple

import msgspec
from mcclient import Machine, MotionError, RequestRefused
from mcclient.run_picture import run_picture
from mcclient.types import Diagnostic

log = logging.getLogger(__name__)

PERIOD_S = 1.0
# the server keeps 16; more than it would give are not shown
MAX_SHOWN = 32


class RunToArm(NamedTuple):
    """One request with what an operator looks at.

    Attributes:
        run: the map `RunRequestStatus` of docs/wire/arming.md. text: the program. picture: SVG.
        warnings: of its check and simulation, the first ones; unshown: how many more there were.
    """

    run: dict[str, Any]
    text: str
    picture: str
    warnings: tuple[Diagnostic, ...] = ()
    unshown: int = 0

    @property
    def key(self) -> tuple[str, int]:
        """The hash and the number of the request: asked for anew, it is another one."""
        return self.run["sha256"], self.run["number"]


class RunRequests:
    """Follows the requests of one machine.

    Attributes:
        shown: the oldest first. approvals: what is approved for a while, maps `RunRequestStatus`.
    """

    def __init__(self) -> None:
        self.shown: tuple[RunToArm, ...] = ()
        self.approvals: tuple[dict[str, Any], ...] = ()

    async def follow(self, machine: Machine) -> None:
        """Ask until cancelled; what cannot be had, as by who may not see it, is not shown."""
        while True:
            try:
                await self.refresh(machine)
            except MotionError as error:
                self.shown = self.approvals = ()
                log.debug("%s: no requests: %s", machine.name, error)
            await asyncio.sleep(PERIOD_S)

    async def refresh(self, machine: Machine) -> None:
        """Ask once; texts and pictures that are known are not asked for again.

        Raises:
            MotionError: the machine does not say.
        """
        known = {each.key: each for each in self.shown}
        found = []
        for run in msgspec.to_builtins((await machine.run_requests())[:MAX_SHOWN]):
            before = known.get((run["sha256"], run["number"]))
            if before is not None:
                found.append(before._replace(run=run))
                continue
            try:
                preview = msgspec.to_builtins(await machine.run_preview(run["sha256"]))
            except RequestRefused:
                # over since it was listed
                continue
            warnings = msgspec.convert(preview.get("warnings", ()), tuple[Diagnostic, ...])
            unshown = preview.get("unshown_warnings", 0)
            found.append(RunToArm(preview["run"], preview["text"], run_picture(preview), warnings, unshown))
        self.shown = tuple(found)
        self.approvals = tuple(msgspec.to_builtins((await machine.run_approvals())[:MAX_SHOWN]))
