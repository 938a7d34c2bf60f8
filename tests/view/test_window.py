"""The page as it is served: over HTTP, over its socket, from the command line."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from urllib.request import urlopen

import msgspec
import numpy as np
import pytest
import viser
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from mcserver.cli.app import run_command_line
from mcserver.cli.exit_codes import NobodyAnswers, UsageFault
from mcserver.contract.samples import required, struct_type
from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.net.configuration import NetworkOptions
from mcserver.net.messages import MachineStatus, WorkOffset
from mcserver.server import ServerOptions, running
from mcserver.simulation.simulation import simulate
from mcserver.view.follower import Follower, positions_of
from mcserver.view.live import LiveStates
from mcserver.view.opening import open_window
from mcserver.view.player import Player
from mcserver.view.tracks import tracks_of
from mcserver.view.window import Window
from tests.cli.command import ENTRY, ROOT
from tests.service.fakes import FakePipelines, FakePort

DOG = load_machine("robot-dog")
KINEMATICS = build_kinematics(DOG)
LIMIT_S = 30.0
Capture = pytest.CaptureFixture[str]


@pytest.fixture
def window() -> Iterator[Window]:
    with open_window(DOG, KINEMATICS) as opened:
        yield opened


def first_messages(url: str, count: int) -> int:
    """Bytes of the first messages that the page gets on its socket."""
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    with connect(
        url.replace("http://", "ws://"), subprotocols=[protocol], max_size=None, open_timeout=LIMIT_S
    ) as link:
        return sum(len(link.recv(timeout=LIMIT_S)) for _ in range(count))


def test_the_page_is_served_with_all_that_it_needs(window: Window) -> None:
    with urlopen(window.url, timeout=LIMIT_S) as answer:
        page = answer.read().decode()
    assert answer.status == 200
    assert "<html" in page
    assert 'src="http' not in page


def test_the_socket_tells_the_scene(window: Window) -> None:
    assert first_messages(window.url, 1) > 1000


def test_a_port_that_is_taken_is_refused_with_a_remedy() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with (
            pytest.raises(UsageFault, match="cannot be listened on") as caught,
            open_window(DOG, KINEMATICS, port=taken.getsockname()[1]),
        ):
            pass
    assert caught.value.code == "MC017"
    assert "--port 0" in caught.value.hint


def test_a_player_shows_the_row_that_it_is_given(window: Window) -> None:
    text = (ROOT / "examples" / "robot-dog.gcode").read_text("utf-8")
    recording = simulate(text, DOG, kinematics=KINEMATICS, record=True).recording
    assert recording is not None
    tracks = tracks_of(DOG, KINEMATICS, recording)
    player = Player(window, DOG, KINEMATICS, recording, tracks, text.splitlines())
    player.playback.seek(2.45)
    player.show()
    assert window.tip("T3")[0] == pytest.approx(-0.159, abs=1e-5)
    assert window.tip("T3")[2] == pytest.approx(0.8 * 0.45, abs=2e-3)


def test_the_camera_looks_at_what_is_travelled(window: Window) -> None:
    square = np.array([[5.0, 5.0, 0.0], [6.0, 5.0, 0.0], [6.0, 6.0, 0.0]])
    window.show_trails({"far": square})
    window.fit()
    camera = window._server.initial_camera
    assert np.allclose(camera.look_at, [5.5, 5.5, 0.0])
    assert np.linalg.norm(np.array(camera.position) - camera.look_at) < 2.0
    window.clear_trails()


async def test_a_running_server_is_followed(tmp_path: Path, window: Window) -> None:
    options = ServerOptions(
        network=NetworkOptions(listen=("tcp/127.0.0.1:0",)), journal=tmp_path / "journal.db"
    )
    port = FakePort(DOG)
    async with running(DOG, options, port, FakePipelines(port)) as (_, face):
        endpoint = (await face.endpoints())[0]
        states = await asyncio.to_thread(LiveStates, DOG.name, endpoint, timeout_s=LIMIT_S)
        with states:
            state = None
            async with asyncio.timeout(LIMIT_S):
                while state is None:
                    state = states.newest()
                    await asyncio.sleep(0.01)
    assert states.newest() is None or states.silent_s < LIMIT_S
    expected = dict(zip(state.axes.index, np.radians(state.axes.position).tolist(), strict=True))
    assert positions_of(DOG, state) == pytest.approx(expected)
    follower = Follower(window, DOG, KINEMATICS, states)
    follower.show(state)
    assert KINEMATICS is not None
    assert window.tip("T6") == pytest.approx(KINEMATICS.pose(6, expected).position)


def test_a_running_server_s_zeros_are_drawn_where_they_are_now() -> None:
    machine = load_machine("cartesian")
    state = msgspec.convert(required(struct_type(MachineStatus)), MachineStatus)
    states = SimpleNamespace(newest=lambda: None, silent_s=0.0)
    with open_window(machine, None) as window:
        follower = Follower(window, machine, None, states)  # type: ignore[arg-type]
        shown = []
        for offsets in (
            [],
            [WorkOffset("G54", {"0": 120.0})],
            [WorkOffset("G54", {"0": 100.0, "2": -5.0}), WorkOffset("G55", {"1": 7.0})],
            [WorkOffset("G55", {"1": 7.0})],
        ):
            follower.show(msgspec.structs.replace(state, work_offsets=offsets))
            shown.append({name: (1000.0 * at).round(6).tolist() for name, at in window.zeros.items()})
    machine_s = {"machine": [0.0, 0.0, 0.0]}
    assert shown == [
        {},
        {**machine_s, "G54": [120.0, 0.0, 0.0]},
        {**machine_s, "G54": [100.0, 0.0, -5.0], "G55": [0.0, 7.0, 0.0]},
        {**machine_s, "G55": [0.0, 7.0, 0.0]},
    ]


def test_where_nobody_listens_nobody_answers() -> None:
    with socket.socket() as reserved:
        reserved.bind(("127.0.0.1", 0))
        free = reserved.getsockname()[1]
        with pytest.raises(NobodyAnswers) as caught:
            LiveStates("robot-dog", f"tcp/127.0.0.1:{free}", timeout_s=0.2)
    assert caught.value.code == "MC530"


def test_the_command_serves_a_program_until_it_is_signalled_to_end() -> None:
    process = subprocess.Popen(
        [
            sys.executable,
            "-c",
            ENTRY,
            "view",
            str(ROOT / "examples" / "square.gcode"),
            "--port",
            "0",
            "--json",
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    try:
        assert process.stdout is not None
        answer = json.loads(process.stdout.readline())
        assert answer["ok"] is True
        with urlopen(answer["url"], timeout=LIMIT_S) as page:
            assert page.status == 200
        process.send_signal(signal.SIGTERM)
        rest, narration = process.communicate(timeout=LIMIT_S)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 0
    assert rest == b""
    assert answer["url"].encode() in narration


def test_a_program_with_a_fault_is_rejected_before_anything_is_shown(tmp_path: Path, capfd: Capture) -> None:
    (tmp_path / "bad.gcode").write_text("G01 XO\n")
    assert run_command_line(["view", str(tmp_path / "bad.gcode"), "--port", "0", "--json"]) == 4
    assert "MC101" in [each["code"] for each in json.loads(capfd.readouterr().out)["diagnostics"]]


@pytest.mark.parametrize(
    "arguments", [(), (str(ROOT / "examples" / "square.gcode"), "--connect", "tcp/[::1]:1")]
)
def test_either_a_program_or_a_server_has_to_be_named(arguments: tuple[str, ...], capfd: Capture) -> None:
    assert run_command_line(["view", *arguments, "--json"]) == 2
    assert json.loads(capfd.readouterr().out)["diagnostics"][0]["code"] == "MC017"


def test_where_nobody_answers_the_command_ends_with_5(capfd: Capture) -> None:
    with socket.socket() as reserved:
        reserved.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{reserved.getsockname()[1]}"
        assert run_command_line(["view", "--machine", "robot-dog", "--connect", endpoint]) == 5
    assert "MC530" in capfd.readouterr().err


def test_without_viser_the_command_names_the_extra() -> None:
    hidden = f"import sys; sys.modules['viser'] = None; {ENTRY}"
    answer = subprocess.run(
        [sys.executable, "-c", hidden, "view", str(ROOT / "examples" / "square.gcode")],
        capture_output=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "NO_COLOR": "1"},
        timeout=LIMIT_S,
        check=False,
    )
    assert answer.returncode == 3
    assert b"mcserver[view]" in answer.stderr
