"""Write the tables of methods into their pages: ``python -m mcserver.net.method_pages docs``."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from mcserver.net.method_table import METHODS
from mcserver.net.roles import Role, Roles

END = "<!-- end of the table -->"


class Place(NamedTuple):
    """Place of a table in a page: between a line that names it and `END`."""

    page: str
    table: str

    @property
    def begin(self) -> str:
        """Return the line above the table."""
        return f"<!-- {self.table}: written by python -m mcserver.net.method_pages docs -->"


CALLS = Place("wire/calls.md", "methods")
ROLES = Place("security.md", "roles")
DESCRIBED: Mapping[str, Roles] = MappingProxyType({method.name: method.roles for method in METHODS})


def calls_table() -> list[str]:
    """Return the table of all methods with their messages, for clients."""
    return [
        "| method | request | reply | changes | does |",
        "|---|---|---|---|---|",
        *(
            f"| `{each.name}` | `{each.request.__name__}` | `{each.reply.__name__}` | "
            f"{'yes' if each.changes else 'no'} | {each.summary.replace('``', '`')} |"
            for each in METHODS
        ),
    ]


def roles_table(roles_of: Mapping[str, Roles] = DESCRIBED) -> list[str]:
    """Return the table of permissions, with a row for each set of roles.

    Args:
        roles_of: by method; those of the method table, or as found by attempts.
    """
    return [
        f"| | {' | '.join(role.value for role in Role)} |",
        "|---|" + "---|" * len(Role),
        *(
            f"| {', '.join(f'`{name}`' for name in names)} | "
            + " | ".join("yes" if role in roles else "" for role in Role)
            + " |"
            for roles, names in _by_roles(roles_of)
        ),
    ]


TABLES = {CALLS: calls_table, ROLES: roles_table}


def written(page: str, place: Place) -> str:
    """Return a page's text with its table up to date.

    Raises:
        ValueError: the page has no place for the table.
    """
    before, begin, rest = page.partition(place.begin + "\n")
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{place.page} has no {place.begin} … {END}")
    return "\n".join([before + place.begin, "", *TABLES[place](), "", end + after])


def write(docs: Path) -> None:
    """Write all tables."""
    for place in TABLES:
        page = docs / place.page
        page.write_text(written(page.read_text("utf-8"), place), "utf-8")


def _by_roles(roles_of: Mapping[str, Roles]) -> Iterator[tuple[Roles, list[str]]]:
    """Yield sets of roles with their methods, the widest first."""
    found: dict[Roles, list[str]] = {}
    for name, roles in roles_of.items():
        found.setdefault(roles, []).append(name)
    yield from sorted(found.items(), key=lambda item: -len(item[0]))


if __name__ == "__main__":
    write(Path(sys.argv[1]))
