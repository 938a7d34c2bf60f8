"""How a program waits before what another one moves."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from mcserver.errors import Diagnostic
from mcserver.planning.shared_space import SharedSpace, Tenant, Wait

# How often it is looked whether another program has left, and from when on those that wait for each other do
# so for good: the motion of each has been looked at since [s].
LOOK_S = 0.1
LOCKED_S = 0.3


class Waiting:
    """Decide whether a program waits before a contact, or ends there.

    Args:
        space: of all programs. tenant: this one.

    Attributes:
        fault: the contact before which it waits; None: it does not.
    """

    def __init__(self, space: SharedSpace, tenant: Tenant) -> None:
        self._space = space
        self._tenant = tenant
        self.fault: Diagnostic | None = None
        self._look_at = -math.inf

    @property
    def program(self) -> str:
        """The first program that is waited for; empty: none is."""
        wait = self._tenant.wait
        return "" if wait is None or self.fault is None else wait.programs[0]

    @property
    def due(self) -> bool:
        """Whether it is time to look whether what is waited for has left."""
        return self._space.time >= self._look_at

    def end(self) -> None:
        """Note that the way is free, or that the program goes no further."""
        self.fault = self._tenant.wait = None

    def before(self, fault: Diagnostic, others: Sequence[str]) -> Diagnostic | None:
        """Wait for other programs; return the fault with which this one ends instead: all of them wait for
        each other, and it has come to that last.
        """
        tenant, now = self._tenant, self._space.time
        if tenant.wait is None or tenant.wait.programs != tuple(others):
            tenant.wait = Wait(tuple(others), now)
        if now - tenant.wait.since >= LOCKED_S and self._space.locked(tenant):
            self.end()
            return msgspec.structs.replace(fault, message=f"{fault.message}, and both wait for each other")
        self.fault, self._look_at = fault, now + LOOK_S
        return None
