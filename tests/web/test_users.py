"""The password file and logins."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from mcserver.errors import ConfigurationError
from mcserver.web.sessions import IDLE_S, Sessions
from mcserver.web.users import FREE_TRIES, LOCKOUT_S, LOOK_S, Role, add_user, read_users
from tests.clock import Clock


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "users"
    add_user(path, "ada", Role.OPERATOR, "correct horse")
    add_user(path, "bob", Role.OBSERVER, "battery staple")
    return path


def test_a_user_logs_in_with_the_password_and_not_with_another(file: Path, clock: Clock) -> None:
    users = read_users(file, clock)
    found = users.log_in("ada", "correct horse", "here")
    assert found is not None
    assert found.role is Role.OPERATOR
    assert users.log_in("ada", "battery staple", "here") is None
    assert users.log_in("eve", "correct horse", "here") is None


def test_the_file_is_readable_by_its_owner_alone_and_holds_no_password(file: Path) -> None:
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert "horse" not in file.read_text("utf-8")


def test_a_user_written_again_has_the_new_password_and_role(file: Path, clock: Clock) -> None:
    add_user(file, "ada", Role.ENGINEER, "a longer one")
    users = read_users(file, clock)
    assert users.log_in("ada", "correct horse", "here") is None
    assert users.role_of("ada") is Role.ENGINEER
    assert users.role_of("bob") is Role.OBSERVER


def test_after_some_wrong_passwords_even_the_right_one_has_to_wait(file: Path, clock: Clock) -> None:
    users = read_users(file, clock)
    for _ in range(FREE_TRIES):
        assert users.log_in("ada", "wrong", "there") is None
    assert users.log_in("ada", "correct horse", "there") is None
    # somebody else's mistakes lock nobody out
    assert users.log_in("ada", "correct horse", "here") is not None
    clock.now += LOCKOUT_S
    assert users.log_in("ada", "correct horse", "there") is not None


def test_a_user_who_is_taken_out_of_the_file_can_do_nothing_more(file: Path, clock: Clock) -> None:
    users = read_users(file, clock)
    sessions = Sessions(users, clock)
    visitor = sessions.visitor(sessions.log_in("ada", "correct horse", "here") or "")
    assert visitor is not None
    kept = [line for line in file.read_text("utf-8").splitlines() if not line.startswith("ada:")]
    rewrite(file, "\n".join(kept))
    clock.now += LOOK_S
    assert not visitor.may("status")
    assert not visitor.is_known()
    assert users.log_in("ada", "correct horse", "here") is None
    assert users.role_of("bob") is Role.OBSERVER
    # nobody is left
    rewrite(file, "")
    clock.now += LOOK_S
    assert users.role_of("bob") is None


def test_a_slip_in_the_password_file_throws_nobody_out(file: Path, clock: Clock) -> None:
    users = read_users(file, clock)
    rewrite(file, file.read_text("utf-8") + "eve\n")
    clock.now += LOOK_S
    assert users.role_of("ada") is Role.OPERATOR
    file.unlink()
    clock.now += LOOK_S
    assert users.role_of("ada") is Role.OPERATOR


def rewrite(file: Path, text: str) -> None:
    file.write_text(text, "utf-8")
    # as if some time had gone by since the file was written before
    changed_ns = file.stat().st_mtime_ns + 10**9
    os.utime(file, ns=(changed_ns, changed_ns))


def test_an_open_page_keeps_its_login_in_use(file: Path, clock: Clock) -> None:
    sessions = Sessions(read_users(file, clock), clock)
    visitor = sessions.visitor(sessions.log_in("bob", "battery staple", "here") or "")
    assert visitor is not None
    for _ in range(3):
        clock.now += 0.6 * IDLE_S
        assert visitor.is_known()
    clock.now += IDLE_S + 1.0
    assert not visitor.is_known()


@pytest.mark.parametrize("line", ["ada", "ada:king:00$00", "ada:operator:zz$00", "ada:operator:00"])
def test_a_line_that_is_not_a_user_is_refused_with_its_number(
    tmp_path: Path, clock: Clock, line: str
) -> None:
    path = tmp_path / "users"
    path.write_text(f"# people\n{line}\n", "utf-8")
    with pytest.raises(ConfigurationError, match=r"MC060.*users:2"):
        read_users(path, clock)


@pytest.mark.parametrize(
    ("name", "password"), [("a:b", "long enough"), ("", "long enough"), ("ada", "short")]
)
def test_names_and_passwords_that_do_not_do_are_refused(tmp_path: Path, name: str, password: str) -> None:
    with pytest.raises(ConfigurationError, match="MC060"):
        add_user(tmp_path / "users", name, Role.OBSERVER, password)
    assert not (tmp_path / "users").exists()


def test_a_session_ends_with_the_logout_and_when_it_is_idle(file: Path, clock: Clock) -> None:
    sessions = Sessions(read_users(file, clock), clock)
    token = sessions.log_in("bob", "battery staple", "here")
    assert token is not None
    visitor = sessions.visitor(token)
    assert visitor is not None
    assert visitor.may("status")
    assert not visitor.may("open")
    clock.now += IDLE_S + 1.0
    assert not visitor.may("status")
    assert sessions.visitor(token) is None
    again = sessions.log_in("bob", "battery staple", "here")
    assert again is not None
    held = sessions.visitor(again)
    sessions.log_out(again)
    assert held is not None
    assert not held.may("status")


def test_without_users_everybody_here_is_an_engineer(clock: Clock) -> None:
    visitor = Sessions(None, clock).visitor("")
    assert visitor is not None
    assert visitor.may("sdo_write")
