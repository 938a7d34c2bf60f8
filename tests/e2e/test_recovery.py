"""The server killed in mid-run of a program with G1010 first: one call goes on, by SDK and ``mcctl``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.e2e.broken_off import killed_in_line_6, mill, stands_at_the_end
from tests.e2e.conftest import Mcctl
from tests.e2e.servers import ServerProcess


@pytest.fixture
def server(tmp_path: Path) -> Iterator[ServerProcess]:
    made = ServerProcess(tmp_path, mill(tmp_path), "mill")
    made.start()
    yield made
    made.close()


def test_mcctl_shows_the_way_and_goes_on(server: ServerProcess, mcctl: Mcctl) -> None:
    name = killed_in_line_6(server)
    target = ("--machine", "mill", "--connect", server.endpoint)
    shown = mcctl("continue", "--show", "--json", *target)
    assert shown.returncode == 0, shown.stderr
    answer = json.loads(shown.stdout)
    assert (answer["program"], answer["line"], answer["done"], answer["needs"]) == (name, 6, 5, [])
    assert answer["way"][0] == "lift: Z to 40.000 mm, slowly"
    done = mcctl("continue", *target)
    assert (done.returncode, done.stdout) == (0, "mill: finished, lines through 8 are done\n"), done.stderr
    assert ">     6 | G01 X160 F600" in done.stderr
    stands_at_the_end(server)
    again = mcctl("continue", *target)
    assert again.returncode != 0
    assert "no program was broken off" in again.stderr
