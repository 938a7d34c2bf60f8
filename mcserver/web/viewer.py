"""The page of ``mcserver view``: one run, played in space to whoever opens it."""

from __future__ import annotations

import html

import numpy as np
from fastapi import Response
from nicegui import ui

from mcserver.doors.limits import DoorLimits
from mcserver.doors.listening import LOOPBACK, Address, listen, serve_until_stopped
from mcserver.machine.machine_file import Machine
from mcserver.net.model_methods import look
from mcserver.units import AxisType
from mcserver.view.gantry import gantry_space
from mcserver.view.stage import Up
from mcserver.web.frame import MAX_FRAME_BYTES, add_head, new_site, run_pages
from mcserver.web.panels.replay import Player
from mcserver.web.replay_format import Replay
from mcserver.web.robot_model import model_json, portal_json

MM_PER_M = 1000.0


def model_of(machine: Machine, replay: Replay, up: Up) -> tuple[bytes, list[str]]:
    """Return what a machine looks like, for static/space.js, and the names of meshes that are not there.

    Raises:
        Refused: MC587 its URDF cannot be read.
    """
    found, paths = look(machine)
    if found.urdf:
        named = {mesh.name: path for mesh, path in zip(found.meshes, paths, strict=True)}
        meshes = {name: path for name, path in named.items() if path is not None}
        joints = {int(axis): name for axis, name in found.joints.items()}
        content = model_json(found.urdf, joints, meshes, machine.tools, up)
        return content, [name for name, path in named.items() if path is None]
    axes = [axis.index for axis in machine.axes if axis.index < 3 and axis.type is AxisType.LINEAR]
    if not axes:
        return model_json("", {}, {}, (), up), []
    return portal_json(axes, *gantry_space(np.array(replay.tips[0].points) / MM_PER_M), up), []


async def serve_view(name: str, replay: Replay, model: bytes, address: Address) -> None:
    """Serve until SIGTERM or SIGINT; it plays from its start for each who opens it.

    Raises:
        ServiceError: MC065 the address cannot be listened on.
    """
    site = new_site(local=address.host in LOOPBACK)

    @site.get("/model")
    def parts() -> Response:
        return Response(model, media_type="application/json", headers={"Cache-Control": "no-store"})

    @ui.page("/", title=name)
    def page() -> None:
        add_head()
        with ui.column().classes("w-full"):
            ui.html(f'<h1 class="text-xl">{html.escape(name)}</h1>', sanitize=False)
            player = Player(name, replay, "/model", playing=True)
        ui.context.client.on_delete(player.close)

    run_pages(site, name)
    listener = listen(address.host, address.port)
    await serve_until_stopped(
        site,
        listener,
        address,
        limits=DoorLimits(bodies=()),
        holder_of=lambda _: "",
        max_frame_bytes=MAX_FRAME_BYTES,
    )
