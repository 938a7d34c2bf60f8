"""Who may use the gateway: secret tokens with a role each.

The token file has one client a line, ``name:role:sha256``, the hash in hexadecimal. Tokens are random, so
that a plain hash is enough: there is nothing to guess.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import re
import secrets
from pathlib import Path

import msgspec

from mcserver.errors import ConfigurationError
from mcserver.web.users import Role

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,30}")
# What each method needs; a method that is not listed needs an engineer.
_READING = frozenset({"info", "status", "programs", "events", "check", "simulate", "drives", "io", "arms"})
_OPERATING = frozenset(
    {"open", "submit", "close", "hold", "resume", "step", "abort", "override", "jog", "reset", "estop"}
)


def role_for(method: str) -> Role:
    """The role that a method needs."""
    if method in _READING:
        return Role.OBSERVER
    return Role.OPERATOR if method in _OPERATING else Role.ENGINEER


class Principal(msgspec.Struct, frozen=True):
    """Who holds a token: a name that becomes a part of the client's id, and a role."""

    name: str
    role: Role


LOCAL = Principal("local", Role.ENGINEER)


class Tokens:
    """The clients of a token file, by the hash of their token."""

    def __init__(self, principals: dict[str, Principal]) -> None:
        self._principals = principals

    def principal(self, token: str) -> Principal | None:
        """Who holds this token; None: nobody."""
        digest = _digest(token)
        found = None
        for known, principal in self._principals.items():
            if hmac.compare_digest(known, digest):
                found = principal
        return found


def read_tokens(path: Path) -> Tokens:
    """The clients of a token file.

    Raises:
        ConfigurationError: MC070 it cannot be read, or a line of it is not a client.
    """
    try:
        lines = path.read_text("utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(
            "MC070",
            f"the token file {path} cannot be read: {error}",
            "make it with mcserver gateway --add-token NAME",
        ) from error
    principals: dict[str, Principal] = {}
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            name, role, digest = line.split(":")
            if not _NAME.fullmatch(name) or len(bytes.fromhex(digest)) != 32:
                raise ValueError(line)
            principals[digest.lower()] = Principal(name, Role.of(role))
        except ValueError as error:
            raise ConfigurationError(
                "MC070",
                f"{path}:{number} is not a client: it has to be name:role:sha256",
                "write it with mcserver gateway --add-token NAME --role observer|operator|engineer",
            ) from error
    if not principals:
        raise ConfigurationError(
            "MC070", f"the token file {path} is empty", "mcserver gateway --add-token NAME"
        )
    return Tokens(principals)


def add_token(path: Path, name: str, role: Role) -> str:
    """Writes a client into the file, in place of one of that name, and returns its new token.

    Raises:
        ConfigurationError: MC070 the name does not do, or the file cannot be written.
    """
    if not _NAME.fullmatch(name):
        raise ConfigurationError(
            "MC070", f"{name!r} cannot be a client's name", "letters, digits, '_' and '-', at most 31"
        )
    token = secrets.token_urlsafe(32)
    try:
        kept = path.read_text("utf-8").splitlines() if path.exists() else []
        lines = [line for line in kept if line.partition(":")[0] != name]
        lines.append(f"{name}:{role.name.lower()}:{_digest(token)}")
        temporary = path.with_name(f"{path.name}.new")
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")
        temporary.replace(path)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(
            "MC070", f"the token file {path} cannot be written: {error}", "choose another with --tokens"
        ) from error
    return token


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode("utf-8", "replace")).hexdigest()
