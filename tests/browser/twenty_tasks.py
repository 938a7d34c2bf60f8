"""The twenty tasks of docs/web.md, done click by click: ``python -m tests.browser.twenty_tasks [FOLDER]``.

Each click is a step that its row of the table names, in that order, so that the table cannot say less than it
takes. A screenshot of the end of each task goes to FOLDER. Costs minutes: no test, run by hand.
"""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

from mcclient import sync
from playwright.sync_api import Browser, Locator, Page, expect, sync_playwright

from mcserver.web.users import Role, add_user
from tests.bench.server import end
from tests.browser.conftest import CHROMIUM, FLAGS, WIDE, PageProcess
from tests.e2e.servers import ROOT, START_LIMIT_S, ServerProcess, environment

LIMIT_MS = 180_000
MOST_CLICKS = 5
PASSWORD = "battery staple of {}"
LONG = "G1010\nG21 G90\nG01 X0 F6000\nG01 X200 F600\nG01 X0 F6000\n"


def table(text: str) -> dict[int, tuple[str, tuple[str, ...]]]:
    """Return what each task is, and the clicks that the page of the documentation says; by number."""
    rows = re.findall(r"^\| (\d+) \| ([^|]+) \| ([^|]+) \|$", text, re.MULTILINE)
    return {
        int(number): (what, tuple(re.findall(r"\*([^*]+)\*", clicks.partition(";")[0])))
        for number, what, clicks in rows
    }


class Newcomer:
    """Somebody before the page, whose clicks are written down.

    Attributes:
        clicks: of the task under way.
    """

    def __init__(self, page: Page, site: str, mill: sync.Machine) -> None:
        self.page, self.site, self.mill = page, site, mill
        self.clicks: list[str] = []

    def click(self, name: str, where: Locator) -> None:
        where.first.click()
        self.clicks.append(name)

    def button(self, name: str, within: Page | Locator | None = None, *, begins: bool = False) -> Locator:
        label = re.compile(f"^{re.escape(name)}" + ("" if begins else "$"), re.IGNORECASE)
        return (within or self.page).locator("button:visible").filter(has_text=label)

    def press(self, name: str, within: Page | Locator | None = None, *, begins: bool = False) -> None:
        self.click(name, self.button(name, within, begins=begins))

    def hold(self, name: str, milliseconds: int) -> None:
        button = self.button(name).first
        button.scroll_into_view_if_needed()
        button.hover()
        self.page.mouse.down()
        self.page.wait_for_timeout(milliseconds)
        self.page.mouse.up()
        self.clicks.append(name)

    def choose(self, field: str, option: str, within: Page | Locator | None = None) -> None:
        self.click(field, (within or self.page).get_by_label(field, exact=True))
        self.click(option, self.page.get_by_role("option", name=option, exact=True))

    def fill(self, name: str, label: str, value: str, within: Page | Locator | None = None) -> None:
        field = (within or self.page).get_by_label(label, exact=True).first
        self.click(name, field)
        field.fill(value)

    def upload(self, name: str, text: str) -> None:
        """Bring a program, which another task is about."""
        file = {"name": name, "mimeType": "text/plain", "buffer": text.encode()}
        self.page.locator("input[type=file]").set_input_files(file)
        expect(self.page.get_by_label("Program", exact=True)).to_have_value(name)

    def state(self, word: str) -> None:
        expect(self.page.get_by_role("status")).to_have_text(word)

    def dialog(self) -> Locator:
        return self.page.get_by_role("dialog")

    def x(self) -> float:
        return float(self.mill.status().axes.position[0])


def seat(browser: Browser, url: str, name: str) -> Page:
    """A browser of its own with somebody logged in."""
    page = browser.new_context(viewport=WIDE).new_page()
    page.set_default_timeout(LIMIT_MS)
    page.goto(url)
    page.get_by_label("Name").fill(name)
    page.get_by_label("Password").fill(PASSWORD.format(name))
    page.get_by_role("button", name="Log in").click()
    page.get_by_text("Machines").first.wait_for()
    return page


