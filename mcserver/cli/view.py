"""``mcserver view``: the machine in three dimensions in a browser, live or from a simulation."""

from __future__ import annotations

import enum
import importlib.util
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from mckinematics.solver import MachineKinematics

from mcserver.cli.console import (
    json_answer_on_error,
    narration,
    show_diagnostics,
    write_json,
)
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import DEFAULT_MACHINE, JsonOption, MachineOption
from mcserver.cli.program_text import load_program
from mcserver.cli.recorded import is_recording_name, open_recording
from mcserver.cli.rejection import reject
from mcserver.cli.simulate import live_progress
from mcserver.cli.simulation_report import diagnostics_of
from mcserver.errors import ConfigurationError, UsageFault
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics

if TYPE_CHECKING:
    from mcserver.view.tracks import Track
    from mcserver.view.window import Window


class Up(enum.Enum):
    """Which axis of the G-code's frame points up in the picture."""

    AUTO = "auto"
    X = "x"
    Y = "y"
    Z = "z"
    MINUS_X = "-x"
    MINUS_Y = "-y"
    MINUS_Z = "-z"


def view(
    file: Annotated[
        str | None,
        typer.Argument(
            metavar="[FILE]", help="A G-code program to simulate and play, or a recording (.mcap, .npz)."
        ),
    ] = None,
    machine: MachineOption = DEFAULT_MACHINE,
    connect: Annotated[
        str | None,
        typer.Option(
            "--connect", "-c", metavar="ENDPOINT", help="Follow a running server, tcp/127.0.0.1:7447."
        ),
    ] = None,
    host: Annotated[str, typer.Option("--host", help="Address that the page is served on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="0: a free one.")] = 8080,
    up: Annotated[Up, typer.Option("--up", help="Which way is up.")] = Up.AUTO,
    json: JsonOption = False,
) -> None:
    """Show the machine in a browser: a program simulated and played, or a running server."""
    with json_answer_on_error(json):
        if (file is None) == (connect is None):
            raise UsageFault(
                "MC017",
                "view shows either a program or a running server",
                "name a FILE to simulate, or an endpoint with --connect",
            )
        if not _installed("viser"):
            raise ConfigurationError("MC016", "mcserver view needs viser", "pip install 'mcserver[view]'")
    shown = _Address(host, port, up.value, json)
    if file is not None and is_recording_name(file):
        _play_recording(file, machine, shown)
        return
    with json_answer_on_error(json):
        described = load_machine(machine)
        kinematics = build_kinematics(described)
    if file is not None:
        _play(file, described, kinematics, shown)
    elif connect is not None:
        _follow(connect, described, kinematics, shown)


def _installed(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except ValueError:
        # an import that was blocked
        return False


class _Address:
    """Where the page is served, and how that is announced."""

    def __init__(self, host: str, port: int, up: str, json: bool) -> None:
        self.host, self.port, self.up, self.json = host, port, up, json

    def tell(self, url: str, name: str) -> None:
        narration().print(f"{name}: {url} (Ctrl-C ends)")
        if self.json:
            write_json({"ok": True, "url": url})


def _play(file: str, machine: Machine, kinematics: MachineKinematics | None, address: _Address) -> None:
    from mcserver.simulation.simulation import simulate
    from mcserver.view.player import Player
    from mcserver.view.tracks import tracks_of, work_zeros

    with json_answer_on_error(address.json):
        program = load_program(file)
    if program.faults:
        if address.json:
            write_json({"ok": False, "diagnostics": [each.as_json() for each in program.faults]})
        reject(program.faults, program.lines, program.name)
    with live_progress() as progress:
        simulation = simulate(program.text, machine, kinematics=kinematics, progress=progress, record=True)
    diagnostics = diagnostics_of(simulation.report)
    recording = simulation.recording
    if simulation.exit_code == ExitCode.REJECTED or recording is None or not len(recording.time_s):
        if address.json:
            write_json({"ok": False, "diagnostics": simulation.report["diagnostics"]})
        reject(diagnostics, program.lines, program.name)
    show_diagnostics(diagnostics, program.lines, program.name)
    tracks = tracks_of(machine, kinematics, recording)
    with _window(machine, kinematics, tracks, address) as window, _until_stopped() as stop:
        window.show_zeros(work_zeros(machine, simulation.report.get("work_offsets", ())))
        player = Player(window, machine, kinematics, recording, tracks, program.lines)
        address.tell(window.url, f"{program.name} on {machine.name}")
        player.run(stop)


def _play_recording(file: str, machine: str, address: _Address) -> None:
    from mcserver.view.player import Player
    from mcserver.view.tracks import tracks_of

    with json_answer_on_error(address.json):
        opened = open_recording(file, machine)
        run, described = opened.run, opened.machine
        recorded = [int(axis) for axis in run.cycles.axes]
        if recorded != [axis.index for axis in described.axes]:
            raise UsageFault(
                "MC017",
                f"{file} has the axes {recorded}, which are not those of {described.name}",
                "name the machine of the recording with --machine",
            )
    tracks = tracks_of(described, opened.kinematics, run.cycles)
    text = [run.text.get(number, "") for number in range(1, max(run.text, default=0) + 1)]
    with _window(described, opened.kinematics, tracks, address) as window, _until_stopped() as stop:
        player = Player(window, described, opened.kinematics, run.cycles, tracks, text)
        address.tell(window.url, f"{run.name} on {described.name}")
        player.run(stop)


def _follow(endpoint: str, machine: Machine, kinematics: MachineKinematics | None, address: _Address) -> None:
    from mcserver.view.follower import Follower
    from mcserver.view.live import LiveStates

    with json_answer_on_error(address.json):
        states = LiveStates(machine.name, endpoint)
    with states, _window(machine, kinematics, (), address) as window, _until_stopped() as stop:
        follower = Follower(window, machine, kinematics, states)
        address.tell(window.url, machine.name)
        follower.run(stop)


@contextmanager
def _window(
    machine: Machine,
    kinematics: MachineKinematics | None,
    tracks: Sequence[Track],
    address: _Address,
) -> Iterator[Window]:
    from mcserver.view.opening import open_window

    with ExitStack() as opened:
        with json_answer_on_error(address.json):
            window = opened.enter_context(
                open_window(
                    machine,
                    kinematics,
                    tracks,
                    host=address.host,
                    port=address.port,
                    up=address.up,
                    package_roots=_package_roots(),
                )
            )
        missing = window.missing_meshes
        if missing:
            narration().print(
                f"{len(missing)} meshes were not found, such as {missing[0]}: their links are drawn as bones",
            )
        yield window


def _package_roots() -> list[Path]:
    """Folders of ROS packages, where there are any: meshes are looked for there too."""
    prefixes = [
        Path(prefix) / "share" for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if prefix
    ]
    return prefixes + [Path(path) for path in os.environ.get("ROS_PACKAGE_PATH", "").split(":") if path]


@contextmanager
def _until_stopped() -> Iterator[threading.Event]:
    """An event that Ctrl-C and SIGTERM set."""
    stop = threading.Event()
    kept = {
        number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield stop
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
