"""How the page may be served."""

from __future__ import annotations

import io
import socket
import sys
from pathlib import Path

import pytest

from mcserver.cli.app import run_command_line
from mcserver.doors.listening import Address
from mcserver.errors import ConfigurationError, ServiceError
from mcserver.web.site import WebOptions, serve
from mcserver.web.users import Role, add_user


async def test_without_a_login_others_do_not_reach_the_page(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"MC064.*this computer only"):
        await serve(WebOptions(Address("0.0.0.0", 0), tmp_path))


async def test_passwords_do_not_cross_the_network_in_clear_text(tmp_path: Path) -> None:
    add_user(tmp_path / "users", "ada", Role.OPERATOR, "correct horse")
    with pytest.raises(ConfigurationError, match=r"MC064.*clear text"):
        await serve(WebOptions(Address("0.0.0.0", 0), tmp_path, users=tmp_path / "users"))


async def test_a_certificate_needs_its_key(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"MC064.*key"):
        await serve(WebOptions(Address("127.0.0.1", 0, tmp_path / "c.pem"), tmp_path))


async def test_a_port_that_is_taken_is_refused_with_a_remedy(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(ServiceError, match="MC065"):
        await serve(WebOptions(Address("127.0.0.1", taken.getsockname()[1]), tmp_path))


def test_a_user_is_added_by_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("correct horse\n"))
    file = tmp_path / "users"
    words = ["web", "--users", str(file), "--add-user", "ada", "--role", "engineer"]
    assert run_command_line(words) == 0
    assert file.read_text("utf-8").startswith("ada:engineer:")
