"""Going on from the page: a server killed in mid-run, what is certain, the way, and the program's end."""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcclient import sync

from tests.browser.conftest import LIMIT_S, PageProcess, opened, page_of, playwright
from tests.e2e.servers import ServerProcess

RECOVERY = "[recovery]\nsafe_axis = 2\nsafe_position = 40.0\napproach_velocity = 100.0\n"
PART = [
    "G1010",
    "G94 F6000",
    "G00 Z10",
    "G00 X100 Y40",
    "G01 Z-5",
    "G01 X300 F600",
    "G01 X320 F6000",
    "G00 Z10",
]


def machine_file(folder: Path) -> Path:
    axes = "".join(
        f'[[axis]]\nindex = {index}\ntype = "linear"\nmax_velocity = 200.0\nmax_acceleration = 2000.0\n'
        "min_position = -200.0\nmax_position = 500.0\n"
        for index in range(3)
    )
    path = folder / "mill.toml"
    path.write_text(f'[machine]\nname = "mill"\ncycle_hz = 250\n{axes}{RECOVERY}', "utf-8")
    return path


@pytest.fixture(scope="module")
def own_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    folder = tmp_path_factory.mktemp("mill")
    made = ServerProcess(folder, str(machine_file(folder)), "mill")
    made.start()
    yield made
    made.close()


@pytest.fixture(scope="module")
def own_site(own_server: ServerProcess, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageProcess]:
    with page_of(own_server.endpoint, tmp_path_factory.mktemp("programs")) as made:
        yield made


def test_a_program_goes_on_by_the_page_after_the_server_was_killed(
    page: playwright.Page, own_server: ServerProcess, own_site: PageProcess
) -> None:
    with sync.Machine.connect("mill", own_server.endpoint) as machine:
        program = machine.program("part.nc")
        program.send_lines(PART)
        program.close()
        deadline = time.monotonic() + LIMIT_S
        while program.done_through < 5 or machine.status().axes.setpoint[0] < 105.0:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        own_server.end(signal.SIGKILL)
        own_server.start()
    opened(page, own_site, "mill")
    expect = playwright.expect
    card = page.get_by_role("region", name="Broken off")
    expect(card).to_contain_text("part.nc was interrupted at line 6")
    card.get_by_role("button", name="Continue at line 6…").click()
    dialog = page.get_by_role("dialog", name="Go on with part.nc at line 6?")
    expect(dialog.get_by_role("row", name=re.compile(r"X\s+0\.000\s+100\.000\s+elsewhere"))).to_be_visible()
    expect(dialog.get_by_role("listitem")).to_have_text(
        [
            "energize X, Y, Z",
            "lift: Z to 40.000 mm, slowly",
            "over: X to 100.000 mm, Y to 40.000 mm",
            "down: Z to -5.000 mm, slowly",
        ]
    )
    expect(dialog).to_contain_text("G01 X300 F600")
    dialog.get_by_role("button", name="Go on at line 6").click()
    expect(page.get_by_text(re.compile("^part.nc is finished after"))).to_be_visible()
    expect(card).to_be_hidden()
    with sync.Machine.connect("mill", own_server.endpoint) as machine:
        assert machine.status().axes.setpoint[:3] == pytest.approx((320.0, 40.0, 10.0), abs=0.05)
