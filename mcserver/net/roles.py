"""Roles of people and programs, and what they may call; the same at every door."""

from __future__ import annotations

import enum


class Role(enum.Enum):
    """Role of a person or program."""

    OBSERVER = "observer"  # sees everything, may stop
    AGENT = "agent"  # checks, simulates and asks for runs; starts what an operator has armed
    OPERATOR = "operator"  # runs programs, jogs, resets
    ENGINEER = "engineer"  # writes drives' objects, reads the router's admin space


Roles = frozenset[Role]

# Reading costs a server next to nothing and changes nothing. Stopping is for everybody whom a door lets in.
EVERYBODY: Roles = frozenset(Role)
# Computing costs processor time and disk beside a moving machine: not for observers, whose tokens are shared
# most. Requests for runs move nothing; those who may move anyway may still ask for an approval.
ASKERS: Roles = frozenset({Role.AGENT, Role.OPERATOR, Role.ENGINEER})
MOVERS: Roles = frozenset({Role.OPERATOR, Role.ENGINEER})
CONFIGURERS: Roles = frozenset({Role.ENGINEER})


def roles_named(roles: Roles) -> str:
    """Return the names of roles for people, such as ``operator or engineer``."""
    names = [role.value for role in Role if role in roles]
    return " or ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