class Tasks:
    """The tasks in the order in which they are done: a method each, by number."""

    order = (6, 7, 8, 10, 11, 12, 13, 14, 15, 16, 18, 19, 1, 4, 3, 20, 5, 17, 9, 2)

    def __init__(self, ada: Newcomer, bob: Page, server: ServerProcess, arm: sync.Machine) -> None:
        self.ada, self.bob, self.server, self.arm = ada, bob, server, arm

    def at_machine(self, name: str) -> None:
        self.ada.page.goto(f"{self.ada.site}machine/{name}")
        self.ada.state("ready")

    def t6(self) -> None:
        self.at_machine("mill")
        self.ada.press("Home all")
        expect(self.ada.page.get_by_text(": homed")).to_have_count(3)
        self.ada.state("ready")

    def t7(self) -> None:
        before = self.ada.x()
        self.ada.hold("X+", 1200)
        self.ada.state("ready")
        rest = self.ada.x()
        assert rest > before + 0.5, (before, rest)
        self.ada.page.wait_for_timeout(500)
        assert abs(self.ada.x() - rest) < 0.05, "it went on without a finger"

    def t8(self) -> None:
        before = self.ada.x()
        self.ada.choose("Distance", "step 1")
        self.ada.press("X+")
        self.ada.page.wait_for_timeout(1500)
        assert abs(self.ada.x() - before - 1.0) < 0.02, (before, self.ada.x())

    def t10(self) -> None:
        self.ada.press("Zero X")
        expect(self.ada.page.get_by_text("X reads 0 here now")).to_be_visible()

    def t11(self) -> None:
        ada = self.ada
        ada.press("Change an offset …")
        ada.choose("System", "G55", ada.dialog())
        ada.fill("X", "X [mm]", "12.5", ada.dialog())
        ada.press("Set", ada.dialog())
        rows = ada.page.get_by_role("region", name="Offsets and tools")
        expect(rows.get_by_role("row", name=re.compile(r"^G55 12\.500 "))).to_be_visible()
        origins = {each.system: each.origin for each in ada.mill.status().work_offsets}
        assert origins["G55"]["0"] == 12.5, origins

    def t12(self) -> None:
        ada = self.ada
        with ada.page.expect_file_chooser() as chooser:
            ada.click("Upload G-code", ada.page.locator(".q-uploader").locator("a, button, .q-icon"))
        text = b"G1010\nG01 X10 F600\nG02 X100 Y0 R1\n"
        chooser.value.set_files({"name": "bad.gcode", "mimeType": "text/plain", "buffer": text})
        expect(ada.page.get_by_text(re.compile(r"line 3, column \d+: .*\[MC\d+\]"))).to_be_visible()

    def t13(self) -> None:
        self.ada.upload("ok.gcode", "G1010\nG21 G90\nG01 X10 F1200\nG01 X20\n")
        self.ada.press("Dry run")
        self.ada.press("Run it", self.ada.dialog())
        expect(self.ada.page.get_by_text(re.compile("^ok.gcode is finished after"))).to_be_visible()

    def run_long(self) -> None:
        self.ada.upload("long.gcode", LONG)
        self.ada.button("Run").first.click()
        self.ada.state("running")

    def t14(self) -> None:
        self.run_long()
        self.ada.clicks.clear()
        self.ada.press("Hold")
        self.ada.state("held")
        self.ada.press("Resume")
        self.ada.state("running")

    def t15(self) -> None:
        self.ada.press("50 %")
        expect(self.ada.page.get_by_text("Override 50 %", exact=True)).to_be_visible()
        assert self.ada.mill.status().override == 50.0
        self.ada.mill.abort()
        self.ada.state("ready")

    def t16(self) -> None:
        ada = self.ada
        ada.upload("middle.gcode", "G1010\nG21 G90\nG01 X10 F1200\nG01 Y20\nG01 X20\n")
        ada.fill("From line", "From line", "4")
        ada.press("Run")
        ada.press("Run from line", ada.dialog(), begins=True)
        expect(ada.page.get_by_text(re.compile("^middle.gcode is finished after"))).to_be_visible()
        ada.page.get_by_label("From line").fill("1")

    def t18(self) -> None:
        ada = self.ada
        ada.fill("G-code", "G-code line", "G90 G0 X5")
        ada.press("Run", ada.page.locator(".mc-card", has=ada.page.get_by_label("G-code line")))
        expect(ada.page.get_by_text(re.compile("G90 G0 X5 +done"))).to_be_visible()

    def t19(self) -> None:
        ada = self.ada
        ada.press("Record")
        ada.page.wait_for_timeout(1000)
        ada.mill.jog(0, 3.0)
        ada.page.wait_for_timeout(1500)
        ada.press("Stop")
        ada.press("play")
        ada.press("Play", ada.dialog())
        expect(ada.dialog().get_by_text(re.compile(r"^[1-9]\.\d{3} s"))).to_be_visible()
        ada.dialog().get_by_role("button", name="Close").click()

    def t1(self) -> None:
        self.run_long()
        self.ada.clicks.clear()
        self.ada.page.mouse.wheel(0, 5000)
        self.ada.press("E-STOP")
        self.ada.state("EMERGENCY STOP")
        assert self.ada.mill.status().state == "estop"

    def t4(self) -> None:
        self.ada.press("Play what led to it")
        self.ada.press("Play", self.ada.dialog())
        expect(self.ada.dialog().get_by_text(re.compile(r"^[1-9]\.\d{3} s"))).to_be_visible()
        self.ada.dialog().get_by_role("button", name="Close").click()

    def t3(self) -> None:
        self.ada.press("Reset")
        self.ada.state("ready")

    def t20(self) -> None:
        ada = self.ada
        ada.choose("What", "faults")
        ada.choose("When", "last week")
        ada.press("Look up")
        history = ada.page.locator("[aria-label=History]")
        expect(history.get_by_role("cell", name="by ada on the page")).to_be_visible()

    def t5(self) -> None:
        ada = self.ada
        self.bob.goto(f"{ada.site}machine/mill")
        take = self.bob.get_by_role("button", name="Take control")
        take.click()
        self.bob.get_by_role("dialog").get_by_role("button", name="Take control").click()
        expect(ada.page.get_by_text("bob (browser", exact=False).first).to_be_visible()
        ada.press("Take control")
        ada.press("Take control", ada.dialog())
        expect(ada.page.get_by_text("You have control")).to_be_visible()
        self.bob.goto("about:blank")

    def t17(self) -> None:
        ada = self.ada
        self.run_long()
        ada.clicks.clear()
        ada.page.wait_for_timeout(3000)
        self.server.end(signal.SIGKILL)
        self.server.start()
        ada.state("ready")
        go_on = ada.button("Continue at line", begins=True)
        expect(go_on).to_be_visible()
        ada.press("Home all")
        expect(ada.page.get_by_text(": homed")).to_have_count(3)
        ada.state("ready")
        # another task
        ada.clicks.clear()
        ada.click("Continue at line", go_on)
        ada.press("Go on at line", ada.dialog(), begins=True)
        ada.state("running")
        expect(ada.page.get_by_text(re.compile("^long.gcode.* is finished after")).first).to_be_visible()

    def t9(self) -> None:
        self.at_machine("arm")
        before = self.arm.status().tools[0].position
        self.ada.choose("Along axes of", "tool")
        self.ada.hold("Z+", 1500)
        self.ada.state("ready")
        after = self.arm.status().tools[0].position
        assert max(abs(a - b) for a, b in zip(before, after, strict=True)) > 0.5, (before, after)

    def t2(self) -> None:
        ada = self.ada
        ada.click("Fleet", ada.page.get_by_role("link", name="Fleet"))
        ada.press("E-STOP all")
        expect(ada.page.get_by_text("2 of 2 machines: emergency stop confirmed")).to_be_visible()
        assert {ada.mill.status().state, self.arm.status().state} == {"estop"}


