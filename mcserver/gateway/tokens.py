"""Who may use the gateway: secret tokens with a role each.

The token file has one client a line, ``name:role:sha256``, the hash in hexadecimal. Tokens are random, so
that a plain hash is enough: there is nothing to guess.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from pathlib import Path

import msgspec

from mcserver.errors import ConfigurationError
from mcserver.net.roles import Role as Role
from mcserver.web.credential_file import CredentialFile

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,30}")


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
    """Return the clients of a token file.

    Raises:
        ConfigurationError: MC070 it cannot be read, or a line of it is not a client.
    """
    file = _token_file(path)
    principals: dict[str, Principal] = {}
    for number, fields in file.entries():
        try:
            name, role, digest = fields
            if not _NAME.fullmatch(name) or len(bytes.fromhex(digest)) != 32:
                raise ValueError(name)
            principals[digest.lower()] = Principal(name, Role(role))
        except ValueError as error:
            raise file.refusal("is not a client: it has to be name:role:sha256", number) from error
    return Tokens(principals)


def add_token(path: Path, name: str, role: Role) -> str:
    """Write a client into the file, in place of one of that name, and return its new token.

    Raises:
        ConfigurationError: MC070 the name does not do, or the file cannot be written.
    """
    if not _NAME.fullmatch(name):
        raise ConfigurationError(
            "MC070", f"{name!r} cannot be a client's name", "letters, digits, '_' and '-', at most 31"
        )
    token = secrets.token_urlsafe(32)
    _token_file(path).replace(name, role.value, _digest(token))
    return token


def _token_file(path: Path) -> CredentialFile:
    roles = "|".join(role.value for role in Role)
    remedy = f"write it with mcserver gateway --tokens PATH --add-token NAME --role {roles}"
    return CredentialFile(path, "MC070", "token file", remedy)


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode("utf-8", "replace")).hexdigest()
