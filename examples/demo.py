"""`make demo`: a server, a client, and a picture of the path really taken.

Starts ``mcserver run`` with simulated drives on a free loopback port, runs a program through ``mcctl run``,
records the telemetry meanwhile with the SDK, draws it, and stops the server. It shows the SDK's feeds, too.
"""

from __future__ import annotations

import argparse
import asyncio
import signal
import socket
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import msgspec
import numpy as np
from mcclient import Event, Feed, LineReport, Machine, MotionError, Samples
from rich.console import Console

from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.plot.figure import draw_png
from mcserver.plot.scene import Scene, build_scene
from mcserver.simulation.recorder import Recorded

NAME = "demo"
# a first start compiles the executor
START_LIMIT_S = 180.0
STOP_LIMIT_S = 20.0
# telemetry under way when the program has ended
LAST_SAMPLES_S = 0.3


async def main(program: Path, machine: str, output: Path) -> int:
    """The whole demonstration; gives the exit code of ``mcctl run``."""
    console = Console(stderr=True, highlight=False)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory() as folder:
        options = [
            "--machine",
            machine,
            "--name",
            NAME,
            "--listen",
            endpoint,
            "--journal",
            f"{folder}/journal.db",
        ]
        server = await start("mcserver", "run", *options)
        try:
            async with Machine.connect(NAME, endpoint, timeout_s=START_LIMIT_S) as connection:
                code, samples, lines = await run_and_record(connection, program, endpoint)
        finally:
            if server.returncode is None:
                server.send_signal(signal.SIGTERM)
            stopped = await asyncio.wait_for(server.wait(), STOP_LIMIT_S)
    if code or stopped:
        console.print(f"mcctl ended with {code}, mcserver with {stopped}")
        return code or 1
    output.parent.mkdir(parents=True, exist_ok=True)
    with output.open("wb") as stream:
        # telemetry is float32: enough for path and speed, too coarse for jerk
        draw_png(scene_of(program, machine, samples, lines), stream, axes=False)
    console.print(f"the path really taken: {output}")
    return 0


async def run_and_record(
    machine: Machine, program: Path, endpoint: str
) -> tuple[int, list[Samples], list[LineReport]]:
    """Runs the program by ``mcctl run`` and gives its exit code, every cycle, and each line's times."""
    samples: list[Samples] = []
    lines: list[LineReport] = []
    recording = [
        asyncio.create_task(keep_samples(machine.samples(), samples)),
        asyncio.create_task(keep_lines(machine.events(), lines)),
    ]
    client = await start("mcctl", "run", str(program), "--machine", NAME, "--connect", endpoint)
    code = await client.wait()
    await asyncio.sleep(LAST_SAMPLES_S)
    for task in recording:
        task.cancel()
    await asyncio.gather(*recording, return_exceptions=True)
    return code, samples, lines


async def keep_samples(feed: Feed[Samples], kept: list[Samples]) -> None:
    """Every cycle of every axis."""
    async with feed:
        async for block in feed:
            kept.append(block)


async def keep_lines(feed: Feed[Event], kept: list[LineReport]) -> None:
    """The reports of lines as they end."""
    async with feed:
        async for event in feed:
            kept.extend(event.lines)


def scene_of(program: Path, machine: str, samples: list[Samples], lines: list[LineReport]) -> Scene:
    """The recorded run from its first line on, to be drawn."""
    begin = min((line.start_s for line in lines), default=0.0)
    time = np.concatenate([block.time_s for block in samples]) - begin
    running = time >= 0.0
    number = np.zeros(len(time))
    for line in lines:
        number[(time >= line.start_s - begin) & (time <= line.end_s - begin)] = line.line
    recorded = Recorded(
        time_s=time[running],
        line=number[running],
        axes=np.asarray(samples[0].axes, dtype=float),
        setpoint=np.concatenate([block.setpoint for block in samples])[running],
        actual=np.concatenate([block.actual for block in samples])[running],
    )
    report = {
        "duration_s": max((line.end_s for line in lines), default=begin) - begin,
        "feed_length_mm": 0.0,
        "lines": [
            {**asdict(line), "start_s": line.start_s - begin, "end_s": line.end_s - begin} for line in lines
        ],
    }
    described = load_machine(machine)
    missed = round(float(np.ptp(recorded.time_s)) / described.cycle_s) + 1 - len(recorded.time_s)
    title = f"{program}: as the encoders saw it"
    if missed > 0:
        # motion waits on its path meanwhile, which shows as a dip of the speed
        title += f", {missed} cycle{'s' * (missed != 1)} late: the dips of speed are theirs"
    source = program.read_text("utf-8").splitlines()
    scene = build_scene(title, described, recorded, report, source, build_kinematics(described))
    steps = [np.diff(path.setpoint, axis=0) for path in scene.paths]
    travelled = sum(float(np.linalg.norm(step, axis=1).sum()) for step in steps)
    return msgspec.structs.replace(scene, feed_length_mm=travelled)


async def start(command: str, *arguments: str) -> asyncio.subprocess.Process:
    """A command that is installed beside this Python."""
    beside = Path(sys.executable).with_name(command)
    return await asyncio.create_subprocess_exec(beside, *arguments, stdin=asyncio.subprocess.DEVNULL)


def free_port() -> int:
    """A loopback port that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description="Run a program on a server with simulated drives, and draw its path."
    )
    parser.add_argument("program", type=Path)
    parser.add_argument("--machine", default="cartesian")
    parser.add_argument("--output", type=Path, default=Path("out/demo.png"))
    chosen = parser.parse_args()
    try:
        sys.exit(asyncio.run(main(chosen.program, chosen.machine, chosen.output)))
    except MotionError as error:
        sys.exit(f"error[{error.code}]: {error}")
