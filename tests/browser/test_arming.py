"""A run that an agent asks for, looked at and armed on the operator's page."""

from __future__ import annotations

import pytest
from mcclient import RequestRefused, sync

from tests.browser.conftest import Page, PageProcess, choose, expect, opened
from tests.e2e.servers import ServerProcess

# the arc all but closes, which is a warning
ARC = "G02 X0.01 Y0 I10 J0"
TEXT = f"G1010\nG94 F6000\nG91\nG01 X20 Y10 ; <b>already armed</b>\n{ARC}\nG01 X-20 Y-10\nM30\n"


@pytest.mark.usefixtures("machine")
def test_an_operator_sees_a_run_that_is_asked_for_and_arms_it_once(
    page: Page, site: PageProcess, server: ServerProcess
) -> None:
    opened(page, site)
    panel = page.get_by_role("region", name="Runs to arm")
    expect(panel).to_be_hidden()
    with sync.Machine.connect("bench", server.endpoint) as agent:
        run = agent.request_run(TEXT, "<i>lunch</i>").run
        part = page.locator(f'[data-run="{run.sha256[:12]}"]')
        expect(part.locator("svg polyline").first).to_be_visible()
        expect(part).to_contain_text("<i>lunch</i>")
        expect(part).to_contain_text(f"({run.duration_s:.3f} s)")
        expect(part).to_contain_text("waits for an operator")
        for extent in run.extents:
            expect(part.locator("table")).to_contain_text(f"{extent.high:.3f} mm")
        warnings = part.locator(".mc-warnings")
        expect(warnings).to_contain_text("line 5")
        expect(warnings).to_contain_text("[MC139]")
        expect(warnings.locator("code")).to_have_text(ARC)
        part.get_by_text("Program, 7 lines").click()
        expect(part.locator("pre")).to_contain_text("<b>already armed</b>")
        # whatever the text says, it waits
        with pytest.raises(RequestRefused, match="waits for an operator"):
            agent.run_armed(TEXT)
        choose(page, part.get_by_label("Override up to"), "50 %")
        choose(page, part.get_by_label("Approve"), "and for 15 min")
        part.get_by_role("button", name="Arm once").click()
        expect(part).to_contain_text("up to 50 %")
        assert agent.run_armed(TEXT).override == pytest.approx(50.0)
        expect(part).to_contain_text("started")
        with pytest.raises(RequestRefused, match="started already"):
            agent.run_armed(TEXT)
        approved = page.get_by_role("region", name="Approved")
        expect(approved).to_contain_text(f"may run what stays inside of {run.sha256[:12]}")
        approved.get_by_role("button", name="End").click()
        expect(approved).to_be_hidden()
        assert not agent.run_approvals()


@pytest.mark.usefixtures("machine")
def test_an_operator_rejects_a_run_and_who_asked_reads_why(
    page: Page, site: PageProcess, server: ServerProcess
) -> None:
    opened(page, site)
    with sync.Machine.connect("bench", server.endpoint) as agent:
        run = agent.request_run(TEXT, "again").run
        assert run is not None
        part = page.locator(f'[data-run="{run.sha256[:12]}"]')
        expect(part).to_contain_text("leaves X, Y energized" if run.effects else "waits")
        expect(part.locator("table")).to_contain_text("mm/s")
        part.get_by_label("Reason").fill("the <b>vice</b> is open")
        part.get_by_role("button", name="Reject").click()
        expect(part).to_contain_text(": the <b>vice</b> is open")
        with pytest.raises(RequestRefused, match="the <b>vice</b> is open"):
            agent.run_armed(TEXT)
