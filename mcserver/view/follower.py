"""A running server shown in the window, as its telemetry tells."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping

import numpy as np
from mckinematics.solver import MachineKinematics

from mcserver.machine.machine_file import Machine
from mcserver.net.messages import MachineStatus, WorkOffset
from mcserver.view.live import LiveStates
from mcserver.view.panel import axes_html, axis_names, line_html
from mcserver.view.solids import Array
from mcserver.view.tracks import tip_frames, work_zeros
from mcserver.view.window import TRAIL, Window

LOOKS_A_SECOND = 30.0
TRAIL_POINTS = 600
# states between two drawings of the trails, which are sent whole, and of the panel
TRAIL_EVERY = 10
PANEL_EVERY = 4
# without a state for this long the server counts as silent [s]
SILENT_S = 2.0


class Follower:
    """Shows the newest state until `stop`.

    Args:
        window: where. states: of the server.
    """

    def __init__(
        self,
        window: Window,
        machine: Machine,
        kinematics: MachineKinematics | None,
        states: LiveStates,
    ) -> None:
        self._window, self._machine, self._kinematics = window, machine, kinematics
        self._states = states
        self._names = axis_names(machine, kinematics)
        self._trails: dict[str, deque[Array]] = {}
        self._count = 0
        self._said = self._shown = ""
        self._offsets: list[WorkOffset] = []
        self._moved: set[str] = set()
        gui = window.gui
        self._status = gui.add_html("")
        clear = gui.add_button("Clear the trails")
        fit = gui.add_button("Look at the trails")
        frames = gui.add_checkbox("joint frames", False)
        self._values = gui.add_html("")
        self._cleared = threading.Event()
        self._fit = threading.Event()
        fit.on_click(lambda _: self._fit.set())
        clear.on_click(lambda _: self._cleared.set())
        frames.on_update(lambda _: window.show_frames(frames.value))

    def run(self, stop: threading.Event) -> None:
        """Follow until ``stop``."""
        while not stop.wait(1.0 / LOOKS_A_SECOND):
            state = self._states.newest()
            if state is not None:
                self.show(state)
            elif self._states.silent_s > SILENT_S:
                self._say(line_html(0, "", "rgb(160,168,178)") + _note("the server is silent"))

    def show(self, state: MachineStatus) -> None:
        """Draw one state; axes that the machine file has and the server lacks stay where they start."""
        positions = positions_of(self._machine, state)
        tips = tip_frames(self._machine, self._kinematics, positions)
        self._window.place(positions, tips)
        if state.work_offsets != self._offsets:
            self._offsets = state.work_offsets
            offsets = [{"system": each.system, "origin": each.origin} for each in self._offsets]
            self._window.show_zeros(work_zeros(self._machine, offsets))
        self._count += 1
        if self._cleared.is_set():
            self._cleared.clear()
            self._trails.clear()
            self._moved.clear()
            self._window.clear_trails()
        for label, frame in tips.items():
            trail = self._trails.setdefault(label, deque(maxlen=TRAIL_POINTS))
            if not trail or np.abs(trail[-1] - frame[:3, 3]).max() > 1e-5:
                trail.append(frame[:3, 3].copy())
                self._moved.add(label)
        if self._count % TRAIL_EVERY == 1:
            self._window.show_trails({label: np.array(self._trails[label]) for label in self._moved})
            self._moved.clear()
            self._window.fit_where_it_grows()
        if self._fit.is_set():
            self._fit.clear()
            self._window.fit()
        if self._count % PANEL_EVERY == 1:
            self._say(_status(state))
            values = axes_html(self._machine.axes, positions, self._names)
            if values != self._shown:
                self._shown = self._values.content = values

    def _say(self, content: str) -> None:
        if content != self._said:
            self._said = self._status.content = content


def positions_of(machine: Machine, state: MachineStatus) -> dict[int, float]:
    """The encoders' positions by axis number [m or rad]."""
    positions = {axis.index: axis.initial_position for axis in machine.axes}
    scale = {axis.index: axis.type.si_per_unit for axis in machine.axes}
    for index, position in zip(state.axes.index, state.axes.position, strict=True):
        if index in scale:
            positions[index] = position * scale[index]
    return positions


def _status(state: MachineStatus) -> str:
    running: Mapping[str, object] = {}
    for program in state.programs:
        if program.state == "running":
            running = {"name": program.name or program.program, "line": program.line}
    colour = f"rgb({TRAIL[0]},{TRAIL[1]},{TRAIL[2]})" if running else "rgb(160,168,178)"
    line = running.get("line", 0)
    text = line_html(line if isinstance(line, int) else 0, str(running.get("name", "")), colour)
    return text + _note(f"{state.state}" + "".join(f", {fault.code}" for fault in state.faults))


def _note(text: str) -> str:
    import html

    return f'<div style="padding:0 0.8em 0.4em;font-size:0.85em">{html.escape(text)}</div>'
