"""`mcserver certify` writes a signed approval that a server of the site takes."""

from __future__ import annotations

import datetime
import json
from pathlib import Path

import pytest

from mcserver.cli.app import run_command_line
from mcserver.errors import Refused
from mcserver.security.expiry import authority_of
from mcserver.service.arming import hash_of
from mcserver.service.run_certificate import verified

Capture = pytest.CaptureFixture[str]
TEXT = "G1010\nG94 F6000\nG01 X30 Y40\nM30\n"


@pytest.fixture
def site(tmp_path: Path, capfd: Capture) -> Path:
    options = ["--router", "127.0.0.1", "--machine", "cartesian", "--user", "alice:operator"]
    assert run_command_line(["security", "init", str(tmp_path / "site"), *options]) == 0
    capfd.readouterr()
    (tmp_path / "part.gcode").write_text(TEXT)
    return tmp_path / "site"


def certify(site: Path, *options: str) -> int:
    program = str(site.parent / "part.gcode")
    words = ["certify", program, "--site", str(site), "--by", "alice", "-o", str(site.parent / "part.cert")]
    return run_command_line([*words, *options])


def test_a_certificate_is_of_the_run_and_signed_by_the_site(site: Path, capfd: Capture) -> None:
    assert certify(site, "--hours", "2", "--override", "80", "--json") == 0
    answer = json.loads(capfd.readouterr().out)
    now = datetime.datetime.now(datetime.UTC)
    authority = authority_of(site / "machine.cartesian.json5")
    found = verified((site.parent / "part.cert").read_text(), authority, now)
    assert (found.signer, found.approval.sha256, found.approval.override) == ("alice", hash_of(TEXT), 0.8)
    assert [(each.axis, each.high) for each in found.approval.extents] == [(0, 30.0), (1, 40.0)]
    assert answer["approval"]["setpoints"] == found.approval.setpoints
    assert 7190 < found.approval.until - now.timestamp() < 7200
    with pytest.raises(Refused, match="MC578"):
        verified((site.parent / "part.cert").read_text(), authority, now + datetime.timedelta(hours=3))


def test_the_same_run_has_the_same_setpoints_and_another_one_others(site: Path, capfd: Capture) -> None:
    found = []
    for text in (TEXT, "(the same)\n" + TEXT, TEXT.replace("X30", "X30.001")):
        (site.parent / "part.gcode").write_text(text)
        assert certify(site, "--json") == 0
        found.append(json.loads(capfd.readouterr().out)["approval"]["setpoints"])
    assert found[0] == found[1] != found[2]


def test_people_read_what_was_signed(site: Path, capfd: Capture) -> None:
    assert certify(site) == 0
    shown = capfd.readouterr().out
    assert "axis 1: 0.000 … 40.000 mm, 80.0 mm/s" in shown
    assert "signed by alice" in shown


def test_what_cannot_be_certified_is_refused(site: Path, capfd: Capture) -> None:
    assert certify(site, "--connect", "tcp/127.0.0.1:1") == 5
    (site.parent / "part.gcode").write_text("G01 X1O\n")
    assert certify(site) == 4
    assert "MC101" in capfd.readouterr().err
    (site / "authority.key").unlink()
    (site / "signer.alice.key").unlink(missing_ok=True)
    assert certify(site) == 3
    assert "MC560" in capfd.readouterr().err
