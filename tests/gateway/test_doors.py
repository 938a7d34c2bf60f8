"""Role x method x door, from real attempts: the same at the gateway, on the page and at the router.

The router's attempts are those of `mcserver security check` (`mcserver.security.proof`), which
tests/security/test_access.py makes at a running router for every role and every method of the table.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mcserver.net.method_pages import ROLES, written
from mcserver.net.method_table import METHODS, Method, method_names
from mcserver.net.roles import Role
from mcserver.web.sessions import Sessions
from mcserver.web.users import add_user, read_users
from tests.gateway.conftest import GatewayProcess
from tests.gateway.test_websocket import Client, Tokens, opening

SECURITY = Path(__file__).parents[2] / "docs" / "security.md"
PASSWORD = "correct horse"


def refused_params(method: Method) -> dict[str, Any]:
    """Return params that a server refuses before it does anything; none where a method has no field."""
    return {name: {"no": {"such": "type"}} for name in method.request.__struct_fields__ if name != "request"}


@pytest.mark.parametrize("role", Role, ids=lambda role: role.value)
async def test_a_role_may_at_the_gateway_what_the_table_says(
    gateway: GatewayProcess, tokens: Tokens, role: Role
) -> None:
    passed = []
    async with opening(gateway, tokens[1][role.value]) as socket:
        client = Client(socket)
        await client.receive()
        for method in METHODS:
            reply = await client.ask(
                "call", machine="cell", method=method.name, params=refused_params(method)
            )
            # what changes something is refused by the server, and was let through by the gateway
            code = "" if reply["ok"] else reply["error"]["code"]
            assert not (method.changes and reply["ok"]) or method.name == "leave"
            assert code in ("", "MC072", "MC500", "MC511", "MC580", "MC587"), (method.name, reply["error"])
            if code != "MC072":
                passed.append(method.name)
        assert (await client.ask("call", machine="cell", method="wave"))["error"]["code"] == "MC501"
    assert tuple(passed) == method_names(role)


@pytest.mark.parametrize("role", Role, ids=lambda role: role.value)
def test_a_role_may_on_the_page_what_the_table_says(tmp_path: Path, role: Role) -> None:
    file = tmp_path / "users"
    add_user(file, "ada", role, PASSWORD)
    sessions = Sessions(read_users(file, lambda: 0.0), lambda: 0.0)
    token = sessions.log_in("ada", PASSWORD, "127.0.0.1")
    assert token is not None
    visitor = sessions.visitor(token)
    assert visitor is not None
    assert tuple(each.name for each in METHODS if visitor.may(each.name)) == method_names(role)
    sessions.log_out(token)
    assert not any(visitor.may(each.name) for each in METHODS)


def test_the_page_of_access_shows_what_is_proved() -> None:
    page = SECURITY.read_text("utf-8")
    assert page == written(page, ROLES)
