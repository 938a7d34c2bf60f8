"""A machine's window, from its machine file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from mckinematics.solver import MachineKinematics

from mcserver.machine.machine_file import Machine
from mcserver.view.body_of import body_of
from mcserver.view.stage import stage, up_of
from mcserver.view.tracks import Track, portal_axes, tip_frames
from mcserver.view.window import Window


@contextmanager
def open_window(
    machine: Machine,
    kinematics: MachineKinematics | None,
    tracks: Sequence[Track] = (),
    *,
    host: str = "127.0.0.1",
    port: int = 0,
    up: str = "auto",
    package_roots: Sequence[Path] = (),
) -> Iterator[Window]:
    """A window that shows the machine where its drives start, until the block ends.

    Args:
        tracks: where its tips will go, so that all of it is seen.
        up: as in `mcserver.view.stage.up_of`. package_roots: folders in which meshes are looked for too.

    Raises:
        UsageFault: MC017 the address cannot be listened on.
    """
    start = {axis.index: axis.initial_position for axis in machine.axes}
    tips = tip_frames(machine, kinematics, start)
    first = np.array([start[axis] if axis in portal_axes(machine) else 0.0 for axis in range(3)])
    body = body_of(machine, kinematics, tracks, first, package_roots)
    chains = [] if kinematics is None else [kinematics.tool(tool).chain for tool in kinematics.tools]
    upwards = up_of(up, [tip[:3, 3] for tip in tips.values()], [chain.points[0] for chain in chains])
    points = [track.points for track in tracks] + [tip[None, :3, 3] for tip in tips.values()]
    standing = stage(body.parts, body.poses(start), points, upwards)
    window = Window(host, port, title=machine.name, body=body, standing=standing, tips=tuple(tips))
    try:
        window.place(start, tips)
        yield window
    finally:
        window.close()
