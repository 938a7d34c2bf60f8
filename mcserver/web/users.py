"""Who may log in to the page, and what each may do.

The password file has one user a line, ``name:role:salt$hash`` with scrypt's hash (RFC 7914) in hexadecimal.
"""

from __future__ import annotations

import hashlib
import hmac
import logging
import re
import secrets
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path

import msgspec

from mcserver.errors import ConfigurationError
from mcserver.net.roles import Role as Role
from mcserver.web.credential_file import CredentialFile

log = logging.getLogger(__name__)

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@-]{0,62}")
# scrypt's cost: some 50 ms and 16 MiB a try, the value that RFC 7914 gives for interactive logins
_N, _R, _P = 2**14, 8, 1
# wrong passwords of one name from one address before it has to wait, and how long [s]
FREE_TRIES = 5
LOCKOUT_S = 30.0
REMEMBERED_TRIES = 1024
# how often the file is looked at for changes [s]
LOOK_S = 1.0


class User(msgspec.Struct, frozen=True):
    """One user; ``secret`` is ``salt$hash``."""

    name: str
    role: Role
    secret: str


class Users:
    """The users of a password file, and the attempts to log in as one of them.

    The file is read again when it has changed. One that has a line with a fault changes nothing, so that a
    slip of an editor throws nobody out.

    Args:
        file: of the passwords. clock: seconds, never stepping.

    Raises:
        ConfigurationError: MC060 it cannot be read, is empty, or a line of it is not a user.
    """

    def __init__(self, file: CredentialFile, clock: Callable[[], float]) -> None:
        self._file = file
        self._clock = clock
        self._changed_at = file.changed_at()
        self._looked_at = clock()
        self._users = _users_of(file)
        self._tries: OrderedDict[tuple[str, str], tuple[int, float]] = OrderedDict()

    def log_in(self, name: str, password: str, address: str) -> User | None:
        """The user, or None: wrong name, wrong password, or too many tries of late. Computes some 50 ms."""
        key = (name, address)
        tries, since = self._tries.get(key, (0, 0.0))
        if tries >= FREE_TRIES and self._clock() - since < LOCKOUT_S:
            return None
        self._look()
        user = self._users.get(name)
        # an unknown name costs as much time as a wrong password
        secret = user.secret if user is not None else "00$00"
        if _matches(password, secret) and user is not None:
            self._tries.pop(key, None)
            return user
        self._tries[key] = (tries + 1 if tries < FREE_TRIES else 1, self._clock())
        self._tries.move_to_end(key)
        while len(self._tries) > REMEMBERED_TRIES:
            self._tries.popitem(last=False)
        return None

    def role_of(self, name: str) -> Role | None:
        """The role that a user has now; None: there is no such user any more."""
        self._look()
        user = self._users.get(name)
        return None if user is None else user.role

    def _look(self) -> None:
        now = self._clock()
        if now - self._looked_at < LOOK_S:
            return
        self._looked_at = now
        changed_at = self._file.changed_at()
        if changed_at == self._changed_at:
            return
        self._changed_at = changed_at
        try:
            self._users = _users_of(self._file, may_be_empty=True)
        except ConfigurationError as error:
            log.warning("users stay as they were: %s", error.message)


def read_users(path: Path, clock: Callable[[], float]) -> Users:
    """The users of a password file.

    Raises:
        ConfigurationError: MC060 it cannot be read, or a line of it is not a user.
    """
    return Users(_password_file(path), clock)


def _users_of(file: CredentialFile, *, may_be_empty: bool = False) -> dict[str, User]:
    users: dict[str, User] = {}
    for number, fields in file.entries(may_be_empty=may_be_empty):
        try:
            name, role, secret = fields
            users[name] = User(name, Role(role), secret)
            salt, digest = secret.split("$")
            bytes.fromhex(salt + digest)
        except ValueError as error:
            raise file.refusal("is not a user: it has to be name:role:salt$hash", number) from error
    return users


def add_user(path: Path, name: str, role: Role, password: str) -> None:
    """Write a user into the file, in place of one of that name; readable by its owner alone.

    Raises:
        ConfigurationError: MC060 the name or the password does not do, or the file cannot be written.
    """
    if not _NAME.fullmatch(name):
        raise ConfigurationError(
            "MC060", f"{name!r} cannot be a user's name", "letters, digits, '_', '.', '@', '-'"
        )
    if len(password) < 8:
        raise ConfigurationError("MC060", "the password is shorter than 8 characters", "take a longer one")
    _password_file(path).replace(name, role.value, _secret(password))


def _password_file(path: Path) -> CredentialFile:
    roles = "|".join(role.value for role in Role)
    remedy = f"write it with mcserver web --users PATH --add-user NAME --role {roles}"
    return CredentialFile(path, "MC060", "password file", remedy)


def _secret(password: str) -> str:
    salt = secrets.token_bytes(16)
    return f"{salt.hex()}${_hash(password, salt).hex()}"


def _matches(password: str, secret: str) -> bool:
    salt, _, digest = secret.partition("$")
    return hmac.compare_digest(_hash(password, bytes.fromhex(salt)), bytes.fromhex(digest))


def _hash(password: str, salt: bytes) -> bytes:
    return hashlib.scrypt(password.encode("utf-8"), salt=salt, n=_N, r=_R, p=_P, maxmem=64 * 1024 * 1024)
