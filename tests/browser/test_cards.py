"""What a machine's page has for a robot that homes, has inputs and work offsets; dry runs and recordings."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcclient import sync

from tests.browser.conftest import (
    WIDE,
    Page,
    PageProcess,
    expect,
    expect_no_overflow,
    opened,
    page_of,
    serving,
)
from tests.browser.test_machine_page import upload, wait_for
from tests.e2e.servers import ServerProcess

URDF = """<robot name="crane">
<link name="base"><visual><geometry><box size="0.2 0.2 0.1"/></geometry></visual></link>
<link name="arm"><visual><geometry><cylinder radius="0.02" length="1.0"/></geometry></visual></link>
<link name="tip"/>
<joint name="lift" type="prismatic"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="end" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="0.5 0 0"/></joint>
</robot>"""
CRANE = """
[machine]
name = "crane"
[dialect]
profile = "cnc"
[[axis]]
index = 0
type = "linear"
max_velocity = 200.0
max_acceleration = 2000.0
min_position = -500.0
max_position = 500.0
units_per_motor_rev = 5.0
[axis.homing]
method = "switch"
direction = "negative"
velocity = 100.0
latch_velocity = 20.0
back_off = 3.0
position = 0.0
required = true
[axis.drive]
kind = "simulated"
home_switch = [-1000.0, -35.0]
[kinematics]
urdf = "crane.urdf"
[[tool]]
number = 1
frame = "tip"
axes = [0]
[[input]]
name = "door"
number = 0
"""
# the picture's own component, as NiceGUI hands it out
SPACE = "getElement(Number(document.querySelector('{}').id.slice(1)))"


@pytest.fixture(scope="module")
def crane(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    folder = tmp_path_factory.mktemp("crane")
    (folder / "crane.urdf").write_text(URDF)
    (folder / "crane.toml").write_text(CRANE)
    with serving(folder, str(folder / "crane.toml"), "crane") as made:
        yield made


@pytest.fixture(scope="module")
def crane_site(crane: ServerProcess, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageProcess]:
    with page_of(crane.endpoint, tmp_path_factory.mktemp("programs")) as made:
        yield made


def test_a_robot_homes_is_seen_and_set_to_zero(
    page: Page, crane: ServerProcess, crane_site: PageProcess
) -> None:
    opened(page, crane_site, "crane")
    expect(page.get_by_text("by a switch: not homed")).to_be_visible()
    page.wait_for_function(f"{SPACE.format('.mc-space')}.axisParts.size === 1")
    page.get_by_role("button", name="Energize").click()
    # until then the axis is taken
    expect(page.get_by_text("energize · finished")).to_be_visible()
    page.get_by_role("button", name="home axis X").click()
    expect(page.get_by_text("by a switch: homed")).to_be_visible()
    with sync.Machine.connect("crane", crane.endpoint) as machine:
        at = wait_for(
            machine, page, lambda status: all(program.ended_at for program in status.programs)
        ).axes.position[0]
        # the arm is drawn where the encoder is
        height = f"{SPACE.format('.mc-space')}.axisParts.get(0)[0].group.position.z"
        page.wait_for_function(f"Math.abs({height} - {at}) < 0.1")
        zero = page.get_by_role("button", name="Zero X")
        with machine.program("by another"):
            expect(
                page.get_by_text(re.compile(r"^by another of .* is .*: zero is set .* \[MC512\]"))
            ).to_be_visible()
            expect(zero).to_be_disabled()
        zero.click()
        expect(page.get_by_text("X reads 0 here now")).to_be_visible()
        expect(page.get_by_text("reads zero at X")).to_be_visible()
        page.get_by_label("G-code line").fill("G90 G0 X10")
        page.get_by_label("G-code line").press("Enter")
        wait_for(machine, page, lambda status: abs(status.axes.position[0] - at - 10.0) < 0.05)
    page.get_by_role("button", name="switch door").click()
    expect(
        page.locator(".mc-card", has_text="Inputs and outputs").get_by_text("on", exact=True)
    ).to_be_visible()
    page.get_by_text("Drives", exact=True).click()
    expect(page.get_by_role("region", name="Drives").get_by_text("simulated")).to_be_visible()
    expect(page.get_by_text("(this page)")).to_be_visible()


def test_a_dry_run_shows_path_duration_and_extents_before_anything_moves_and_then_runs(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    upload(page, "dry.gcode", "G1010\nG01 X40 F6000\nG01 Y30\n")
    before = machine.status().axes.position
    page.get_by_role("button", name="Dry run").click()
    dialog = page.locator(".mc-dry-run")
    expect(dialog.get_by_text("0:0")).to_be_visible()
    expect(dialog.get_by_role("cell", name="30.000", exact=True)).to_be_visible()
    page.wait_for_function(f"{SPACE.format('.mc-dry-run .mc-space')}.planned[0]?.points.length > 20")
    assert machine.status().axes.position == before
    dialog.get_by_role("button", name="Run it").click()
    wait_for(machine, page, lambda status: abs(status.axes.position[1] - 30.0) < 0.05)
    # all of the path is done in the end
    planned = f"{SPACE.format('.mc-trail')}.planned[0]"
    page.wait_for_function(f"{planned}?.at > 0.9 * {planned}?.points.length")


def test_a_recording_is_started_stopped_played_and_downloaded(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    page.get_by_label("Name", exact=True).fill("one")
    page.get_by_role("button", name="Record", exact=True).click()
    stop = page.get_by_role("button", name="stop recording one")
    expect(stop).to_be_visible()
    machine.jog(0, 5.0)
    stop.click()
    with page.expect_download() as download:
        page.get_by_role("link", name="download one").click()
    assert Path(download.value.path()).read_bytes().startswith(b"\x89MCAP0\r\n")
    page.get_by_role("button", name="play one").click()
    expect(page.get_by_text(re.compile(r"^0\.000 s"))).to_be_visible()
    page.get_by_role("dialog").get_by_role("button", name="Close").click()
    plot = page.get_by_role("link", name="plot one")
    expect(plot).to_have_attribute("href", "/machine/bench/recordings/one/plot")
    refused = page.request.get(f"{site.url}machine/bench/recordings/none/plot")
    assert (refused.status, "MC585" in refused.text()) == (503, True)


def test_an_emergency_stop_leads_to_its_black_box(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    upload(page, "stopped.gcode", "G1010\nG01 X40 F6000\n")
    page.get_by_role("button", name="Dry run").click()
    expect(page.get_by_role("button", name="Run it")).to_be_visible()
    # over a dialog too
    page.locator("[data-estop]").click()
    expect(page.locator(".mc-state")).to_have_text("EMERGENCY STOP")
    page.get_by_role("dialog").get_by_role("button", name="Close").click()
    expect(page.get_by_role("link", name="plot of the black box")).to_be_visible()
    assert machine.status().state == "estop"


def test_the_machine_file_is_checked_shown_as_a_difference_and_written_at_rest(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    page.get_by_role("button", name="Look at the machine file").click()
    text = page.get_by_role("textbox", name="Machine file")
    before = text.input_value()
    write, check = (page.get_by_role("button", name=name, exact=True) for name in ("Write", "Check"))
    expect(write).to_be_disabled()
    text.fill(before.replace("max_velocity", "max_velosity", 1))
    check.click()
    expect(page.get_by_text("did you mean 'max_velocity'?")).to_be_visible()
    expect(write).to_be_disabled()
    for changed, shown in ((before + "# by ada\n", "+# by ada"), (before, "-# by ada")):
        text.fill(changed)
        expect(write).to_be_disabled()
        check.click()
        expect(page.get_by_text(shown, exact=True)).to_be_visible()
        for width in (360, 768, WIDE["width"]):
            page.set_viewport_size({**WIDE, "width": width})
            expect_no_overflow(page, width)
        write.click()
        expect(write).to_be_disabled()
        expect(page.get_by_text("Written; the one before is cartesian.toml.before")).to_be_visible()
        assert machine.machine_file().text == changed
