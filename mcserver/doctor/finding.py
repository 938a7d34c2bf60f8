"""One finding about this computer."""

from __future__ import annotations

import enum
from collections.abc import Iterable

import msgspec


class State(enum.Enum):
    """How a finding bears on the server."""

    OK = "ok"
    ADVICE = "advice"  # the server runs, less well or with fewer abilities
    MISSING = "missing"  # the server cannot run


class Finding(msgspec.Struct, frozen=True):
    """What was looked at, what was found, and what to do about it.

    Attributes:
        area: ``python``, ``realtime``, ``can``, ``buses`` or ``service``.
        title: what was looked at.
        found: the value seen.
        fix: what to do; empty where nothing lacks.
    """

    area: str
    title: str
    state: State
    found: str
    fix: str = ""


def good(area: str, title: str, found: str) -> Finding:
    """Nothing lacks."""
    return Finding(area, title, State.OK, found)


def advice(area: str, title: str, found: str, fix: str) -> Finding:
    """The server runs without it, less well."""
    return Finding(area, title, State.ADVICE, found, fix)


def missing(area: str, title: str, found: str, fix: str) -> Finding:
    """The server cannot run without it."""
    return Finding(area, title, State.MISSING, found, fix)


def worst(findings: Iterable[Finding]) -> State:
    """Return the gravest state among findings."""
    order = (State.OK, State.ADVICE, State.MISSING)
    return max((finding.state for finding in findings), key=order.index, default=State.OK)
