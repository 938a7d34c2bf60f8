"""``mcctl record dataset``: recordings as a data set of LeRobot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from mcclient.cli.options import JsonOption
from mcclient.cli.output import errors_shown, say, write_json
from mcclient.errors import RequestRefused
from mcclient.lerobot_dataset import DatasetWriter, feature_of, read_frames


def dataset(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Where to; it is not there yet.")],
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Recordings, .npz or .parquet: an episode each.")
    ],
    task: Annotated[str, typer.Option("--task", "-t", help="What is done in them, in words.")],
    fps: Annotated[int, typer.Option("--fps", min=1, max=1000, help="Frames a second.")] = 30,
    robot: Annotated[
        str, typer.Option("--robot", metavar="TYPE", help="Type of the robot, as LeRobot has it.")
    ] = "mcserver",
    json: JsonOption = False,
) -> None:
    """Write recordings as a data set of LeRobot (v3.0): states and actions of the axes, in mm and deg."""

    with errors_shown(json):
        try:
            found = _write(folder, files, task, fps, robot)
        except OSError as error:
            raise RequestRefused("MC511", f"{folder} cannot be written: {error}", "choose another") from error
    if json:
        write_json(found)
    else:
        say(f"{found['folder']}: {found['episodes']} episodes, {found['frames']} frames at {fps} a second")


def _write(folder: Path, files: Sequence[Path], task: str, fps: int, robot: str) -> dict[str, Any]:
    first = read_frames(files[0], fps)
    writer = DatasetWriter(folder, fps=fps, names=[feature_of(axis) for axis in first.axes], robot=robot)
    frames = 0
    try:
        for file in files:
            read = read_frames(file, fps)
            if read.axes != first.axes:
                raise RequestRefused(
                    "MC511", f"{file} has other axes than {files[0]}", "record the same ones"
                )
            writer.append(read, task)
            frames += len(read.state)
        writer.finish()
    finally:
        writer.close()
    return {"ok": True, "folder": str(folder), "episodes": len(files), "frames": frames}
