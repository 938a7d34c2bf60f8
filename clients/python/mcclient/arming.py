"""Runs that an operator has to arm: ask for one, look at what waits, decide, start what is armed."""

from __future__ import annotations

from typing import Any

from mcclient.calls import Caller
from mcclient.wire import unpack

LONG_S = 300.0


class ArmingCalls:
    """What `mcclient.Machine` offers of them; answers are the maps of docs/keyspace.md."""

    _caller: Caller

    async def request_run(self, text: str, name: str = "", axes: list[int] | None = None) -> dict[str, Any]:
        """Ask for a run; the text is checked and simulated from where the axes stand, and nothing moves."""
        return await self._ask("request_run", {"text": text, "name": name, "axes": axes}, LONG_S)

    async def run_requests(self) -> list[dict[str, Any]]:
        """List what waits for an operator, is armed, or was started lately."""
        found: list[dict[str, Any]] = (await self._ask("run_requests", {}))["requests"]
        return found

    async def run_preview(self, sha256: str) -> dict[str, Any]:
        """Get what an operator looks at before arming: ``run``, ``text`` and ``path``, as simulated.

        Raises:
            RequestRefused: MC570 nothing waits with this hash.
        """
        return await self._ask("run_preview", {"sha256": sha256})

    async def arm(
        self, sha256: str, *, seconds: float = 60.0, override: float = 100.0, number: int | None = None
    ) -> dict[str, Any]:
        """Allow a text to be started once.

        Args:
            sha256: of the text, or at least its first 8 digits.
            seconds: how long it may be started. override: the greatest feed override [%].
            number: of the request that was looked at, ``run["number"]``; one that was made anew
                since, perhaps from elsewhere, is not armed. None: any.

        Raises:
            RequestRefused: MC570 nothing waits with this hash, or it was asked for anew; MC575 who asked may
                not arm.
        """
        fields = {"sha256": sha256, "seconds": seconds, "override": override, "number": number}
        return await self._ask("arm", fields)

    async def reject(self, sha256: str, reason: str = "", *, number: int | None = None) -> dict[str, Any]:
        """Say no to a run that somebody asked for; he is shown the reason. The others as in `arm`.

        Raises:
            RequestRefused: MC570 nothing waits with this hash, or it was asked for anew.
        """
        return await self._ask("reject", {"sha256": sha256, "reason": reason, "number": number})

    async def withdraw(self, sha256: str) -> list[dict[str, Any]]:
        """Take a request of your own back; return what waits now.

        Raises:
            RequestRefused: MC570 nothing waits with this hash; MC573 another user asked for it.
        """
        found: list[dict[str, Any]] = (await self._ask("withdraw", {"sha256": sha256}))["requests"]
        return found

    async def run_armed(self, text: str) -> dict[str, Any]:
        """Start an armed program.

        Raises:
            RequestRefused: MC571 not armed, or no longer; MC572 what it depends on has changed, or axes are
            in use; MC573; MC576 rejected, with the reason.
        """
        return await self._ask("run_armed", {"text": text}, 15.0)

    async def _ask(self, method: str, fields: dict[str, Any], seconds: float = 5.0) -> dict[str, Any]:
        reply = await self._caller.call(method, fields, deadline_s=seconds, attempt_s=seconds)
        answer: dict[str, Any] = unpack(reply)
        return answer
