"""Who may call what: the roles of people and programs, the same at every door."""

from __future__ import annotations

import enum


class Role(enum.Enum):
    """What a person or program is there for."""

    OBSERVER = "observer"  # sees everything, may stop
    AGENT = "agent"  # checks, simulates and asks for runs; starts what an operator has armed
    OPERATOR = "operator"  # runs programs, jogs, resets
    ENGINEER = "engineer"  # writes drives' objects, reads the router's admin space


Roles = frozenset[Role]

# Looking costs a server next to nothing and changes nothing. Stopping is for everybody whom a door lets in.
EVERYBODY: Roles = frozenset(Role)
# Computing costs processor time and disk beside a machine that moves: not for observers, whose tokens are
# shared most. Asking moves nothing; who may move by himself may let somebody else look first.
ASKERS: Roles = frozenset({Role.AGENT, Role.OPERATOR, Role.ENGINEER})
MOVERS: Roles = frozenset({Role.OPERATOR, Role.ENGINEER})
CONFIGURERS: Roles = frozenset({Role.ENGINEER})


def roles_named(roles: Roles) -> str:
    """Return the names of roles as people read them, such as ``operator or engineer``."""
    names = [role.value for role in Role if role in roles]
    return " or ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
