"""What a machine's page loads besides the page: what the machine looks like, and its recordings."""

from __future__ import annotations

import asyncio

from fastapi import FastAPI, Request, Response
from mcclient import MotionError

from mcserver.web.fleet import Fleet
from mcserver.web.robot_model import fetch_model
from mcserver.web.sessions import COOKIE, Sessions


def add_machine_files(site: FastAPI, sessions: Sessions, fleet: Fleet) -> None:
    """Serve ``/machine/{name}/model`` to who is logged in."""
    # one at a time: a mesh of many megabytes is read and converted once, not by every viewer
    fetching = asyncio.Lock()

    @site.get("/machine/{name}/model")
    async def model(request: Request, name: str) -> Response:
        if sessions.visitor(request.cookies.get(COOKIE, "")) is None:
            return Response("log in", 403)
        link = fleet.opened(name)
        if link is None:
            return Response("this machine's page is not open", 404)
        try:
            async with fetching:
                content = await fetch_model(link.connected(), link.store.folder / ".model")
        except MotionError as error:
            return Response(f"{error.message} [{error.code}]", 503)
        return Response(content, media_type="application/json", headers={"Cache-Control": "no-store"})
