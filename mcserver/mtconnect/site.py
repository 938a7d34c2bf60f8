"""The agent's process: states of all machines into its buffer, and HTTP for whoever reads it."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import socket
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
from mcclient import MachineStatus, MotionError
from mcclient.fleet import FleetLink, keep_states
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route

from mcserver.doors.limits import BodyLimit, DoorLimits
from mcserver.doors.listening import LOOPBACK, Address, listen, refuse_foreign_hosts, serve_until_stopped
from mcserver.mtconnect.agent import Agent, Refusal, interval_of

XML = "text/xml"


class AgentOptions(msgspec.Struct, frozen=True):
    """How the agent is served.

    Attributes:
        connect: Zenoh endpoints; empty: this computer. config_file: a Zenoh configuration for TLS.
        rate_hz: states a second.
    """

    address: Address
    connect: tuple[str, ...] = ()
    config_file: Path | None = None
    rate_hz: float = 10.0


async def serve(options: AgentOptions) -> None:
    """Serve until SIGTERM or SIGINT.

    Raises:
        ServiceError: MC065 the address cannot be listened on.
    """
    agent = Agent(socket.gethostname())

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        collecting = asyncio.ensure_future(collect(agent, options))
        yield
        collecting.cancel()
        await asyncio.gather(collecting, return_exceptions=True)

    listener = listen(options.address.host, options.address.port)
    await serve_until_stopped(
        build_app(agent, lifespan=lifespan, local=options.address.host in LOOPBACK),
        listener,
        options.address,
        # nothing is sent here
        limits=DoorLimits(body=BodyLimit(1024, 5.0)),
        holder_of=lambda _: "",
        max_frame_bytes=1024,
    )


async def collect(agent: Agent, options: AgentOptions) -> None:
    """Ask all machines for their states, again and again, until it is cancelled."""

    async def see(link: FleetLink, found: Mapping[str, MachineStatus]) -> None:
        await look(agent, link, found)

    def lost(_: MotionError) -> None:
        for name in agent.devices:
            agent.see(name, None)

    period_s = 1.0 / options.rate_hz
    await keep_states(see, lost, period_s=period_s, connect=options.connect, config_file=options.config_file)


async def look(agent: Agent, link: FleetLink, found: Mapping[str, MachineStatus]) -> None:
    """Show the agent all states, and ask machines that it does not know for their axes."""
    for name, status in found.items():
        if agent.wants(name, status.instance):
            with contextlib.suppress(MotionError):
                agent.add(await link.info(name))
    for name in agent.devices:
        agent.see(name, found.get(name))


def build_app(agent: Agent, *, lifespan: object = None, local: bool = True) -> Starlette:
    """Return the application: ``probe``, ``current``, ``sample``, ``assets``, each also below a device."""

    async def probe(request: Request) -> Response:
        return Response(agent.probe(request.path_params.get("device")), media_type=XML)

    async def assets(_: Request) -> Response:
        return Response(agent.assets(), media_type=XML)

    async def asset(request: Request) -> Response:
        raise Refusal("ASSET_NOT_FOUND", f"there is no asset {request.path_params['asset']}", 404)

    async def read(request: Request) -> Response:
        device, query = request.path_params.get("device"), request.query_params
        interval = interval_of(query)
        method = request.url.path.rpartition("/")[2]
        first = agent.current(device, query) if method == "current" else agent.sample(device, query)[0]
        if interval is None:
            return Response(first, media_type=XML)
        if "at" in query:
            raise Refusal("INVALID_REQUEST", "at: not with an interval")
        boundary = secrets.token_hex(16)
        parts = multipart(agent.stream(method, device, query, interval), boundary)
        return StreamingResponse(parts, media_type=f"multipart/x-mixed-replace;boundary={boundary}")

    async def refuse(_: Request, error: Exception) -> Response:
        assert isinstance(error, Refusal)
        return Response(agent.refusal(error), error.status, media_type=XML)

    async def unknown(_: Request, error: Exception) -> Response:
        status = getattr(error, "status_code", 404)
        text = "probe, current, sample and assets can be asked for, by GET"
        refusal = Refusal("UNSUPPORTED" if status == 405 else "INVALID_URI", text, status)
        return Response(agent.refusal(refusal), status, media_type=XML)

    methods = (("probe", probe), ("current", read), ("sample", read), ("assets", assets), ("asset", assets))
    routes = [Route("/", probe)]
    for name, answer in methods:
        routes += [Route(f"/{name}", answer), Route(f"/{{device}}/{name}", answer)]
    routes += [Route("/asset/{asset}", asset), Route("/assets/{asset}", asset), Route("/{device}", probe)]
    app = Starlette(
        routes=routes,
        exception_handlers={Refusal: refuse, 404: unknown, 405: unknown},
        lifespan=lifespan,  # type: ignore[arg-type]
    )
    if local:
        refuse_foreign_hosts(app)
    return app


async def multipart(documents: AsyncIterator[bytes], boundary: str) -> AsyncIterator[bytes]:
    """Yield each document as a part (RFC 2046), with its length."""
    async for document in documents:
        head = f"--{boundary}\r\nContent-type: {XML}\r\nContent-length: {len(document)}\r\n\r\n"
        yield head.encode() + document + b"\r\n"
