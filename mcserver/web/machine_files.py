"""What a machine's page loads besides the page: looks of the machine and of programs, and recordings."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

from fastapi import FastAPI, HTTPException, Request, Response
from fastapi.responses import FileResponse, StreamingResponse
from mcclient import MotionError

from mcserver.errors import ServiceError
from mcserver.web.camera import camera_picture
from mcserver.web.fleet import Fleet
from mcserver.web.frame import language_of
from mcserver.web.link import MachineLink
from mcserver.web.robot_model import fetch_model
from mcserver.web.sessions import COOKIE, Sessions
from mcserver.web.thumbnails import Thumbnail
from mcserver.web.translation import t_in

# A plot is a page of its own with scripts of its own; it must not act for who is logged in.
PLOT_HEADERS = {"Content-Security-Policy": "sandbox allow-scripts allow-downloads"}


def add_machine_files(site: FastAPI, sessions: Sessions, fleet: Fleet) -> None:
    """Serve ``/machine/{name}/model``, ``…/camera``, ``…/recordings/…`` and pictures of programs.

    To who is logged in alone.
    """
    # one at a time: a mesh of many megabytes is read and converted once, not by every viewer
    fetching = asyncio.Lock()

    def opened(request: Request, name: str) -> MachineLink:
        if sessions.visitor(request.cookies.get(COOKIE, "")) is None:
            raise HTTPException(403, "log in")
        link = fleet.opened(name)
        if link is None:
            raise HTTPException(404, "this machine's page is not open")
        return link

    @site.get("/machine/{name}/model")
    async def model(request: Request, name: str) -> Response:
        link = opened(request, name)
        try:
            async with fetching:
                content = await fetch_model(link.connected(), link.store.folder / ".model")
        except MotionError as error:
            return _refusal(request, error)
        return Response(content, media_type="application/json", headers={"Cache-Control": "no-store"})

    @site.get("/machine/{name}/camera")
    async def camera(request: Request, name: str) -> Response:
        link = opened(request, name)
        try:
            kind, content = await camera_picture(link)
        except MotionError as error:
            return _refusal(request, error)
        return Response(content, media_type=kind, headers={"Cache-Control": "no-store"})

    @site.get("/machine/{name}/programs/{program:path}/picture")
    async def picture_of_program(request: Request, name: str, program: str) -> Response:
        link = opened(request, name)
        try:
            return _picture(await asyncio.to_thread(link.store.thumbnail, program))
        except ServiceError as error:
            return _refusal(request, error, 404)

    @site.get("/machine/{name}/jobs/{number}/picture")
    async def picture_of_job(request: Request, name: str, number: int) -> Response:
        link = opened(request, name)
        job = next((each for each in link.jobs.begun if each.number == number), None)
        return _picture(None if job is None else job.thumbnail)

    @site.get("/machine/{name}/recordings/{recording}/file")
    async def file(request: Request, name: str, recording: str) -> Response:
        link = opened(request, name)
        try:
            pieces = link.recorded.pieces(link.connected(), recording)
            # so that a recording that is not there is an answer of its own, not half of a file
            first = await anext(pieces, b"")
        except MotionError as error:
            return _refusal(request, error)

        async def whole() -> AsyncIterator[bytes]:
            yield first
            async for piece in pieces:
                yield piece

        headers = {"Content-Disposition": f'attachment; filename="{recording}.mcap"'}
        return StreamingResponse(whole(), media_type="application/octet-stream", headers=headers)

    @site.get("/machine/{name}/recordings/{recording}/plot")
    async def plot(request: Request, name: str, recording: str) -> Response:
        link = opened(request, name)
        try:
            path = await link.recorded.plot(link.connected(), recording)
        except MotionError as error:
            return _refusal(request, error)
        return FileResponse(path, media_type="text/html", headers=PLOT_HEADERS)


def _picture(found: Thumbnail | None) -> Response:
    """Return a program's picture; without one nothing, which no browser complains about."""
    headers = {"Cache-Control": "no-store"}
    if found is None:
        return Response(status_code=204, headers=headers)
    return Response(found.content, media_type=found.kind, headers=headers)


def _refusal(request: Request, error: MotionError | ServiceError, status: int = 503) -> Response:
    language = language_of(request)
    said = f"{t_in(language, error.message)} [{error.code}]\n= {t_in(language, error.hint)}\n"
    return Response(said, status, media_type="text/plain")
