"""The commissioning desk in Chromium, with simulated drives on a bus behind a real server."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from mcclient import sync

from mcserver.web.users import Role, add_user
from tests.browser.conftest import (
    LIMIT_MS,
    TRIES,
    WIDE,
    Page,
    PageProcess,
    choose,
    expect,
    expect_no_overflow,
    page_of,
    playwright,
    press,
)
from tests.browser.test_accessibility import nothing_serious_as_worn
from tests.e2e.servers import ROOT
from tests.e2e_can.cell import Cell, running
from tests.e2e_can.machines import Raw, buses, in_mode, slides

SHIPPED_EDS = ROOT / "mcserver" / "drive_sim" / "cia402.eds"
MAKERS = 1800
# a busy computer stops a process for seconds; a browser's tests are not about that
UNHURRIED = {"heartbeat_ms": 10_000, "command_timeout_ms": 60_000, "sdo_timeout_ms": 3000}


def eds_of_a_maker(folder: Path) -> Path:
    """Write an EDS of two thousand objects, with a name that is markup and an entry that is garbage."""
    own = [
        "[2000]\nParameterName=<img src=x onerror=alert(1)>\nDataType=0x0003\nLowLimit=-5\nHighLimit=100\n"
    ]
    own += [
        f"[{0x2001 + at:X}]\nParameterName=Own parameter {at}\nDataType=0x0007\nAccessType=rw\n"
        for at in range(MAKERS)
    ]
    own.append("[2FFF]\nParameterName=Garbage\nDataType=none\n")
    file = folder / "maker.eds"
    file.write_bytes(SHIPPED_EDS.read_bytes() + b"\n" + "".join(own).encode())
    return file


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    folder = tmp_path_factory.mktemp("cell")

    def build(addresses: Sequence[str]) -> Raw:
        raw = slides(addresses, 100.0, 2)
        raw["bus"] = buses(addresses, silence_cycles=1000)
        for axis, eds in zip(raw["axis"], (eds_of_a_maker(folder), SHIPPED_EDS), strict=True):
            axis["drive"] |= {**UNHURRIED, "eds": str(eds)}
        return raw

    with running(folder, build, channels=1, processes=[(1,), (2,)]) as made:
        yield made


@pytest.fixture(scope="module")
def site(cell: Cell, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageProcess]:
    with page_of(cell.server.endpoint, tmp_path_factory.mktemp("programs")) as made:
        yield made


@pytest.fixture
def machine(cell: Cell) -> Iterator[sync.Machine]:
    with sync.Machine.connect("slides", cell.server.endpoint) as made:
        yield made


def desk_of(page: Page, site: PageProcess, axis: str = "X") -> Page:
    """The desk, at an axis's drive."""
    page.goto(f"{site.url}machine/slides/drives")
    drive = page.get_by_label("Drive", exact=True)
    expect(drive).to_have_value("X")
    if axis != "X":
        choose(page, drive, axis)
    expect(page.get_by_text(re.compile(f"^node {1 if axis == 'X' else 2} on bus0"))).to_be_visible()
    return page


def search(page: Page, words: str, first: str) -> None:
    page.get_by_label("Search: words").fill(words)
    expect(page.get_by_role("button", name=first)).to_be_visible()


def refused(page: Page, code: str, *words: str) -> None:
    """Wait for a refusal with a code and all these words."""
    said = page.locator(".q-notification").filter(has_text=code)
    for each in words:
        said = said.filter(has_text=each)
    expect(said.first).to_be_visible()


def written(page: Page, value: str) -> None:
    field = page.get_by_label("Value", exact=True)
    # what is read as a parameter is chosen would come into what is typed
    expect(field).not_to_have_value("")
    field.fill(value)
    press(page.get_by_role("button", name="Write", exact=True))