@contextmanager
def command(*arguments: str) -> Iterator[None]:
    """``mcserver ARGUMENTS`` as a process of its own that nobody waits for."""
    process = subprocess.Popen(
        [sys.executable, "-m", "mcserver", *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=environment(),
        cwd=ROOT,
    )
    try:
        yield
    finally:
        end(process)


@contextmanager
def site(folder: Path) -> Iterator[Tasks]:
    """A mill with a recorder and a history, an arm, the page with two users, and two browsers."""
    with ExitStack() as stack:
        for each in ("mill", "arm", "programs"):
            (folder / each).mkdir()
        for name in ("ada", "bob"):
            add_user(folder / "users", name, Role.OPERATOR, PASSWORD.format(name))
        mill = ServerProcess(folder / "mill", str(ROOT / "examples/mill.toml"), "mill", recorder=True)
        stack.callback(mill.close)
        mill.start()
        history = ["history", str(folder / "history"), "--connect", mill.endpoint, "--period", "1"]
        stack.enter_context(command(*history))
        arm = ["run", "--machine", "arm6", "--name", "arm", "--connect", mill.endpoint, "--no-recorder"]
        arm += ["--listen", "tcp/127.0.0.1:0", "--journal", str(folder / "arm/journal.db")]
        stack.enter_context(command(*arm))
        page = PageProcess(
            mill.endpoint,
            folder / "programs",
            *("--users", str(folder / "users"), "--history", str(folder / "history")),
        )
        stack.callback(page.close)
        machines = [
            stack.enter_context(sync.Machine.connect(name, mill.endpoint, timeout_s=START_LIMIT_S))
            for name in ("mill", "arm")
        ]
        driver = stack.enter_context(sync_playwright())
        browser = stack.enter_context(closing(driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)))
        ada, bob = (seat(browser, page.url, name) for name in ("ada", "bob"))
        yield Tasks(Newcomer(ada, page.url, machines[0]), bob, mill, machines[1])


def main(pictures: Path | None) -> int:
    """Do all tasks; return how many did not go as the table says."""
    said = table((ROOT / "docs/web.md").read_text(encoding="utf-8"))
    assert sorted(said) == sorted(Tasks.order), sorted(said)
    expect.set_options(timeout=LIMIT_MS)
    failed = 0
    with tempfile.TemporaryDirectory() as folder, site(Path(folder)) as tasks:
        for number in Tasks.order:
            what, wanted = said[number]
            tasks.ada.clicks.clear()
            task: Callable[[], None] = getattr(tasks, f"t{number}")
            why = ""
            try:
                task()
            except Exception:
                why = traceback.format_exc(limit=-2)
            clicks = tuple(tasks.ada.clicks)
            if not why and (clicks != wanted or len(clicks) > MOST_CLICKS):
                why = f"the table says {', '.join(wanted)}"
            failed += bool(why)
            print(f"{number:2} {'FAILED' if why else 'ok'}: {what}: {', '.join(clicks)} {why}", flush=True)
            if pictures is not None:
                tasks.ada.page.screenshot(path=pictures / f"{number:02}.png")
    return failed


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else None))
