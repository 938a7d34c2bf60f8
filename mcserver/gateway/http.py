"""HTTP and JSON for scripts and dashboards: a route for each method of the table, and its description."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

import msgspec
from fastapi import Depends, FastAPI, Header, HTTPException, Path, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.openapi.utils import get_openapi
from mcclient.errors import MotionError, NobodyAnswers, RequestRefused
from starlette.exceptions import HTTPException as StarletteHTTPException

from mcserver.gateway.session import GatewaySession, error_map
from mcserver.gateway.tokens import Principal
from mcserver.gateway.websocket import Sessions
from mcserver.net.decoding import refusal_of
from mcserver.net.messages import ErrorReply
from mcserver.net.messages import Request as Message
from mcserver.net.method_table import METHODS, Method

MachineName = Annotated[str, Path(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,62}$")]
MAX_BODY_BYTES = 16 * 1024 * 1024
FORBIDDEN = frozenset({"MC072", "MC504"})
NOT_FOUND = frozenset({"MC501", "MC503", "MC530"})
BUSY = frozenset({"MC071", "MC508", "MC515"})
BAD_REQUEST = frozenset({"MC500", "MC506", "MC507", "MC511", "MC513", "MC537"})
REFUSALS = (400, 401, 403, 404, 409, 413, 429, 503)
_REFERENCE = "#/components/schemas/{name}"
# what the gateway says itself: who asks, and the number of the request
_OWN_FIELDS = frozenset({"client", "request"})


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
        """Return the caller's session.

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


async def _call(caller: GatewaySession, machine: str, method: str, fields: dict[str, Any]) -> bytes:
    """Call a method of a machine; return its reply as JSON."""
    caller.admit(caller.requests_under_way)
    caller.requests_under_way += 1
    try:
        reply = await caller.call(machine, method, fields)
    finally:
        caller.requests_under_way -= 1
    return msgspec.json.encode(msgspec.msgpack.decode(reply))


def _fields_of(message: type[Message], body: bytes) -> dict[str, Any]:
    """Return the fields of a message that a body holds as JSON.

    Raises:
        RequestRefused: MC500 it is no such message, or has a field that the message lacks; MC511.
    """
    try:
        given = msgspec.json.decode(body or b"{}", type=dict[str, Any])
        value = msgspec.json.decode(body or b"{}", type=message)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RequestRefused(*refusal_of(message, str(error))) from error
    # a field that is misspelt must not mean its default, such as every program
    unknown = given.keys() - set(message.__struct_fields__) | given.keys() & _OWN_FIELDS
    if unknown:
        raise RequestRefused("MC500", f"there is no field {sorted(unknown)[0]!r}", "see /openapi.json")
    fields = msgspec.to_builtins(value, builtin_types=(bytes,))
    return {name: fields[name] for name in given}


def build_http(app: FastAPI, http: HttpSessions) -> None:
    """Add the routes under ``/v1`` to an application: one for each method of the table."""
    app.state.http_sessions = http

    @app.exception_handler(MotionError)
    async def refused(_: Request, error: MotionError) -> Response:
        return _answer(status_of(error), error_map(error))

    @app.exception_handler(RequestValidationError)
    async def invalid(_: Request, error: RequestValidationError) -> Response:
        first = error.errors()[0]
        where = ".".join(str(each) for each in first["loc"])
        return _answer(400, ErrorReply("MC500", f"{where}: {first['msg']}", "see /openapi.json"))

    # of the router, which finds no route, too
    @app.exception_handler(StarletteHTTPException)
    async def failed(_: Request, error: StarletteHTTPException) -> Response:
        reply = ErrorReply("MC501", error.detail, "/openapi.json describes the routes that there are")
        if error.status_code == 401:
            reply = ErrorReply("MC072", error.detail, "give Authorization: Bearer TOKEN")
        return _answer(error.status_code, reply, dict(error.headers or {}))

    @app.get("/v1/machines")
    async def machines(caller: Caller) -> list[str]:
        """Names of the machines that are there."""
        return await caller.machine_names()

    schemas = _Schemas(app)
    for method in METHODS:
        schemas.add(method)
        _add_method(app, method)


def _add_method(app: FastAPI, method: Method) -> None:
    """Add the route of a method; one that changes nothing and needs no field is got, too."""

    async def post(caller: Caller, machine: MachineName, request: Request) -> Response:
        fields = _fields_of(method.request, await request.body())
        if method.name == "estop":
            # any role, beside all limits, and again until it is confirmed
            await caller.emergency_stop(machine, fields.get("reason", ""))
            return _json(b'{"ok":true}')
        return _json(await _call(caller, machine, method.name, fields))

    async def get(caller: Caller, machine: MachineName) -> Response:
        return _json(await _call(caller, machine, method.name, {}))

    path = f"/v1/machines/{{machine}}/{method.name}"
    description = _Schemas.description_of(method)
    app.post(path, name=method.name, description=method.doc, openapi_extra=description)(post)
    if _may_be_got(method):
        del description["requestBody"]
        app.get(path, name=method.name, description=method.doc, openapi_extra=description)(get)


def _may_be_got(method: Method) -> bool:
    return not method.changes and not any(field.required for field in msgspec.structs.fields(method.request))


class _Schemas:
    """Schemas of messages in an application's OpenAPI description, from their types."""

    def __init__(self, app: FastAPI) -> None:
        self._app = app
        self._messages: list[type[msgspec.Struct]] = [ErrorReply]
        app.openapi = self.describe  # type: ignore[method-assign]

    def add(self, method: Method) -> None:
        self._messages += [method.request, method.reply]

    @staticmethod
    def description_of(method: Method) -> dict[str, Any]:
        """Describe the body and the answers of a method's route."""
        return {
            "requestBody": {"content": _content(method.request.__name__)},
            "responses": {
                "200": {"description": "done", "content": _content(method.reply.__name__)},
                **{str(each): {"description": "", "content": _content("ErrorReply")} for each in REFUSALS},
            },
        }

    def describe(self) -> dict[str, Any]:
        """Return the description of all routes."""
        app = self._app
        if app.openapi_schema is None:
            _, components = msgspec.json.schema_components(self._messages, ref_template=_REFERENCE)
            for name in {each.__name__ for each in self._messages if issubclass(each, Message)}:
                for own in _OWN_FIELDS & components[name]["properties"].keys():
                    del components[name]["properties"][own]
            described = get_openapi(title=app.title, version=app.version, routes=app.routes)
            described.setdefault("components", {}).setdefault("schemas", {}).update(components)
            app.openapi_schema = described
        return app.openapi_schema


def _content(name: str) -> dict[str, Any]:
    return {"application/json": {"schema": {"$ref": _REFERENCE.format(name=name)}}}


def _json(body: bytes) -> Response:
    return Response(body, media_type="application/json")


def _answer(status: int, error: object, headers: dict[str, str] | None = None) -> Response:
    return Response(msgspec.json.encode(error), status, headers, "application/json")


def status_of(error: MotionError) -> int:
    """Return the HTTP status of a refusal."""
    if error.code in FORBIDDEN:
        return 403
    if error.code in NOT_FOUND:
        return 404
    if error.code in BUSY:
        return 429
    if isinstance(error, NobodyAnswers):
        return 503
    return 400 if error.code in BAD_REQUEST else 409