def test_a_parameter_is_found_by_words_read_written_within_its_limits_and_stored(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    desk_of(page, site, "Y")
    search(page, "ERROR window", "6065h:00 Following error window")
    press(page.get_by_role("button", name="6065h:00 Following error window"))
    value = page.get_by_label("Value", exact=True)
    expect(value).to_have_value(str(machine.sdo_read(0x6065, axis=1).value))
    written(page, "0x1388")
    expect(page.get_by_text("6065h:00 is 5000")).to_be_visible()
    # as it is read back, which would come behind what is typed next
    expect(value).to_have_value("5000")
    assert machine.sdo_read(0x6065, axis=1).value == 5000
    written(page, "-1")
    refused(page, "MC559", "6065h:00", "-1")
    assert machine.sdo_read(0x6065, axis=1).value == 5000
    press(page.get_by_role("button", name="Save in the drive"))
    expect(page.get_by_text("the drive has stored its parameters")).to_be_visible()
    expect_no_overflow(page, WIDE["width"])


def test_two_thousand_objects_are_searched_and_a_name_is_never_markup(page: Page, site: PageProcess) -> None:
    desk_of(page, site)
    expect(page.get_by_text(re.compile(r"40 of 20\d\d parameters are shown"))).to_be_visible()
    expect(page.get_by_text(re.compile("2FFF.*DataType"))).to_be_visible()
    search(page, "2000h img", "2000h:00 <img src=x onerror=alert(1)>")
    assert page.locator("main img, .mc-card img").count() == 0
    press(page.get_by_role("button", name="2000h:00"))
    expect(page.get_by_label("Value", exact=True)).to_have_value("0")
    expect(page.get_by_text("i16, rw, -5 to 100 by the EDS")).to_be_visible()
    written(page, "101")
    refused(page, "MC559", "101 is outside -5 to 100 of the EDS")


def test_a_backup_is_compared_with_the_drive_and_another_one_and_restored(
    page: Page, site: PageProcess, machine: sync.Machine, tmp_path: Path
) -> None:
    desk_of(page, site, "Y")
    machine.sdo_write(0x6072, 900, axis=1)
    with page.expect_download() as download:
        press(page.get_by_role("button", name="Download a backup"))
    file = tmp_path / "y.toml"
    download.value.save_as(file)
    assert 'object = "6072h:00", value = 900' in file.read_text()
    machine.sdo_write(0x6072, 800, axis=1)
    page.locator("input[type=file]").set_input_files(file)
    press(page.get_by_role("button", name="Compare with the file"))
    report = page.get_by_role("region", name="What differs")
    expect(report).to_contain_text(re.compile(r"1 of \d+ parameters differ"))
    expect(report.get_by_role("row", name=re.compile("6072h:00"))).to_have_text(re.compile("800.*900"))
    press(page.get_by_role("button", name="Restore the file"))
    press(page.get_by_role("dialog").get_by_role("button", name="Restore"))
    expect(report).to_contain_text("all verified")
    assert machine.sdo_read(0x6072, axis=1).value == 900
    # this drive does not know the maker's objects, and has another EDS
    press(page.get_by_role("button", name="Compare", exact=True))
    expect(report).to_contain_text("they were taken with different EDS files")


def test_a_file_that_is_none_and_one_of_another_device_are_refused_and_nothing_is_written(
    page: Page, site: PageProcess, machine: sync.Machine, tmp_path: Path
) -> None:
    desk_of(page, site, "Y")
    garbage = tmp_path / "garbage.toml"
    garbage.write_bytes(b"\xff\x00 = [")
    page.locator("input[type=file]").set_input_files(garbage)
    refused(page, "MC565")
    expect(page.get_by_role("button", name="Restore the file")).to_be_disabled()
    other = tmp_path / "other.toml"
    other.write_text(
        'parameters = [{ object = "6072h:00", value = 5, type = "u16", name = "Max torque" }]\n'
        "[drive]\nvendor_id = 1\nproduct_code = 2\n"
    )
    before = machine.sdo_read(0x6072, axis=1).value
    page.locator("input[type=file]").set_input_files(other)
    press(page.get_by_role("button", name="Restore the file"))
    expect(page.get_by_role("dialog")).to_contain_text("they are of different devices")
    press(page.get_by_role("dialog").get_by_role("button", name="Restore"))
    refused(page, "MC566")
    assert machine.sdo_read(0x6072, axis=1).value == before


def test_the_scale_is_read_and_proved_by_a_small_move(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    desk_of(page, site, "Y")
    page.get_by_label("Travel for a turn of the gear's shaft").fill("10")
    press(page.get_by_role("button", name="Read the scale"))
    report = page.get_by_role("region", name="Units")
    expect(report).to_contain_text("units_per_motor_rev = 10")
    press(page.get_by_role("button", name="Begin a move"))
    expect(page.get_by_text("it stands at count")).to_be_visible()
    with machine.program("moves") as program:
        for line in ("G1010 P1", "G91", "G01 Y5 F600", "G90", "G1001 P1"):
            program.send(line)
    for measured, said in (("5", "the machine file fits"), ("10", "units_per_motor_rev"), ("-5", "invert")):
        page.get_by_label("How far it went, measured").fill(measured)
        press(page.get_by_role("button", name="Compare the move"))
        expect(report).to_contain_text(said)


def test_the_buses_are_listened_to(page: Page, site: PageProcess) -> None:
    desk_of(page, site)
    report = page.get_by_role("region", name="Health of the buses")
    press(page.get_by_role("button", name="Listen for 5 s"))
    expect(report).to_contain_text(re.compile(r"bus bus0: \d+ frames in \d+\.\d s, load \d+\.\d%"))
    expect(report.get_by_role("row")).to_have_count(3)


def test_a_move_is_caught_by_a_trigger_drawn_and_kept_as_mcap(
    page: Page, site: PageProcess, machine: sync.Machine, tmp_path: Path
) -> None:
    desk_of(page, site)
    choose(page, page.get_by_label("Trigger", exact=True), "rises above")
    choose(page, page.get_by_label("Of", exact=True), "velocity")
    page.get_by_label("Level", exact=True).fill("5")
    press(page.get_by_role("button", name="Start"))
    said = page.get_by_role("status").filter(has_text="waits for the trigger")
    expect(said).to_be_visible()
    with machine.program("moves") as program:
        for _ in range(TRIES):
            # a busy computer may have shown none of the telemetry of a move
            for line in ("G1010 P0", "G01 X5 F600", "G01 X0"):
                program.send(line)
            try:
                expect(page.get_by_text("200 cycles")).to_be_visible(timeout=LIMIT_MS / TRIES)
            except AssertionError:
                continue
            break
        expect(page.get_by_text("200 cycles")).to_be_visible()
    with page.expect_download() as download:
        press(page.get_by_role("button", name="Download MCAP"))
    file = tmp_path / "scope.mcap"
    download.value.save_as(file)
    from mcap.reader import make_reader

    with file.open("rb") as stream:
        reader = make_reader(stream)
        ((_, channel),) = reader.get_summary().channels.items()
        times = [message.log_time for _, _, message in reader.iter_messages()]
    assert channel.topic == "/scope/axis_0"
    assert channel.metadata["names"].split("\n")[2] == "following error"
    assert len(times) == 200
    with machine.program("ends") as program:
        program.send("G1001 P0")


def test_mapped_objects_are_recorded_and_a_loop_of_the_drive_s_own_is_not_tuned(
    page: Page, site: PageProcess
) -> None:
    desk_of(page, site, "Y")
    page.get_by_label("Trigger by an object").fill("voltage > 1")
    press(page.get_by_role("button", name="Record", exact=True))
    refused(page, "MC568", "voltage")
    page.get_by_label("Trigger by an object").fill("")
    press(page.get_by_role("button", name="Record", exact=True))
    expect(page.get_by_text("200 cycles")).to_be_visible()
    expect(page.get_by_role("button", name="Download the trace")).to_be_enabled()
    press(page.get_by_role("button", name="Measure what moves"))
    refused(page, "MC095", "the drive's own")


def test_an_axis_is_shaken_and_its_gains_are_judged(
    tmp_path: Path, page: Page, request: pytest.FixtureRequest
) -> None:
    def build(addresses: Sequence[str]) -> Raw:
        raw = slides(addresses, 100.0, 1)
        in_mode(raw, 0, "csv")
        raw["bus"] = buses(addresses, silence_cycles=1000)
        raw["axis"][0]["drive"] |= {**UNHURRIED, "eds": str(SHIPPED_EDS)}
        return raw

    with (
        running(tmp_path, build, channels=1, processes=[(1,)]) as made,
        page_of(made.server.endpoint, tmp_path / "programs") as site,
    ):
        request.addfinalizer(lambda: page.goto("about:blank"))
        desk_of(page, site)
        card = page.locator(".mc-card").filter(has=page.get_by_role("heading", name="Tune", exact=True))
        report = card.get_by_role("region", name="Tune")
        choose(page, card.get_by_label("Span"), "10 s")
        # without a length nothing is asked, and nothing moves
        page.get_by_label("Longest move").fill("")
        press(page.get_by_role("button", name="Shake and measure"))
        expect(page.get_by_text("no length was given")).to_be_visible()
        page.get_by_label("Longest move").fill("15")
        press(page.get_by_role("button", name="Shake and measure"))
        dialog = page.get_by_role("dialog")
        expect(dialog).to_contain_text("up to 15 mm towards greater positions, up to 10 Hz")
        press(dialog.get_by_role("button", name="Shake", exact=True))
        expect(page.get_by_text("the motion is measured for 10 s")).to_be_visible()
        # a cycle of 10 ms, readings of which are 2 late: 0.1 / 10 ms, stable up to some 10 times that
        own = report.get_by_role("row", name=re.compile("^by this drive"))
        expect(own).to_contain_text(re.compile(r"by this drive\s*10\s*0\s*(9|1\d)\.\d\s*8\d°"))
        expect(report.get_by_role("row", name=re.compile("^machine file"))).to_be_visible()
        scale = report.get_by_role("row", name=re.compile("^scale")).inner_text().split()[-1]
        assert float(scale) == pytest.approx(1.0, abs=0.05)
        with sync.Machine.connect("slides", made.server.endpoint) as machine:
            # the program is a job of its own, which comes back to where it began
            while machine.programs(ended=False):
                pass
            assert machine.status().axes.position[0] == pytest.approx(0.0, abs=0.5)


def test_a_drive_that_is_gone_is_said_and_the_desk_goes_on(
    page: Page, site: PageProcess, cell: Cell, machine: sync.Machine
) -> None:
    desk_of(page, site, "Y")
    search(page, "max torque", "6072h:00 Max torque")
    cell.kill_drives(2)
    try:
        press(page.get_by_role("button", name="6072h:00 Max torque"))
        refused(page, "MC554", "6072h:00")
        press(page.get_by_role("button", name="Download a backup"))
        refused(page, "MC554", "1018h:01")
    finally:
        cell.start_drives([2])
    for _ in range(TRIES):
        press(page.get_by_role("button", name="Read", exact=True))
        try:
            expect(page.get_by_label("Value", exact=True)).not_to_have_value("", timeout=LIMIT_MS / TRIES)
        except AssertionError:
            continue
        break
    expect(page.get_by_label("Value", exact=True)).not_to_have_value("")
    machine.reset()


def test_two_engineers_do_not_write_at_once(
    page: Page, browser: playwright.Browser, site: PageProcess, machine: sync.Machine
) -> None:
    desk_of(page, site, "Y")
    search(page, "max torque", "6072h:00 Max torque")
    press(page.get_by_role("button", name="6072h:00 Max torque"))
    written(page, "700")
    expect(page.get_by_text("6072h:00 is 700")).to_be_visible()
    second = browser.new_page(viewport=WIDE)
    second.set_default_timeout(LIMIT_MS)
    try:
        desk_of(second, site, "Y")
        search(second, "max torque", "6072h:00 Max torque")
        press(second.get_by_role("button", name="6072h:00 Max torque"))
        # reading is for both
        expect(second.get_by_label("Value", exact=True)).to_have_value("700")
        written(second, "600")
        refused(second, "MC078")
    finally:
        second.close()
    assert machine.sdo_read(0x6072, axis=1).value == 700


def test_the_desk_is_for_engineers_alone(cell: Cell, tmp_path: Path, browser: playwright.Browser) -> None:
    users = tmp_path / "users"
    add_user(users, "otto", Role.OPERATOR, "ottos-password")
    with page_of(cell.server.endpoint, tmp_path / "programs", "--users", str(users)) as site:
        context = browser.new_context(viewport=WIDE)
        context.set_default_timeout(LIMIT_MS)
        try:
            own = context.new_page()
            own.goto(f"{site.url}machine/slides/drives")
            own.get_by_label("Name").fill("otto")
            own.get_by_label("Password").fill("ottos-password")
            own.get_by_role("button", name="Log in").click()
            expect(own).to_have_url(f"{site.url}machine/slides/drives")
            expect(own.get_by_text("This needs the role engineer")).to_be_visible()
            assert own.get_by_text("Parameters", exact=True).count() == 0
        finally:
            context.close()


def test_the_machine_s_page_leads_to_the_desk_and_back(page: Page, site: PageProcess) -> None:
    page.goto(f"{site.url}machine/slides")
    page.get_by_role("button", name="Drives").click()
    page.get_by_role("link", name="Commissioning desk").click()
    expect(page).to_have_url(f"{site.url}machine/slides/drives")
    expect(page.get_by_label("Drive", exact=True)).to_have_value("X")
    expect(page.get_by_role("link", name="slides")).to_have_attribute("href", "/machine/slides")


def test_nothing_of_the_desk_keeps_anybody_out_wide_or_narrow(page: Page, site: PageProcess) -> None:
    desk_of(page, site)
    search(page, "6065", "6065h:00")
    press(page.get_by_role("button", name="6065h:00"))
    nothing_serious_as_worn(page, "the desk")
    expect_no_overflow(page, 360)
