"""A simulated run played in the window: play and pause, time, speed."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from mckinematics.solver import MachineKinematics

from mcserver.machine.machine_file import Machine
from mcserver.simulation.recorder import Recorded
from mcserver.view.panel import axes_html, axis_names, css, line_colours, line_html
from mcserver.view.playback import SPEEDS, Playback
from mcserver.view.tracks import Track, positions_at, tip_frames
from mcserver.view.window import Window

FRAMES_A_SECOND = 30.0
# frames between two looks at the panel
PANEL_EVERY = 3
ORDERS = 64


class Player:
    """Plays a recording until `stop`.

    Args:
        window: where. tracks: of the recording. source_lines: the program's text.
    """

    def __init__(
        self,
        window: Window,
        machine: Machine,
        kinematics: MachineKinematics | None,
        recording: Recorded,
        tracks: Sequence[Track],
        source_lines: Sequence[str],
    ) -> None:
        self._window, self._machine, self._kinematics = window, machine, kinematics
        self._recording, self._tracks, self._lines = recording, tracks, source_lines
        self._names = axis_names(machine, kinematics)
        self._shown_line = -1
        window.add_tracks(tracks)
        self.playback = Playback(recording.time_s)
        # callbacks of the browser come in threads of viser; the loop does what they ask
        self._orders: queue.Queue[Callable[[], None]] = queue.Queue(maxsize=ORDERS)
        self._colours = line_colours(sorted({int(line) for line in recording.line}))
        moved = np.ptp(recording.setpoint, axis=0) > 1e-6
        still = not moved.any()
        self._axes = [
            axis for axis, moves in zip(machine.axes, moved.tolist(), strict=True) if moves or still
        ]
        gui = window.gui
        self._line = gui.add_html("")
        self._button = gui.add_button("Pause")
        end = max(self.playback.end, self.playback.start + machine.cycle_s)
        self._time: Any = gui.add_slider("time s", self.playback.start, end, 0.001, self.playback.start)
        self._speed = gui.add_dropdown("speed ×", SPEEDS, initial_value="1")
        repeat = gui.add_checkbox("repeat", False)
        paths = gui.add_checkbox("paths", True)
        frames = gui.add_checkbox("joint frames", False)
        fit = gui.add_button("Look at the path")
        self._values = gui.add_html("")
        self._button.on_click(lambda _: self._order(self.playback.toggle))
        self._time.on_update(self._on_time)
        self._speed.on_update(lambda _: self._order(self._take_speed))
        repeat.on_update(lambda _: self._order(lambda: self._take_repeat(repeat.value)))
        fit.on_click(lambda _: self._order(window.fit))
        paths.on_update(lambda _: self._order(lambda: window.show_paths(paths.value)))
        frames.on_update(lambda _: self._order(lambda: window.show_frames(frames.value)))
        self.show()

    def run(self, stop: threading.Event, clock: Callable[[], float] = time.monotonic) -> None:
        """Play until ``stop``."""
        last, count = clock(), 0
        while not stop.wait(1.0 / FRAMES_A_SECOND):
            now = clock()
            before = self.playback.row, self.playback.playing
            while not self._orders.empty():
                self._orders.get_nowait()()
            if self._window.watched:
                self.playback.advance(now - last)
            last, count = now, count + 1
            if (self.playback.row, self.playback.playing) != before:
                self.show(panel=count % PANEL_EVERY == 0 or not self.playback.playing)

    def show(self, *, panel: bool = True) -> None:
        """Draw the present row."""
        row = self.playback.row
        columns = positions_at(self._machine, self._recording, np.array([row]))
        positions = {axis: float(values[0]) for axis, values in columns.items()}
        self._window.place(positions, tip_frames(self._machine, self._kinematics, positions))
        number = int(self._recording.line[row])
        if number != self._shown_line:
            self._shown_line = number
            self._window.highlight(self._tracks, number, self._colours[number])
        if not panel:
            return
        source = self._lines[number - 1].partition(";")[0] if 0 < number <= len(self._lines) else ""
        self._line.content = line_html(number, source, css(self._colours[number]))
        self._values.content = axes_html(self._axes, positions, self._names)
        self._time.value = round(self.playback.now, 3)
        label = "Pause" if self.playback.playing else "Play"
        if self._button.label != label:
            self._button.label = label

    def _on_time(self, event: Any) -> None:
        # what the loop sets comes back without a client
        if event.client is not None:
            wanted = float(self._time.value)
            self._order(lambda: self.playback.seek(wanted))

    def _take_speed(self) -> None:
        self.playback.speed = float(self._speed.value)

    def _take_repeat(self, wanted: bool) -> None:
        self.playback.repeat = wanted

    def _order(self, act: Callable[[], None]) -> None:
        try:
            self._orders.put_nowait(act)
        except queue.Full:
            # someone holds a slider faster than the loop: the next one counts
            return
