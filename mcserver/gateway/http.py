"""A small HTTP/JSON interface with an OpenAPI description, for scripts, dashboards and other tools."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

import msgspec
from fastapi import Depends, FastAPI, Header, HTTPException, Path, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from mcclient.errors import MotionError, NobodyAnswers
from pydantic import BaseModel, ConfigDict, Field

from mcserver.gateway.session import GatewaySession, error_map
from mcserver.gateway.tokens import Principal
from mcserver.gateway.websocket import Sessions

MachineName = Annotated[str, Path(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,62}$")]
ProgramId = Annotated[str, Path(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,62}$")]
MAX_BODY_BYTES = 16 * 1024 * 1024
FORBIDDEN = frozenset({"MC072", "MC504"})
NOT_FOUND = frozenset({"MC501", "MC503", "MC530"})
BUSY = frozenset({"MC071", "MC508", "MC515"})


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class ErrorAnswer(BaseModel):
    """Every answer that is not a success."""

    code: str = Field(description="stable, such as MC505")
    message: str
    hint: str = ""
    details: dict[str, Any] = {}
    diagnostics: list[dict[str, Any]] = []


class TextBody(_Body):
    """A whole program."""

    text: str = Field(max_length=MAX_BODY_BYTES)


class OpenBody(_Body):
    """A new program."""

    name: str = Field("", max_length=200)
    axes: list[Annotated[int, Field(ge=0, le=63)]] | None = None
    on_disconnect: str = Field("finish", pattern="^(finish|stop)$")
    hold: bool = False


class LinesBody(_Body):
    """Lines ``first``, ``first + 1``, …; sent again they are never run again.

    ``rejections``: how many the caller has heard of; lines of before a rejection are refused.
    """

    first: int = Field(ge=1, le=2**53)
    lines: list[str] = Field(min_length=1, max_length=20_000)
    rejections: int | None = Field(None, ge=0, le=2**53)


class CloseBody(_Body):
    """``last``: the last line that was sent."""

    last: int | None = Field(None, ge=0, le=2**53)


class ProgramBody(_Body):
    """One program, or all of them."""

    program: str | None = Field(None, pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,62}$")


class OverrideBody(ProgramBody):
    """Feed override in %."""

    percent: float = Field(ge=0.0, le=200.0)


class EstopBody(_Body):
    """Why."""

    reason: str = Field("", max_length=200)


class HttpSessions:
    """A session for each token, since HTTP has no connection that could be one; made on first use."""

    def __init__(self, sessions: Sessions, connect: tuple[str, ...], config_file: Any) -> None:
        self._sessions = sessions
        self._connect = connect
        self._config_file = config_file
        self._by_principal: dict[Principal, GatewaySession] = {}
        # apart, so that no token waits for another one's connection
        self._opening: dict[Principal, asyncio.Lock] = {}

    async def session(self, authorization: str) -> GatewaySession:
        """The caller's session.

        Raises:
            HTTPException: 401 the token is missing or unknown. MotionError: MC530 no motion server.
        """
        principal = self._sessions.principal(authorization.partition(" ")[2].strip())
        if principal is None:
            raise HTTPException(401, headers={"WWW-Authenticate": "Bearer"})
        async with self._opening.setdefault(principal, asyncio.Lock()):
            session = self._by_principal.get(principal)
            if session is None:
                session = await GatewaySession.open(self._connect, self._config_file, principal)
                self._by_principal[principal] = session
        return session

    async def close(self) -> None:
        await asyncio.gather(*(each.close() for each in self._by_principal.values()), return_exceptions=True)


async def _session(request: Request, authorization: Annotated[str, Header()] = "") -> GatewaySession:
    sessions: HttpSessions = request.app.state.http_sessions
    return await sessions.session(authorization)


Caller = Annotated[GatewaySession, Depends(_session)]


async def _call(caller: GatewaySession, machine: str, method: str, **fields: Any) -> dict[str, Any]:
    caller.admit(caller.requests_under_way)
    caller.requests_under_way += 1
    try:
        reply: dict[str, Any] = msgspec.msgpack.decode(await caller.call(machine, method, fields))
    finally:
        caller.requests_under_way -= 1
    return reply


def build_http(app: FastAPI, http: HttpSessions) -> None:
    """Add the routes under ``/v1`` to an application."""
    errors: dict[int | str, dict[str, Any]] = {
        status: {"model": ErrorAnswer} for status in (400, 401, 403, 404, 409, 413, 429, 503)
    }

    app.state.http_sessions = http

    @app.exception_handler(MotionError)
    async def refused(_: Request, error: MotionError) -> JSONResponse:
        return JSONResponse(msgspec.to_builtins(error_map(error)), status_of(error))

    @app.exception_handler(RequestValidationError)
    async def invalid(_: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        where = ".".join(str(each) for each in first["loc"])
        answer = ErrorAnswer(code="MC500", message=f"{where}: {first['msg']}", hint="see /openapi.json")
        return JSONResponse(answer.model_dump(), 400)

    @app.exception_handler(HTTPException)
    async def failed(_: Request, error: HTTPException) -> JSONResponse:
        answer = ErrorAnswer(code="MC072", message=str(error.detail), hint="give Authorization: Bearer TOKEN")
        return JSONResponse(answer.model_dump(), error.status_code, dict(error.headers or {}))

    @app.get("/v1/machines", responses=errors)
    async def machines(caller: Caller) -> list[str]:
        """Names of the machines that are there."""
        return await caller.machine_names()

    @app.get("/v1/machines/{machine}/info", responses=errors)
    async def info(caller: Caller, machine: MachineName) -> dict[str, Any]:
        """Axes, limits, tools, units."""
        return await _call(caller, machine, "info")

    @app.get("/v1/machines/{machine}/status", responses=errors)
    async def status(caller: Caller, machine: MachineName) -> dict[str, Any]:
        """The whole machine now."""
        return await _call(caller, machine, "status")

    @app.get("/v1/machines/{machine}/programs", responses=errors)
    async def programs(caller: Caller, machine: MachineName) -> dict[str, Any]:
        """Programs that run, wait or have ended, the newest first."""
        return await _call(caller, machine, "programs")

    @app.post("/v1/machines/{machine}/check", responses=errors)
    async def check(caller: Caller, machine: MachineName, body: TextBody) -> dict[str, Any]:
        """Every fault of a program; nothing runs."""
        return await _call(caller, machine, "check", text=body.text)

    @app.post("/v1/machines/{machine}/simulate", responses=errors)
    async def simulate(caller: Caller, machine: MachineName, body: TextBody) -> dict[str, Any]:
        """The object of ``mcserver simulate --json``."""
        return await _call(caller, machine, "simulate", text=body.text)

    @app.post("/v1/machines/{machine}/programs", responses=errors)
    async def open_program(caller: Caller, machine: MachineName, body: OpenBody) -> dict[str, Any]:
        """Open a program of this token."""
        return await _call(caller, machine, "open", **body.model_dump())

    @app.post("/v1/machines/{machine}/programs/{program}/lines", responses=errors)
    async def submit(
        caller: Caller, machine: MachineName, program: ProgramId, body: LinesBody
    ) -> dict[str, Any]:
        """Send lines."""
        return await _call(caller, machine, "submit", program=program, **body.model_dump())

    @app.post("/v1/machines/{machine}/programs/{program}/close", responses=errors)
    async def close(
        caller: Caller, machine: MachineName, program: ProgramId, body: CloseBody
    ) -> dict[str, Any]:
        """No more lines will come."""
        return await _call(caller, machine, "close", program=program, last=body.last)

    for order, text in (
        ("hold", "Feed hold along the path."),
        ("resume", "Ends a hold, M00 or M01."),
        ("abort", "Stops along the path and drop the rest."),
    ):
        _add_order(app, order, text, errors)

    @app.post("/v1/machines/{machine}/override", responses=errors)
    async def override(caller: Caller, machine: MachineName, body: OverrideBody) -> dict[str, Any]:
        """Feed override of one program or all."""
        return await _call(caller, machine, "override", **body.model_dump())

    @app.post("/v1/machines/{machine}/reset", responses=errors)
    async def reset(caller: Caller, machine: MachineName) -> dict[str, Any]:
        """Clear latched faults and the emergency stop."""
        return await _call(caller, machine, "reset")

    @app.post("/v1/machines/{machine}/estop", responses=errors)
    async def estop(caller: Caller, machine: MachineName, body: EstopBody) -> dict[str, Any]:
        """Emergency stop; answers once the server has confirmed it. No safety function."""
        await caller.emergency_stop(machine, body.reason)
        return {"ok": True}


def _add_order(app: FastAPI, order: str, text: str, errors: dict[int | str, dict[str, Any]]) -> None:
    async def give(caller: Caller, machine: MachineName, body: ProgramBody) -> dict[str, Any]:
        return await _call(caller, machine, order, program=body.program)

    app.post(f"/v1/machines/{{machine}}/{order}", responses=errors, name=order, description=text)(give)


def status_of(error: MotionError) -> int:
    """The HTTP status of a refusal."""
    if error.code in FORBIDDEN:
        return 403
    if error.code in NOT_FOUND:
        return 404
    if error.code in BUSY:
        return 429
    if isinstance(error, NobodyAnswers):
        return 503
    return 400 if error.code in ("MC500", "MC506", "MC507", "MC511", "MC513", "MC537") else 409
