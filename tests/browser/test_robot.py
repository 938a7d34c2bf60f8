"""A robot by the page: steps of its tool by mouse and keyboard, poses taught, edited, replayed and kept."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from mcclient import sync
from mckinematics.solver import MachineKinematics

from mcserver.machine.machine_file import load_machine
from tests.browser.conftest import Page, PageProcess, choose, expect, expect_no_overflow, opened, page_of
from tests.browser.test_machine_page import at_rest, held_until, wait_for
from tests.e2e.servers import ServerProcess


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    made = ServerProcess(tmp_path_factory.mktemp("arm"), "arm6", "arm")
    made.start()
    yield made
    made.close()


@pytest.fixture(scope="module")
def arm_site(arm: ServerProcess, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageProcess]:
    with page_of(arm.endpoint, tmp_path_factory.mktemp("programs")) as made:
        yield made


@pytest.fixture
def robot(arm: ServerProcess) -> Iterator[sync.Machine]:
    with sync.Machine.connect("arm", arm.endpoint) as made:
        yield made
        made.abort()


def pose(machine: sync.Machine) -> list[float]:
    (tool,) = machine.status().tools
    return [*tool.position, *tool.orientation]


def stepped(page: Page, machine: sync.Machine, wanted: list[float]) -> None:
    """Wait until the tool rests at a pose."""

    def there(status: Any) -> bool:
        reached = [*status.tools[0].position, *status.tools[0].orientation]
        return at_rest(status) and reached == pytest.approx(wanted, abs=0.05)

    wait_for(machine, page, there)


def test_the_tool_is_stepped_and_held_in_the_frames_of_base_and_tool_and_steps_queue(
    page: Page, arm_site: PageProcess, robot: sync.Machine
) -> None:
    opened(page, arm_site, "arm")
    positions = page.get_by_role("region", name="Positions")
    expect(positions).to_contain_text("T1")
    for width in (360, 768, 1920):
        page.set_viewport_size({"width": width, "height": 900})
        expect_no_overflow(page, width)
        assert positions.evaluate("region => region.scrollWidth <= region.clientWidth")
    names = robot.model().joints
    expect(positions).to_contain_text(f"X {names['0']}")
    expect(page.locator(".mc-jog-axis").first).to_contain_text(names["0"])
    x, y, z, a, b, c = pose(robot)
    choose(page, page.get_by_label("Along axes of"), "base")
    choose(page, page.get_by_label("Step", exact=True), "5 mm, deg")
    for _ in range(2):
        page.get_by_role("button", name="jog tool Z minus").click()
    stepped(page, robot, [x, y, z - 10.0, a, b, c])
    page.get_by_role("button", name="jog tool B plus").press("Enter")
    stepped(page, robot, [x, y, z - 10.0, a, b + 5.0, c])
    choose(page, page.get_by_label("Along axes of"), "tool")
    page.get_by_role("button", name="jog tool B minus").press(" ")
    stepped(page, robot, [x, y, z - 10.0, a, b, c])
    # held, it goes on until the finger leaves, and says which joint would end its way
    choose(page, page.get_by_label("Along axes of"), "base")
    choose(page, page.get_by_label("Step", exact=True), "while held")
    page.get_by_role("button", name="jog tool Z plus").hover()
    held_until(robot, page, lambda status: status.tools[0].position[2] > z - 9.0)
    expect(page.get_by_text(re.compile(r"^Z\+ ends where .*axis \d \(joint '"))).to_be_visible()
    page.mouse.up()
    wait_for(robot, page, at_rest)
    assert pose(robot)[2] < z + 200.0


PLACES = """() => {
    const space = document.querySelector(".mc-space").closest("[id^=c]").id.slice(1);
    const { reached, links, world } = getElement(Number(space));
    world.updateMatrixWorld(true);
    const tip = world.worldToLocal(links.get("tip").getWorldPosition(world.position.clone()));
    const places = reached.map((cloud) => [...cloud.geometry.getAttribute("position").array]);
    return { places, tip: tip.toArray() };
}"""


def test_the_picture_marks_where_the_tool_can_be_and_the_robot_stays_where_it_is(
    page: Page, arm_site: PageProcess, robot: sync.Machine
) -> None:
    opened(page, arm_site, "arm")
    page.get_by_role("checkbox", name="Reach").click()
    page.wait_for_function(f"() => ({PLACES})().places.length === 1")
    shown = page.evaluate(PLACES)
    places = np.array(shown["places"][0]).reshape(-1, 3)
    chain = MachineKinematics(load_machine("arm6")).tool(1).chain
    reach = 1e3 * chain.reach
    assert np.linalg.norm(places, axis=1).max() <= reach + 1e3 * float(np.abs(chain.points).max())
    # on all sides
    assert (places.max(axis=0) > 0.6 * reach).all()
    assert (places[:, :2].min(axis=0) < -0.6 * reach).all()
    tip = pose(robot)[:3]
    page.wait_for_function(
        f"tip => ({PLACES})().tip.every((value, at) => Math.abs(value - tip[at]) < 0.05)", arg=tip
    )
    page.get_by_role("checkbox", name="Reach").click()
    page.wait_for_function(f"() => ({PLACES})().places.length === 0")


def test_poses_are_taught_edited_replayed_and_kept_also_where_the_page_is_loaded_anew(
    page: Page, arm_site: PageProcess, robot: sync.Machine
) -> None:
    opened(page, arm_site, "arm")
    text = page.get_by_label("Taught program")
    x, y, z, a, b, c = pose(robot)
    page.get_by_role("button", name="Take pose").click()
    expect(text).to_have_value(re.compile(r"^G1010 P0\n(.*\n)+G01 X.* T1 F600\n$"))
    choose(page, page.get_by_label("Along axes of"), "base")
    choose(page, page.get_by_label("Step", exact=True), "10 mm, deg")
    page.get_by_role("button", name="jog tool Y plus").click()
    stepped(page, robot, [x, y + 10.0, z, a, b, c])
    page.get_by_role("button", name="Take pose").click()
    expect(text).to_have_value(re.compile(r"(G01 X.* T1 F600\n){2}$"))
    # the last line leads back to the first pose, quickly
    first = next(line for line in text.input_value().splitlines() if line.startswith("G01"))
    taught = text.input_value() + first.replace("F600", "F6000") + "\n"
    text.fill(taught)
    # as a restart of the process that serves it does
    page.reload()
    expect(text).to_have_value(taught)
    page.get_by_role("button", name="Replay").click()
    expect(page.get_by_text(re.compile("^taught.gcode is finished after"))).to_be_visible()
    stepped(page, robot, [x, y, z, a, b, c])
    page.get_by_role("button", name="Save as program").click()
    expect(page.get_by_text("taught.gcode is kept", exact=True)).to_be_visible()
    page.get_by_role("button", name="Save as program").click()
    dialog = page.get_by_role("dialog", name="taught.gcode is kept already. Replace it?")
    dialog.get_by_role("button", name="Cancel").click()
    expect(dialog).to_have_count(0)


def test_a_step_that_the_arm_cannot_make_names_the_joint_and_moves_nothing(
    page: Page, arm_site: PageProcess, robot: sync.Machine
) -> None:
    opened(page, arm_site, "arm")
    choose(page, page.get_by_label("Along axes of"), "base")
    choose(page, page.get_by_label("Step", exact=True), "50 mm, deg")
    choose(page, page.get_by_label("Speed of the tip"), "250 mm/s, deg/s")
    refused = page.get_by_text(re.compile(r"^step T1 Z \+50 along the base: .*joint.*\[MC3\d\d\]"))
    before = pose(robot)
    for _ in range(20):
        before = pose(robot)
        page.get_by_role("button", name="jog tool Z plus").click()
        page.wait_for_timeout(300)
        wait_for(robot, page, at_rest)
        if refused.count():
            break
    expect(refused.first).to_be_visible()
    assert pose(robot) == pytest.approx(before, abs=0.05)
