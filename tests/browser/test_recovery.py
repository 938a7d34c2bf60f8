"""Going on from the page: a server killed in mid-run, what is certain, the way, and the program's end."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from tests.browser.conftest import PageProcess, expect, opened, page_of, playwright
from tests.e2e.broken_off import killed_in_line_6, mill, stands_at_the_end
from tests.e2e.servers import ServerProcess


@pytest.fixture(scope="module")
def own_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    folder = tmp_path_factory.mktemp("mill")
    made = ServerProcess(folder, mill(folder), "mill")
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
    killed_in_line_6(own_server)
    opened(page, own_site, "mill")
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
    expect(dialog).to_contain_text("G01 X160 F600")
    dialog.get_by_role("button", name="Go on at line 6").click()
    expect(page.get_by_text(re.compile("^part.nc is finished after"))).to_be_visible()
    expect(card).to_be_hidden()
    stands_at_the_end(own_server)
