"""The twenty tasks of docs/web.md, done click by click: ``python -m tests.browser.twenty_tasks``.

Each click is a step that its row of the table names, in that order, so that the table cannot say less than it
takes; behind them come further tasks (`MORE`). By the mouse at 1920 px, or by each of ``--ways`` at each of
``--widths``. A screenshot of the end of each task goes to ``--pictures FOLDER``. Costs minutes: no test.
"""

from __future__ import annotations

import argparse
import re
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path

from mcclient import sync
from playwright.sync_api import Locator, Page, TimeoutError, expect, sync_playwright

from mcserver.web.users import Role, add_user
from tests.bench.server import running
from tests.browser.conftest import CHROMIUM, FLAGS, WIDE, PageProcess
from tests.browser.operator import Operator, Way, seat
from tests.e2e.servers import ROOT, START_LIMIT_S, ServerProcess

LIMIT_MS = 120_000
LOOK_MS = 50
# a button is held down so long, and so often
HOLD_MS = 3000
MOST_PRESSES = 5
MOST_CLICKS = 5
# of a phone and a tablet
HEIGHTS = {360: 740, 768: 1024}
MCSERVER = (sys.executable, "-m", "mcserver")
PASSWORD = "battery staple of {}"
LONG = "G1010\nG21 G90\nG01 X0 F6000\nG01 X200 F{feed}\nG01 X0 F6000\n"


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

    def __init__(self, hand: Operator, site: str, mill: sync.Machine) -> None:
        self.hand, self.page, self.site, self.mill = hand, hand.page, site, mill
        self.clicks: list[str] = []

    def click(self, name: str, where: Locator) -> None:
        self.hand.click(where)
        self.clicks.append(name)

    def button(self, name: str, within: Page | Locator | None = None, *, begins: bool = False) -> Locator:
        label = re.compile(f"^{re.escape(name)}" + ("" if begins else "$"), re.IGNORECASE)
        return (within or self.page).locator("button:visible").filter(has_text=label)

    def press(self, name: str, within: Page | Locator | None = None, *, begins: bool = False) -> None:
        self.click(name, self.button(name, within, begins=begins))

    def hold(self, name: str, holds: Callable[[], bool]) -> None:
        """Hold a button down until something holds; once more where a busy computer has let it go."""
        for _ in range(MOST_PRESSES):
            with self.hand.held(self.button(name)):
                gone = self.look(holds, HOLD_MS)
            if gone:
                self.clicks.append(name)
                return
        raise AssertionError(f"{name} moves nothing")

    def look(self, holds: Callable[[], bool], limit_ms: int) -> bool:
        """Return whether something comes to hold within a time."""
        for _ in range(limit_ms // LOOK_MS):
            if holds():
                return True
            self.page.wait_for_timeout(LOOK_MS)
        return False

    def choose(self, field: str, option: str, within: Page | Locator | None = None) -> None:
        self.click(field, (within or self.page).get_by_label(field, exact=True))
        self.click(option, self.page.get_by_role("option", name=option, exact=True))

    def fill(self, name: str, label: str, value: str, within: Page | Locator | None = None) -> None:
        self.hand.fill((within or self.page).get_by_label(label, exact=True), value)
        self.clicks.append(name)

    def upload(self, name: str, text: str) -> None:
        """Bring a program, which another task is about."""
        file = {"name": name, "mimeType": "text/plain", "buffer": text.encode()}
        self.page.locator("input[type=file]").set_input_files(file)
        expect(self.page.get_by_label("Program", exact=True)).to_have_value(name)

    def card(self, title: str) -> Locator:
        return self.page.locator(".mc-card", has=self.page.get_by_role("heading", name=title, exact=True))

    def state(self, word: str) -> None:
        expect(self.page.get_by_role("status")).to_have_text(word)

    def dialog(self) -> Locator:
        return self.page.get_by_role("dialog")

    def x(self) -> float:
        return float(self.mill.status().axes.position[0])

    def at_rest(self) -> None:
        """Wait until the mill has ended every move: the page may not have shown the last one yet."""
        if not self.look(lambda: has_ended(self.mill), LIMIT_MS):
            raise AssertionError("it does not come to rest")


def has_ended(machine: sync.Machine) -> bool:
    """Return whether no program of a machine is open, such as a jog's."""
    return not machine.programs(ended=False)


def log_in(page: Page, url: str, name: str) -> None:
    page.set_default_timeout(LIMIT_MS)
    page.goto(url)
    page.get_by_label("Name").fill(name)
    page.get_by_label("Password").fill(PASSWORD.format(name))
    page.get_by_role("button", name="Log in").click()
    page.get_by_text("Machines").first.wait_for()


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
        self.ada.hold("X+", lambda: self.ada.x() > before + 0.5)
        self.ada.at_rest()
        rest = self.ada.x()
        self.ada.page.wait_for_timeout(500)
        assert abs(self.ada.x() - rest) < 0.05, "it went on without a finger"

    def t8(self) -> None:
        before = self.ada.x()
        self.ada.choose("Distance", "step 1")
        self.ada.press("X+")
        self.wait_until(lambda: abs(self.ada.x() - before - 1.0) < 0.02)

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
            ada.click("Upload G-code", ada.page.locator(".q-uploader").locator("a, button"))
        text = b"G1010\nG01 X10 F600\nG02 X100 Y0 R1\n"
        chooser.value.set_files({"name": "bad.gcode", "mimeType": "text/plain", "buffer": text})
        expect(ada.page.get_by_text(re.compile(r"line 3, column \d+: .*\[MC\d+\]"))).to_be_visible()

    def t13(self) -> None:
        self.ada.upload("ok.gcode", "G1010\nG21 G90\nG01 X10 F1200\nG01 X20\n")
        self.ada.press("Dry run")
        self.ada.press("Run it", self.ada.dialog())
        expect(self.ada.page.get_by_text(re.compile("^ok.gcode is finished after"))).to_be_visible()

    def run_long(self, feed: int = 30) -> None:
        """Run what does not end by itself while somebody goes to a button by Tab on a busy computer."""
        self.ada.upload("long.gcode", LONG.format(feed=feed))
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
        ada.hand.fill(ada.page.get_by_label("From line"), "1")

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
        ada.press("Stop", ada.card("Recordings"))
        ada.press("play")
        ada.press("Play", ada.dialog())
        expect(ada.dialog().get_by_text(re.compile(r"^[1-9]\.\d{3} s"))).to_be_visible()
        ada.dialog().get_by_role("button", name="Close").click()

    def t1(self) -> None:
        self.run_long()
        self.ada.clicks.clear()
        self.ada.page.evaluate("scrollTo(0, document.body.scrollHeight)")
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
        self.run_long(feed=240)
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
        self.ada.hold("Z+", lambda: self.way_of_the_tip(before) > 0.5)
        self.ada.state("ready")

    def way_of_the_tip(self, before: Sequence[float]) -> float:
        """Return how far the arm's tip is from a place along one axis, at the most [mm]."""
        after = self.arm.status().tools[0].position
        return max(abs(a - b) for a, b in zip(before, after, strict=True))

    def t2(self) -> None:
        ada = self.ada
        ada.click("Fleet", ada.page.get_by_role("link", name="Fleet"))
        ada.press("E-STOP all")
        expect(ada.page.get_by_text("2 of 2 machines: emergency stop confirmed")).to_be_visible()
        assert {ada.mill.status().state, self.arm.status().state} == {"estop"}

    def held_with_a_work_zero(self) -> None:
        """1: jog is in machine coordinates, also behind t10."""
        before = self.ada.x()
        self.ada.choose("Distance", "while held")
        self.ada.hold("X+", lambda: self.ada.x() > before + 0.5)
        self.ada.at_rest()

    def two_steps(self) -> None:
        """2: steps follow each other."""
        before = self.ada.x()
        self.ada.choose("Distance", "step 10")
        for _ in range(2):
            self.ada.press("X+")
        self.wait_until(lambda: abs(self.ada.x() - before - 20.0) < 0.05)
        self.ada.state("ready")

    def a_faulty_program(self) -> None:
        """3: the fault stands at its line, where the program does."""
        ada = self.ada
        ada.upload("faulty.gcode", "G1010\nG01 X10 F600\nG02 X100 Y0 R1\n")
        ada.press("Run")
        expect(ada.page.get_by_text("faulty.gcode · failed").first).to_be_visible()
        expect(ada.card("Program").get_by_role("alert")).to_contain_text("line 3: the chord is")
        expect(ada.card("Program").locator(".bad").first).to_contain_text("G02 X100 Y0 R1")
        ada.state("ready")

    def override_at_the_end(self) -> None:
        """4: a program's override ends with it."""
        ada = self.ada
        ada.upload("quick.gcode", "G1010\nG21 G91\nG01 X200 F1200\nG01 X-200\n")
        ada.press("Run")
        ada.state("running")
        ada.press("200 %")
        expect(ada.page.get_by_text(re.compile("^quick.gcode is finished after"))).to_be_visible()
        expect(ada.page.get_by_text("Override 100 %", exact=True)).to_be_visible()

    def own_button(self) -> None:
        """10: it shows its program, asks for its number, and has to be confirmed."""
        ada = self.ada
        ada.press("park …")
        dialog = ada.dialog()
        ada.hand.turn(dialog.get_by_role("checkbox", name="the vise is empty"))
        ada.fill("height", "height [mm]", "-12.5", dialog)
        expect(dialog.get_by_label("Program text")).to_contain_text("G53 G0 Z-12.5")
        ada.press("Run", dialog)
        self.wait_until(lambda: abs(ada.mill.status().axes.position[2] + 12.5) < 0.05)
        ada.state("ready")

    def undo(self) -> None:
        """11: what t11 has set is taken back."""
        ada = self.ada
        ada.press("Undo …")
        ada.press("Undo", ada.dialog())
        rows = ada.page.get_by_role("region", name="Offsets and tools")
        expect(rows.get_by_role("row", name=re.compile(r"^G55 12\.500 "))).to_have_count(0)

    def machine_file(self) -> None:
        """11: it is looked at, changed and checked; the difference is shown."""
        ada = self.ada
        ada.press("Look at the machine file")
        text = ada.dialog().get_by_role("textbox", name="Machine file")
        ada.hand.fill(text, "# by ada\n" + text.input_value())
        ada.press("Check", ada.dialog())
        expect(ada.dialog().get_by_text("+# by ada", exact=True)).to_be_visible()
        ada.press("Close", ada.dialog())
        expect(ada.dialog()).to_have_count(0)

    def line_by_line(self) -> None:
        """12: single step."""
        ada = self.ada
        ada.upload("step.gcode", "G1010\nG21 G91\nG01 X2 F600\n")
        switch = ada.page.get_by_role("switch", name="Single step")
        ada.hand.turn(switch)
        expect(switch).to_be_checked()
        ada.press("Run")
        for done in (1, 2, 3):
            ada.press("Next line")
            self.wait_until(lambda done=done: ada.mill.status().programs[0].done >= done)
        expect(ada.page.get_by_text(re.compile("^step.gcode is finished after"))).to_be_visible()
        ada.hand.turn(switch)
        expect(switch).not_to_be_checked()

    def line_in_its_path(self) -> None:
        """12: a line of a dry run is chosen, and marked beside its path."""
        ada = self.ada
        ada.upload("square.gcode", "G1010\nG21 G90\nG01 X20 F6000\nG01 Y20\nG01 X10\n")
        ada.press("Dry run")
        ada.fill("Line", "Line", "4", ada.dialog())
        expect(ada.dialog().locator(".mc-linked .now")).to_have_text(re.compile("^ *4  G01 Y20"))
        ada.press("Close", ada.dialog())
        expect(ada.dialog()).to_have_count(0)

    def probing(self) -> None:
        """15: the top of the work, as the program that it is."""
        ada = self.ada
        ada.press("Top …")
        dialog = ada.dialog()
        ada.fill("travel", "travel [mm]", "80", dialog)
        ada.fill("feed", "feed [mm/min]", "1500", dialog)
        expect(dialog.get_by_label("Program text")).to_contain_text("G38.2 Z-80 F1500")
        ada.press("Run", dialog)
        self.wait_until(lambda: any("2" in each.origin for each in ada.mill.status().work_offsets))
        ada.state("ready")

    def language(self) -> None:
        """16: German, and back."""
        ada = self.ada
        ada.click("Menu", ada.page.get_by_role("button", name="Menu", exact=True))
        ada.click("Deutsch", ada.page.get_by_role("menuitem", name="Deutsch"))
        ada.state("bereit")
        ada.click("Menü", ada.page.get_by_role("button", name="Menü", exact=True))
        ada.click("English", ada.page.get_by_role("menuitem", name="English"))
        ada.state("ready")

    def taught(self) -> None:
        """8: two poses are taken and replayed."""
        ada = self.ada
        ada.press("Take pose")
        ada.choose("Step", "1 mm, deg")
        before = self.arm.status().tools[0].position
        ada.press("Z+", ada.card("Tool jog"))
        # a pose is taken at rest alone, and the step may not have begun
        self.wait_until(lambda: self.way_of_the_tip(before) > 0.9 and has_ended(self.arm))
        ada.press("Take pose")
        expect(ada.page.get_by_label("Taught program")).to_have_value(re.compile(r"(G01 X.* T1 F\d+\n){2}$"))
        ada.press("Replay")
        expect(ada.page.get_by_text(re.compile("^taught.gcode is finished after"))).to_be_visible()

    def selected_of_the_fleet(self) -> None:
        """9: one of two is found, ticked, stopped and reset."""
        ada = self.ada
        ada.click("Fleet", ada.page.get_by_role("link", name="Fleet"))
        rows = ada.page.locator(".ag-pinned-left-cols-container [role=row]")
        expect(rows).to_have_count(2)
        ada.fill("Search", "Search", "arm")
        expect(rows).to_have_count(1)
        if ada.hand.way is Way.KEYBOARD:
            ada.hand.turn(rows.locator("[role=gridcell]"))
        else:
            ada.hand.click(rows.locator("input[type=checkbox]"))
        expect(rows.locator("input[type=checkbox]")).to_be_checked()
        ada.press("E-STOP selected")
        expect(ada.page.get_by_text("1 of 1 machines: emergency stop confirmed")).to_be_visible()
        assert (ada.mill.status().state, self.arm.status().state) == ("ready", "estop")
        ada.press("Reset selected")
        ada.press("Reset", ada.dialog())
        expect(ada.page.get_by_text("1 of 1 machines: reset")).to_be_visible()
        self.at_machine("arm")

    def wait_until(self, holds: Callable[[], bool]) -> None:
        if not self.ada.look(holds, LIMIT_MS):
            raise AssertionError("it did not come")


# beyond the twenty: behind which of them each is done
MORE = {
    11: ("undo",),
    10: ("held_with_a_work_zero", "two_steps"),
    15: ("a_faulty_program", "override_at_the_end", "line_by_line", "line_in_its_path"),
    17: ("machine_file", "language", "own_button", "probing"),
    9: ("taught", "selected_of_the_fleet"),
}


OWN_BUTTON = """
[[button]]
name = "park"
text = "G53 G0 Z{height}"
confirm = "the vise is empty"
[[button.argument]]
name = "height"
low = -100
high = -1
default = -1
unit = "mm"
"""


@contextmanager
def site(folder: Path, way: Way, width: int) -> Iterator[Tasks]:
    """A mill with a recorder and a history, an arm, the page with two users, and two browsers."""
    with ExitStack() as stack:
        for each in ("mill", "arm", "programs"):
            (folder / each).mkdir()
        for name, role in (("ada", Role.ENGINEER), ("bob", Role.OPERATOR)):
            add_user(folder / "users", name, role, PASSWORD.format(name))
        file = folder / "mill.toml"
        file.write_text(
            (ROOT / "examples/mill.toml").read_text(encoding="utf-8") + OWN_BUTTON, encoding="utf-8"
        )
        mill = ServerProcess(folder / "mill", str(file), "mill", recorder=True)
        stack.callback(mill.close)
        mill.start()
        history = ["history", str(folder / "history"), "--connect", mill.endpoint, "--period", "1"]
        stack.enter_context(running([*MCSERVER, *history]))
        arm = ["run", "--machine", "arm6", "--name", "arm", "--connect", mill.endpoint, "--no-recorder"]
        arm += ["--listen", "tcp/127.0.0.1:0", "--journal", str(folder / "arm/journal.db")]
        stack.enter_context(running([*MCSERVER, *arm]))
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
        ada = seat(browser, way, width, HEIGHTS.get(width, 1080))
        bob = seat(browser, Way.MOUSE, WIDE["width"], WIDE["height"])
        log_in(ada, page.url, "ada")
        log_in(bob, page.url, "bob")
        yield Tasks(Newcomer(Operator(ada, way), page.url, machines[0]), bob, mill, machines[1])


def do(tasks: Tasks, name: str, what: str, wanted: tuple[str, ...] | None) -> bool:
    """Do one task; whether it went, by these clicks where there are any."""
    tasks.ada.clicks.clear()
    task: Callable[[], None] = getattr(tasks, name)
    why = ""
    began = time.perf_counter()
    try:
        task()
    except Exception:
        why = traceback.format_exc(limit=-2)
    clicks = tuple(tasks.ada.clicks)
    if not why and wanted is not None and (clicks != wanted or len(clicks) > MOST_CLICKS):
        why = f"the table says {', '.join(wanted)}"
    took = time.perf_counter() - began
    if why:
        # the next one shall not find what this one has left open
        with suppress(TimeoutError):
            tasks.ada.page.goto(f"{tasks.ada.site}machine/{'arm' if name in MORE[9] else 'mill'}")
    print(f"{name} {'FAILED' if why else 'ok'} {took:.0f} s: {what}: {', '.join(clicks)} {why}", flush=True)
    return not why


def do_all(way: Way, width: int, pictures: Path | None) -> int:
    """Do all tasks; return how many did not go, or not as the table says."""
    said = table((ROOT / "docs/web.md").read_text(encoding="utf-8"))
    assert sorted(said) == sorted(Tasks.order), sorted(said)
    failed = done = 0
    print(f"== {way.value} at {width} px", flush=True)
    with tempfile.TemporaryDirectory() as folder, site(Path(folder), way, width) as tasks:
        for number in Tasks.order:
            rows = [(f"t{number}", *said[number])]
            for name in (f"t{number}", *MORE.get(number, ())):
                what, wanted = (
                    rows[0][1:] if name == f"t{number}" else (getattr(tasks, name).__doc__ or "", None)
                )
                failed += not do(tasks, name, what, wanted)
                done += 1
                if pictures is not None:
                    tasks.ada.page.screenshot(path=pictures / f"{way.value}-{width}-{done:02}-{name}.png")
    print(f"== {way.value} at {width} px: {done - failed} of {done}", flush=True)
    return failed


def main() -> int:
    """Do all tasks in each way at each width; return in how many cases one did not go."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ways", nargs="+", type=Way, default=[Way.MOUSE])
    parser.add_argument("--widths", nargs="+", type=int, default=[WIDE["width"]])
    parser.add_argument("--pictures", type=Path)
    asked = parser.parse_args()
    expect.set_options(timeout=LIMIT_MS)
    return sum(do_all(way, width, asked.pictures) for width in asked.widths for way in asked.ways)


if __name__ == "__main__":
    sys.exit(min(main(), 100))
