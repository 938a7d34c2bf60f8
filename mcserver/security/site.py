"""A site: its routers, machines and people, and who of them may do what."""

from __future__ import annotations

import re

import msgspec

from mcserver.errors import ConfigurationError
from mcserver.net.keys import is_name
from mcserver.net.roles import Role as Role

# the certificate of a machine is "machine.NAME": no user has a dot, so that none can be a machine
MACHINE_PREFIX = "machine."
EVERY_MACHINE = "*"
# names of the folder's other files and of other certificates
RESERVED = frozenset({"authority", "machine", "passwords", "router", "site"})

# the user is what stands before the first dot of a client id
_USER = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}")
# of a certificate's common name: 64, less the prefix
_LONGEST_MACHINE = 56


class User(msgspec.Struct, frozen=True):
    """A person or program.

    Attributes:
        machines: names of those that the role holds for; ``*``: every one, those to come included.
    """

    name: str
    role: Role
    machines: tuple[str, ...] = (EVERY_MACHINE,)


class Site(msgspec.Struct, frozen=True):
    """Everybody on one network of routers.

    Attributes:
        router: host name or address of the router, as the others reach it.
        passwords: a user name and a password are asked for beside the certificate.
    """

    router: str
    port: int = 7447
    machines: tuple[str, ...] = ()
    users: tuple[User, ...] = ()
    passwords: bool = False

    @property
    def endpoint(self) -> str:
        """Where the router is reached."""
        host = f"[{self.router}]" if ":" in self.router else self.router
        return f"tls/{host}:{self.port}"

    def identities(self) -> list[str]:
        """Common names of all certificates but the router's, machines first."""
        return [machine_identity(name) for name in self.machines] + [user.name for user in self.users]


def machine_identity(machine: str) -> str:
    """Common name of a machine's certificate."""
    return MACHINE_PREFIX + machine


def parsed_user(text: str) -> User:
    """Return a user from ``NAME:ROLE`` or ``NAME:ROLE:MACHINE,MACHINE``.

    Raises:
        ConfigurationError: MC560.
    """
    name, _, rest = text.partition(":")
    role, _, machines = rest.partition(":")
    if _USER.fullmatch(name) is None:
        raise _refused(
            f"{name!r} cannot be a user", "use letters, digits, '-' and '_', 32 at most: NAME:ROLE[:MACHINES]"
        )
    if role not in {each.value for each in Role}:
        raise _refused(
            f"{text!r}: there is no role {role!r}", f"take one of {', '.join(each.value for each in Role)}"
        )
    chosen = tuple(each.strip() for each in machines.split(",") if each.strip()) or (EVERY_MACHINE,)
    return User(name, Role(role), chosen)


def checked(site: Site) -> Site:
    """Return the site, where everything in it fits.

    Raises:
        ConfigurationError: MC560 a name that cannot be one, or a user's machine that is not there.
    """
    for machine in site.machines:
        if not is_name(machine) or len(machine) > _LONGEST_MACHINE:
            raise _refused(
                f"{machine!r} cannot be a machine",
                f"use letters, digits, '-', '_' and '.', {_LONGEST_MACHINE} at most",
            )
    for user in site.users:
        if user.name.casefold() in RESERVED:
            raise _refused(
                f"{user.name!r} cannot be a user: the site's own files and certificates have that name",
                "give another name",
            )
        for machine in user.machines:
            if machine != EVERY_MACHINE and machine not in site.machines:
                raise _refused(
                    f"{user.name} is to use {machine!r}, which is no machine of the site",
                    f"give --machine {machine}; there are {', '.join(site.machines) or 'none yet'}",
                )
    # a file for each, and some file systems know no capitals
    names = [name.casefold() for name in site.identities()]
    twice = [each for each in site.identities() if names.count(each.casefold()) > 1]
    if twice:
        raise _refused(
            f"{twice[0]} is there twice", "give everybody a name of their own, not in capitals only"
        )
    if not re.fullmatch(r"[A-Za-z0-9.:-]+", site.router):
        raise _refused(f"{site.router!r} is no host name or address", "such as --router 192.168.1.10")
    return site


def _refused(message: str, hint: str) -> ConfigurationError:
    return ConfigurationError("MC560", message, hint)
