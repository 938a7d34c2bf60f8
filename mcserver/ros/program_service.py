"""The service that runs a G-code program.

No standard service takes a text and says how its execution ended, so this one has a type of its own,
``mcserver_msgs/srv/RunProgram``; deploy/ros/mcserver_msgs is its package.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

from mcclient import Machine, MotionError

from mcserver.ros.interfaces import interfaces
from mcserver.ros.node import Node
from mcserver.ros.outcome import with_hint

KIND = "mcserver_msgs/srv/RunProgram"
MAX_TEXT = 1024 * 1024
AT_ONCE = 4


class ProgramService:
    """``run_program``: answers once the program has ended. Hold, abort and stop act on it as on any other."""

    def __init__(self, node: Node, machine: Machine) -> None:
        self._machine = machine
        self._under_way = 0
        node.serve("run_program", KIND, self._run)

    async def _run(self, request: Any) -> Any:
        if len(request.text) > MAX_TEXT or self._under_way >= AT_ONCE:
            return _reply(
                False, "MC084", f"{MAX_TEXT} characters and {AT_ONCE} programs at once are possible"
            )
        self._under_way += 1
        try:
            program = await self._machine.program(request.name or "ROS program")
            try:
                await program.send_lines(request.text.splitlines())
                await program.finish()
            except BaseException:
                with contextlib.suppress(MotionError):
                    await asyncio.shield(program.abort())
                raise
        except MotionError as error:
            where = f"line {error.line}: " if error.line else ""
            return _reply(False, error.code, where + with_hint(error))
        finally:
            self._under_way -= 1
        return _reply(True)


def _reply(success: bool, code: str = "", message: str = "") -> Any:
    return interfaces().make(f"{KIND}_Response", success=success, code=code, message=message)
