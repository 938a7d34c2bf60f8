"""What people set up at a mill: work offsets, tools, and buttons of its own."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from mcclient import sync
from mcclient.types import WorkOffset

from tests.browser.conftest import (
    WIDE,
    Page,
    PageProcess,
    choose,
    expect,
    expect_no_overflow,
    opened,
    page_of,
    press,
    serving,
)
from tests.browser.test_cuts import DUMB, cut
from tests.browser.test_machine_page import wait_for
from tests.e2e.servers import ServerProcess
from tests.machine_text import axes_text

MILL = (
    '[machine]\nname = "mill"\ncycle_hz = 250\n[dialect]\nprofile = "cnc"\n'
    + axes_text(range(3), keys="min_position = -500.0\nmax_position = 500.0")
    + "[probe]\nsimulated_at = { Z = -5.0 }\n[[cutter]]\nnumber = 3\nlength_mm = 40.0\ndiameter_mm = 6.0\n"
    + """[[button]]
name = "park"
text = '''
G53 G0 Z{height}
G53 G0 X0 Y0
'''
confirm = "the vise is empty"
[[button.argument]]
name = "height"
low = 0
high = 100
default = 80
unit = "mm"
"""
)


@pytest.fixture(scope="module")
def mill(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    folder = tmp_path_factory.mktemp("mill")
    (folder / "mill.toml").write_text(MILL)
    with serving(folder, str(folder / "mill.toml"), "mill") as made:
        yield made


@pytest.fixture(scope="module")
def mill_site(mill: ServerProcess, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageProcess]:
    with page_of(mill.endpoint, tmp_path_factory.mktemp("programs")) as made:
        yield made


@pytest.mark.parametrize(("width", "number"), [(360, 2), (WIDE["width"], 4)])
def test_an_offset_is_set_named_and_taken_back_at_every_width(
    page: Page, mill: ServerProcess, mill_site: PageProcess, width: int, number: int
) -> None:
    system = f"G{53 + number}"
    page.set_viewport_size({"width": width, "height": 800})
    opened(page, mill_site, "mill")
    rows = page.get_by_role("region", name="Offsets and tools")
    # one dialog, also for who clicks twice
    page.get_by_role("button", name="Change an offset …").dblclick()
    dialog = page.get_by_role("dialog", name="Change a work offset")
    choose(page, dialog.get_by_label("System"), system)
    dialog.get_by_label("X [mm]").fill(f"{width}")
    dialog.get_by_label("Name").fill("vise")
    expect(dialog.get_by_label("line to be sent")).to_have_text(f"G21 G90 G10 L2 P{number} X{width}")
    expect_no_overflow(page, width)
    dialog.get_by_role("button", name="Set", exact=True).click()
    expect(rows.get_by_role("row", name=f"{system} {width}.000 0.000 0.000 vise")).to_be_visible()
    expect(rows.get_by_text(f"{system}: X – → {width}")).to_be_visible()
    with sync.Machine.connect("mill", mill.endpoint) as machine:
        (last, *_) = machine.tables().changes
        assert (last.row, last.after, last.name) == (system, {"0": width}, "work offset by local")
        page.get_by_role("button", name="Undo …").click()
        page.get_by_role("dialog").get_by_role("button", name="Undo", exact=True).click()
        wait_for(machine, page, lambda status: not zero_of(status.work_offsets, system))
    # the page knows it, too: the next change is made from there
    expect(rows.get_by_text(f"{system}: X {width} → 0")).to_be_visible()


def test_an_offset_is_shifted_from_where_it_is(
    page: Page, mill: ServerProcess, mill_site: PageProcess
) -> None:
    opened(page, mill_site, "mill")
    with sync.Machine.connect("mill", mill.endpoint) as machine:
        rows = page.get_by_role("region", name="Offsets and tools")
        page.get_by_role("button", name="Change an offset …").click()
        dialog = page.get_by_role("dialog", name="Change a work offset")
        dialog.get_by_label("X [mm]").fill("2.5")
        with machine.program("offset") as program:
            program.send("G10 L2 P6 X10")
            program.send("G10 L2 P1 Y7")
        # what it was made from is not so any more
        dialog.get_by_role("button", name="Set", exact=True).click()
        expect(page.get_by_text("The tables have been changed meanwhile")).to_be_visible()
        assert all(each.origin.get("0") != 2.5 for each in machine.status().work_offsets)
        # what was typed is still there, and what was not shows what another one has set
        expect(dialog.get_by_label("X [mm]")).to_have_value("2.5000")
        expect(dialog.get_by_label("Y [mm]")).to_have_value("7.0000")
        expect(dialog.get_by_label("line to be sent")).to_have_text("G21 G90 G10 L2 P1 X2.5")
        dialog.get_by_role("button", name="Set", exact=True).click()
        expect(dialog).to_have_count(0)
        expect(rows.get_by_role("row", name="G54 2.500 7.000 0.000")).to_be_visible()
        expect(rows.get_by_role("row", name="G59 10.000 0.000 0.000")).to_be_visible()
        page.get_by_role("button", name="Change an offset …").click()
        choose(page, dialog.get_by_label("System"), "G59")
        choose(page, dialog.get_by_label("How"), "shift by")
        # the fields are filled anew for what was chosen
        expect(dialog.get_by_label("X [mm]")).to_have_value("0.0000")
        dialog.get_by_label("X [mm]").fill("2.5")
        expect(dialog.get_by_label("line to be sent")).to_have_text("G21 G90 G10 L2 P6 X12.5")
        # more than any machine has
        dialog.get_by_label("Y [mm]").fill("1e300")
        dialog.get_by_label("X [mm]").focus()
        expect(dialog.get_by_label("line to be sent")).to_have_text("G21 G90 G10 L2 P6 X12.5 Y1000000")
        dialog.get_by_label("Y [mm]").fill("0")
        dialog.get_by_role("button", name="Set", exact=True).click()
        expect(rows.get_by_role("row", name="G59 12.500 0.000 0.000")).to_be_visible()


def test_what_was_set_while_the_link_was_dead_is_refused_and_stands_in_its_dialog_to_be_set_again(
    page: Page, mill_site: PageProcess
) -> None:
    opened(page, mill_site, "mill")
    rows = page.get_by_role("region", name="Offsets and tools")
    press(page.get_by_role("button", name="Change an offset …"))
    dialog = page.get_by_role("dialog", name="Change a work offset")
    choose(page, dialog.get_by_label("System"), "G58")
    dialog.get_by_label("X [mm]").fill("58")
    expect(dialog.get_by_label("line to be sent")).to_have_text("G21 G90 G10 L2 P5 X58")
    page.evaluate(DUMB)
    # ten seconds before it comes
    page.evaluate("() => { const t = performance.now(); performance.now = () => t - 10_000; }")
    dialog.get_by_role("button", name="Set", exact=True).click()
    page.evaluate("delete performance.now")
    with cut(page):
        pass
    expect(page.get_by_text("[MC604]")).to_be_visible()
    expect(dialog.get_by_label("X [mm]")).to_have_value("58.0000")
    dialog.get_by_role("button", name="Set", exact=True).click()
    expect(rows.get_by_role("row", name="G58 58.000 0.000 0.000")).to_be_visible()
    expect(dialog).to_have_count(0)


def test_a_tool_is_measured_named_and_used_and_is_asked_for_when_its_life_is_used_up(
    page: Page, mill: ServerProcess, mill_site: PageProcess
) -> None:
    opened(page, mill_site, "mill")
    press(page.get_by_role("button", name="Change a tool …"))
    dialog = page.get_by_role("dialog", name="Change a tool")
    expect(dialog.get_by_label("Length [mm]")).to_have_value("40.0000")
    dialog.get_by_label("Length [mm]").fill("42.5")
    expect(dialog.get_by_label("line to be sent")).to_have_text("G21 G90 G10 L1 P3 Z42.5 R3")
    dialog.get_by_label("Name").fill("end mill")
    dialog.get_by_label("Life [min]").fill("60")
    dialog.get_by_label("Has cut [min]").fill("59")
    press(dialog.get_by_role("button", name="Set", exact=True))
    rows = page.get_by_role("region", name="Offsets and tools")
    expect(rows.get_by_role("row", name="T3 42.500 6.000 end mill 59.0 of 60")).to_be_visible()
    with sync.Machine.connect("mill", mill.endpoint) as machine:
        machine.set_table_row("T3", used_min=59.99)
        with machine.program() as program:
            program.send_lines(["T3 M6", "G43 H3 G0 Z10", "M3 S1000", "G91 G1 X10 F600", "X-10"])
        assert machine.status().axes.setpoint[2] == pytest.approx(52.5)
        expect(rows.get_by_role("row", name="T3 42.500 6.000 end mill 60.0 of 60 · used up")).to_be_visible()
        with machine.program("next.nc") as program:
            program.send("T3 M6")
            expect(page.get_by_text("next.nc waits at line", exact=False)).to_contain_text(
                "fit tool 3, then resume · tool 3 has cut"
            )
            page.get_by_role("button", name="Resume").first.click()
            expect(page.get_by_text("tool 3 has cut", exact=False).last).to_contain_text("[MC602]")
            press(page.get_by_role("button", name="Change a tool …"))
            press(dialog.get_by_role("button", name="A new one is fitted"))
            expect(dialog.get_by_label("Has cut [min]")).to_have_value("0")
            press(dialog.get_by_role("button", name="Set", exact=True))
            expect(rows.get_by_text("T3: used 60", exact=False).first).to_be_visible()
            page.get_by_role("button", name="Resume").first.click()
        assert machine.programs(limit=1)[0].state == "finished"


def test_nobody_changes_a_table_while_a_program_is_open(
    page: Page, mill: ServerProcess, mill_site: PageProcess
) -> None:
    opened(page, mill_site, "mill")
    with sync.Machine.connect("mill", mill.endpoint) as machine, machine.program("by another"):
        expect(page.get_by_text("tables are changed at rest [MC512]")).to_be_visible()
        expect(page.get_by_role("button", name="Change an offset …")).to_be_disabled()


def test_a_new_tool_is_touched_off_at_the_pause_of_the_program_that_asks_for_it(
    page: Page, mill: ServerProcess, mill_site: PageProcess
) -> None:
    page.set_viewport_size(WIDE)
    opened(page, mill_site, "mill")
    with sync.Machine.connect("mill", mill.endpoint) as machine:
        with machine.program("part.nc") as program:
            program.send_lines(["G53 G0 X0 Y0 Z60", "T0 M6", "T3 M6", "G0 Z5"])
            expect(page.get_by_text("part.nc waits at line", exact=False)).to_contain_text("fit tool 3")
            page.get_by_label("G-code line").fill("G91 G0 Z-20")
            page.get_by_label("G-code line").press("Enter")
            wait_for(machine, page, lambda status: abs(status.axes.position[2] - 40.0) < 0.05)
            page.get_by_role("button", name="Zero Z").click()
            expect(page.get_by_text("Z reads 0 here now")).to_be_visible()
            page.get_by_role("button", name="Resume").first.click()
        assert machine.status().axes.setpoint[2] == pytest.approx(45.0)


@pytest.mark.parametrize("width", [360, WIDE["width"]])
def test_a_button_shows_its_program_and_runs_it_within_its_limits(
    page: Page, mill: ServerProcess, mill_site: PageProcess, width: int
) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    opened(page, mill_site, "mill")
    press(page.get_by_role("button", name="park …"))
    dialog = page.get_by_role("dialog", name="Run park")
    run = dialog.get_by_role("button", name="Run", exact=True)
    expect(dialog.get_by_label("Program text")).to_have_text("G53 G0 Z80\nG53 G0 X0 Y0")
    expect(run).to_be_disabled()
    # the server answers a click before the box shows it
    agreed = dialog.get_by_role("checkbox", name="the vise is empty")
    agreed.click()
    expect(agreed).to_be_checked()
    height = dialog.get_by_label("height [mm]")
    height.fill("101")
    expect(dialog.get_by_text("height: give a number from 0 to 100 mm")).to_be_visible()
    expect(run).to_be_disabled()
    height.fill("12.5")
    expect_no_overflow(page, width)
    run.click()
    with sync.Machine.connect("mill", mill.endpoint) as machine:
        wait_for(machine, page, lambda status: abs(status.axes.position[2] - 12.5) < 0.05)
        wait_for(machine, page, lambda status: all(each.ended_at for each in status.programs))
        with machine.program() as program:
            program.send("G53 G0 Z0")


@pytest.mark.parametrize("width", [360, WIDE["width"]])
def test_the_top_of_the_work_is_probed_by_a_program_that_is_shown_before_it_runs(
    page: Page, mill: ServerProcess, mill_site: PageProcess, width: int
) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    with sync.Machine.connect("mill", mill.endpoint) as machine:
        with machine.program() as program:
            program.send("G53 G0 X0 Y0 Z0")
        opened(page, mill_site, "mill")
        page.get_by_role("heading", name="Probing").scroll_into_view_if_needed()
        press(page.get_by_role("button", name="Top …"))
        dialog = page.get_by_role("dialog", name="Run Top")
        expect(dialog.get_by_label("Program text")).to_contain_text("G38.2 Z-20 F150")
        dialog.get_by_label("travel [mm]").fill("501")
        expect(dialog.get_by_label("Program text")).to_contain_text("travel: give a number from 1 to 500 mm")
        expect(dialog.get_by_role("button", name="Run", exact=True)).to_be_disabled()
        dialog.get_by_label("travel [mm]").fill("9")
        dialog.get_by_label("feed [mm/min]").fill("600")
        dialog.get_by_label("thickness [mm]").fill("2")
        expect_no_overflow(page, width)
        press(dialog.get_by_role("button", name="Run", exact=True))
        wait_for(machine, page, lambda status: has_top(status.work_offsets))
        with machine.program() as program:
            program.send("G10 L2 P1 Z0")


def has_top(offsets: tuple[WorkOffset, ...]) -> bool:
    """Whether G54 has its zero a plate's 2 mm below the contact at -5."""
    return any(each.system == "G54" and abs(each.origin.get("2", 0.0) + 7.0) < 0.01 for each in offsets)


def zero_of(offsets: tuple[WorkOffset, ...], system: str) -> float:
    """Return where a system reads zero on X [mm]; one that was never set: 0."""
    return next((each.origin.get("0", 0.0) for each in offsets if each.system == system), 0.0)
