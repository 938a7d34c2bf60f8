"""A site's folder: what is written, what stays, and what is refused."""

from __future__ import annotations

import datetime
import json
import stat
from pathlib import Path

import msgspec
import pytest

from mcserver.cli.app import run_command_line
from mcserver.errors import ConfigurationError
from mcserver.security.access import access_control
from mcserver.security.site import Role, Site, User, checked, parsed_user
from mcserver.security.site_files import configuration_path, read_site
from mcserver.security.site_folder import write_site

NOW = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
SITE = Site("10.0.0.1", machines=("cell-1",), users=(User("alice", Role.OPERATOR, ("cell-1",)),))


def contents(path: Path) -> dict[str, object]:
    found: dict[str, object] = json.loads(path.read_text("utf-8").partition("\n")[2])
    return found


def test_nobody_else_may_read_what_is_written(tmp_path: Path) -> None:
    folder = tmp_path / "site"
    write_site(folder, SITE, NOW)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert {stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()} == {0o600}


def test_a_client_s_configuration_names_its_user_and_a_machine_s_none(tmp_path: Path) -> None:
    write_site(tmp_path, SITE, NOW)
    assert contents(configuration_path(tmp_path, "alice"))["metadata"] == {"user": "alice"}
    assert "metadata" not in contents(configuration_path(tmp_path, "machine.cell-1"))


def test_whoever_is_there_keeps_his_file_when_somebody_new_comes(tmp_path: Path) -> None:
    write_site(tmp_path, SITE, NOW)
    before = configuration_path(tmp_path, "alice").read_bytes()
    grown = msgspec.structs.replace(SITE, users=(*SITE.users, User("bob", Role.OBSERVER)))
    write_site(tmp_path, grown, NOW)
    assert configuration_path(tmp_path, "alice").read_bytes() == before
    assert configuration_path(tmp_path, "bob").exists()
    assert read_site(tmp_path) == grown


def test_rules_let_nobody_through_by_default_and_name_every_identity() -> None:
    rules = access_control(SITE)
    assert rules["default_permission"] == "deny"
    assert [each["cert_common_names"] for each in rules["subjects"]] == [["machine.cell-1"], ["alice"]]
    inwards = [rule for rule in rules["rules"] if rule["flows"] == ["ingress"] and "put" in rule["messages"]]
    keys = {key for rule in inwards if rule["id"].startswith("alice/") for key in rule["key_exprs"]}
    assert keys == {"mc/@v1/cell-1/estop", "mc/@v1/cell-1/in/alice.$*/*"}


def test_with_passwords_certificate_and_user_have_to_be_the_same_identity(tmp_path: Path) -> None:
    site = msgspec.structs.replace(SITE, passwords=True)
    write_site(tmp_path, site, NOW)
    assert {tuple(each["usernames"]) for each in access_control(site)["subjects"]} == {
        ("machine.cell-1",),
        ("alice",),
    }
    assert "alice:" in (tmp_path / "passwords.txt").read_text("utf-8")


@pytest.mark.parametrize("text", ["alice", "alice:king", "al.ice:operator", ":operator", "a/b:observer"])
def test_a_user_that_cannot_be_one_is_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match="MC560"):
        parsed_user(text)


def test_a_user_of_a_machine_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="cell-9"):
        checked(msgspec.structs.replace(SITE, users=(parsed_user("alice:operator:cell-9"),)))


def test_init_makes_a_site_and_adds_to_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "site"
    arguments = ["security", "init", str(folder), "--json"]
    assert run_command_line([*arguments, "--router", "10.0.0.1", "--machine", "cell-1"]) == 0
    assert run_command_line([*arguments, "--user", "alice:operator:cell-1"]) == 0
    assert [each.name for each in read_site(folder).users] == ["alice"]
    answers = [json.loads(text) for text in capsys.readouterr().out.replace("}\n{", "}\0{").split("\0")]
    assert all(each["ok"] for each in answers)


def test_a_new_site_without_its_router_is_refused(tmp_path: Path) -> None:
    assert run_command_line(["security", "init", str(tmp_path / "site"), "--machine", "cell-1"]) == 3


def test_a_check_where_no_router_runs_says_that_nobody_answers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mcserver.security.proof.CONNECT_MS", 200)
    write_site(tmp_path, msgspec.structs.replace(SITE, router="127.0.0.1", port=1), NOW)
    assert run_command_line(["security", "check", str(tmp_path)]) == 5
    assert "MC562" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["router", "Router", "authority", "machine", "site", "passwords"])
def test_a_user_with_the_name_of_a_file_of_the_site_is_refused_and_loses_nothing(
    tmp_path: Path, name: str
) -> None:
    write_site(tmp_path, SITE, NOW)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    grown = msgspec.structs.replace(SITE, users=(*SITE.users, User(name, Role.ENGINEER)))
    with pytest.raises(ConfigurationError, match="MC560"):
        write_site(tmp_path, grown, NOW)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_names_that_differ_in_capitals_only_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="twice"):
        checked(msgspec.structs.replace(SITE, users=(*SITE.users, User("Alice", Role.OBSERVER))))
    with pytest.raises(ConfigurationError, match="twice"):
        checked(msgspec.structs.replace(SITE, machines=("cell-1", "Cell-1")))


def test_no_two_identities_share_a_file(tmp_path: Path) -> None:
    written = write_site(tmp_path, SITE, NOW)
    assert len({path.name.casefold() for path in written}) == len(written)
