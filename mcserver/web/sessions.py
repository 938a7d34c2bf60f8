"""Logins of browsers: a random cookie each, kept in this process only."""

from __future__ import annotations

import secrets
from collections import OrderedDict
from collections.abc import Callable

from starlette.requests import HTTPConnection

from mcserver.net.method_table import BY_NAME
from mcserver.net.roles import Role, Roles
from mcserver.web.users import User, Users

COOKIE = "mc_session"
IDLE_S = 12 * 3600.0
MAX_SESSIONS = 1000


class Visitor:
    """Who looks at a page: a user's name, and what the user may do at this moment.

    Attributes:
        may_leave: whether there is a login that can be ended.
    """

    def __init__(self, name: str, role_now: Callable[[], Role | None], *, may_leave: bool) -> None:
        self.name = name
        self.may_leave = may_leave
        self._role_now = role_now

    def is_known(self) -> bool:
        """Whether the login still counts; asking keeps it in use, as an open page does."""
        return self._role_now() is not None

    def may(self, method: str) -> bool:
        """Whether the visitor may call a method now: a logout or a removed user ends it at once."""
        return self.has(BY_NAME[method].roles)

    def has(self, roles: Roles) -> bool:
        """Whether the visitor has one of some roles now."""
        return self._role_now() in roles


class Sessions:
    """Who is logged in.

    Args:
        users: those that may log in; None: everybody is an engineer (loopback only).
        clock: seconds, never stepping.
    """

    def __init__(self, users: Users | None, clock: Callable[[], float]) -> None:
        self._users = users
        self._clock = clock
        self._sessions: OrderedDict[str, tuple[str, float]] = OrderedDict()

    @property
    def needs_login(self) -> bool:
        return self._users is not None

    def log_in(self, name: str, password: str, address: str) -> str | None:
        """A new session's token, or None."""
        if self._users is None:
            return None
        user: User | None = self._users.log_in(name, password, address)
        if user is None:
            return None
        token = secrets.token_urlsafe(32)
        self._sessions[token] = (user.name, self._clock())
        while len(self._sessions) > MAX_SESSIONS:
            self._sessions.popitem(last=False)
        return token

    def log_out(self, token: str) -> None:
        self._sessions.pop(token, None)

    def visitor(self, token: str) -> Visitor | None:
        """The visitor with this cookie; None: not logged in."""
        if self._users is None:
            return Visitor("local", lambda: Role.ENGINEER, may_leave=False)
        name = self._name(token)
        return None if name is None else Visitor(name, lambda: self._role(token), may_leave=True)

    def holder(self, connection: HTTPConnection) -> str:
        """The login whose cookie a request shows; empty: none."""
        token = connection.cookies.get(COOKIE, "")
        return token if self._users is not None and self._name(token) is not None else ""

    def _role(self, token: str) -> Role | None:
        name = self._name(token)
        return None if name is None or self._users is None else self._users.role_of(name)

    def _name(self, token: str) -> str | None:
        found = self._sessions.get(token)
        if found is None:
            return None
        name, used_at = found
        now = self._clock()
        if now - used_at > IDLE_S:
            del self._sessions[token]
            return None
        self._sessions[token] = (name, now)
        return name
