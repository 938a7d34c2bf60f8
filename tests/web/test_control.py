"""Who drives a machine: one browser at a time, and nobody whose login has ended."""

from __future__ import annotations

from mcserver.net.method_table import BY_NAME
from mcserver.net.roles import EVERYBODY, Role
from mcserver.web.control import AWAY_S, Control, Driver, needs_control
from mcserver.web.sessions import Visitor


class Login:
    """A login that can end."""

    def __init__(self) -> None:
        self.role: Role | None = Role.OPERATOR

    def driver(self, browser: str, name: str = "ada") -> Driver:
        return Driver(browser, Visitor(name, lambda: self.role, may_leave=True))


def test_two_browsers_of_one_person_are_two_drivers() -> None:
    control, login = Control(lambda: 0.0), Login()
    control.take(login.driver("aaaa1"))
    assert control.other("aaaa1") is None
    other = control.other("bbbb2")
    assert other is not None
    assert other.name == "ada (browser aaaa)"


def test_who_gives_back_gives_only_what_he_has() -> None:
    control, login = Control(lambda: 0.0), Login()
    control.take(login.driver("aaaa1"))
    control.take(login.driver("bbbb2"))
    control.give_back("aaaa1")
    assert control.driver is not None
    control.give_back("bbbb2")
    assert control.driver is None


def test_a_browser_without_a_link_gives_control_back_after_a_while() -> None:
    now = [0.0]
    control, login = Control(lambda: now[0]), Login()
    control.take(login.driver("aaaa1"))
    control.leave("bbbb2")
    now[0] = 2 * AWAY_S
    assert control.driver is not None
    control.leave("aaaa1")
    now[0] += AWAY_S
    assert control.driver is not None
    now[0] += 0.1
    assert control.driver is None


def test_who_has_left_the_page_keeps_nobody_out_but_others() -> None:
    control, login = Control(lambda: 0.0), Login()
    control.take(login.driver("aaaa1"))
    assert control.other_person("ada") is not None
    control.leave("aaaa1")
    assert control.other_person("ada") is None
    assert control.other_person("bob") is not None


def test_control_stays_with_a_person_whose_page_is_built_anew_and_with_no_other() -> None:
    now = [0.0]
    control, login = Control(lambda: now[0]), Login()
    control.take(login.driver("aaaa1"))
    # not away: a second browser of hers takes nothing by being opened
    control.come(login.driver("cccc3"))
    assert control.other("aaaa1") is None
    control.leave("aaaa1")
    control.come(login.driver("bbbb2", "bob"))
    assert control.other("aaaa1") is None
    control.come(login.driver("cccc3"))
    now[0] = 2 * AWAY_S
    assert control.other("aaaa1") is not None


def test_a_login_that_has_ended_or_lost_its_role_drives_nothing() -> None:
    for role in (None, Role.OBSERVER):
        control, login = Control(lambda: 0.0), Login()
        control.take(login.driver("aaaa1"))
        login.role = role
        assert control.driver is None


def test_stops_and_looks_need_no_control_and_what_moves_does() -> None:
    free = {name for name, method in BY_NAME.items() if not needs_control(method.name)}
    assert {"hold", "abort", "stop", "estop", "status", "simulate", "reject", "record_save"} & set(
        BY_NAME
    ) <= free
    assert {name for name, method in BY_NAME.items() if method.roles == EVERYBODY} <= free
    for name in (
        "open",
        "jog",
        "resume",
        "reset",
        "override",
        "arm",
        "home",
        "set_output",
        "set_table_row",
        "continue_program",
    ):
        assert name not in free
