"""Wait before a contact with a body that another program moves."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from mcserver.errors import Diagnostic
from mcserver.planning.shared_space import SharedSpace, Tenant, Wait

# Period of checking whether another program has left [s].
LOOK_S = 0.1
# Programs that wait for each other this long are deadlocked: each has been checked since [s].
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
        """The first program that is waited for; empty without one."""
        wait = self._tenant.wait
        return "" if wait is None or self.fault is None else wait.programs[0]

    @property
    def due(self) -> bool:
        """Whether it is time to check again."""
        return self._space.time >= self._look_at

    def end(self) -> None:
        """End waiting: the way is free, or the program has ended."""
        self.fault = self._tenant.wait = None

    def before(self, fault: Diagnostic, others: Sequence[str]) -> Diagnostic | None:
        """Wait for other programs before a contact.

        Returns:
            The fault with which this program ends instead, as the last one to enter a deadlock; else None.
        """
        tenant, now = self._tenant, self._space.time
        if tenant.wait is None or tenant.wait.programs != tuple(others):
            tenant.wait = Wait(tuple(others), now)
        if now - tenant.wait.since >= LOCKED_S and self._space.locked(tenant):
            self.end()
            return msgspec.structs.replace(fault, message=f"{fault.message}, and both wait for each other")
        self.fault, self._look_at = fault, now + LOOK_S
        return None
