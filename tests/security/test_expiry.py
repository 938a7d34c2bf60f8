"""Certificates that end are named in time, by whom they concern."""

from __future__ import annotations

import asyncio
import datetime
import json
from pathlib import Path

import pytest

from mcserver.cli.app import run_command_line
from mcserver.security.certificates import IDENTITY_DAYS
from mcserver.security.expiry import WARNED_BEFORE, first_ending, warn_of_expiry
from mcserver.security.site import Role, Site, User
from mcserver.security.site_files import configuration_path
from mcserver.security.site_folder import write_site

NOW = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
END = NOW + datetime.timedelta(days=IDENTITY_DAYS)
SITE = Site("127.0.0.1", port=1, machines=("cell-1",), users=(User("alice", Role.OPERATOR),))


@pytest.mark.parametrize("identity", ["alice", "machine.cell-1", "router"])
def test_the_end_of_every_file_s_certificate_is_read(tmp_path: Path, identity: str) -> None:
    write_site(tmp_path, SITE, NOW)
    ending = first_ending(configuration_path(tmp_path, identity))
    assert ending is not None
    assert ending.ends == END
    assert not ending.is_near(END - WARNED_BEFORE)
    assert ending.is_near(END - WARNED_BEFORE + datetime.timedelta(hours=1))
    assert "ends in 3 days" in ending.said(END - datetime.timedelta(days=3, hours=5))
    assert "has ended" in ending.said(END)


@pytest.mark.parametrize(
    "content", ["", "{}", "nonsense", '{transport: {link: {tls: {connect_certificate: "/no"}}}}']
)
def test_a_configuration_without_certificates_has_no_end(tmp_path: Path, content: str) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(content)
    assert first_ending(file) is None
    assert first_ending(tmp_path / "nothing") is None


async def test_a_server_warns_each_day_from_thirty_days_before_on(tmp_path: Path) -> None:
    write_site(tmp_path, SITE, NOW)
    warnings: list[str] = []
    today = END - datetime.timedelta(days=32)

    async def sleep(seconds: float) -> None:
        nonlocal today
        today += datetime.timedelta(seconds=seconds)
        if today > END + datetime.timedelta(days=1):
            raise asyncio.CancelledError

    with pytest.raises(asyncio.CancelledError):
        await warn_of_expiry(configuration_path(tmp_path, "alice"), warnings.append, lambda: today, sleep)
    assert len(warnings) == 31
    assert "ends in 29 days" in warnings[0]
    assert "has ended" in warnings[-1]


def test_the_check_and_the_doctor_say_what_ends_soon(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mcserver.security.proof.CONNECT_MS", 200)
    made = datetime.datetime.now(datetime.UTC) - datetime.timedelta(days=IDENTITY_DAYS - 5)
    write_site(tmp_path, SITE, made)
    assert run_command_line(["security", "check", str(tmp_path)]) == 5
    assert capsys.readouterr().err.count("warning[MC563]") == 3
    run_command_line(["doctor", "--zenoh-config", str(configuration_path(tmp_path, "alice")), "--json"])
    findings = json.loads(capsys.readouterr().out)["findings"]
    (found,) = [each for each in findings if each["title"] == "certificates"]
    assert found["state"] == "advice"
    assert "ends in" in found["found"]
