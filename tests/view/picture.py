"""The documentation's picture of ``mcserver view``: python -m tests.view.picture PROGRAM MACHINE TIME OUT."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.simulation import simulate
from mcserver.view.opening import open_window
from mcserver.view.player import Player
from mcserver.view.tracks import tracks_of
from tests.view.chromium import Page, find_chromium

SIZE = (1280, 720)
# the scene fades in with its frames, of which software rendering draws few
OPAQUE = "getComputedStyle(document.querySelector('canvas')).opacity === '1'"
NOTIFIED = "document.querySelector('.mantine-Notification-closeButton') !== null"
TELL_OFF = "document.querySelectorAll('.mantine-Notification-closeButton').forEach(button => button.click())"
# so many looks in a row, as it is opaque for a moment before it fades in
LOOKS = 12
LOOK_EVERY_S = 0.5
LIMIT_S = 90.0


def draw(program: Path, machine_name: str, time_s: float, output: Path) -> None:
    """The program's run at one instant, as the browser shows it."""
    machine = load_machine(machine_name)
    kinematics = build_kinematics(machine)
    text = program.read_text("utf-8")
    recording = simulate(text, machine, kinematics=kinematics, record=True).recording
    assert recording is not None
    tracks = tracks_of(machine, kinematics, recording)
    with open_window(machine, kinematics, tracks) as window:
        player = Player(window, machine, kinematics, recording, tracks, text.splitlines())
        player.playback.playing = False
        player.playback.seek(time_s)
        player.show()
        with Page(window.url, SIZE) as page:
            page.wait_for("document.querySelector('canvas') !== null")
            page.wait_for(NOTIFIED)
            page.evaluate(TELL_OFF)
            _until_opaque(page)
            output.write_bytes(page.picture())


def _until_opaque(page: Page) -> None:
    looks, end = 0, time.monotonic() + LIMIT_S
    while looks < LOOKS:
        if time.monotonic() > end:
            raise TimeoutError("the scene never stood still")
        looks = looks + 1 if page.evaluate(OPAQUE) else 0
        time.sleep(LOOK_EVERY_S)


def main(arguments: list[str]) -> int:
    """Exit code 0 with the picture, or with a word on what is missing for it."""
    program, machine, time_s, output = arguments
    if find_chromium() is None:
        sys.stderr.write(f"{output} is left as it is: no Chromium (apt-get install chromium)\n")
        return 0
    draw(Path(program), machine, float(time_s), Path(output))
    sys.stderr.write(f"drawn: {output}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
