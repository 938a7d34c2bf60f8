"""The page's process: pages, login and metrics on one ASGI application, served until it is stopped."""

from __future__ import annotations

import asyncio
import html
import re
import time
from collections.abc import Callable
from pathlib import Path
from urllib.parse import parse_qs, quote

import msgspec
from fastapi import FastAPI, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from mcclient import MotionError
from mcclient.keys import live_key
from nicegui import ui

from mcserver.doors.limits import BodyLimit, DoorLimits
from mcserver.doors.listening import LOOPBACK, Address, Protection, listen, serve_until_stopped
from mcserver.web.fleet import Fleet
from mcserver.web.fleet_page import FleetFilter, FleetPage
from mcserver.web.frame import MAX_FRAME_BYTES, STATIC, add_head, language_of, new_site, run_pages
from mcserver.web.link import MachineLink
from mcserver.web.machine_files import add_machine_files
from mcserver.web.machine_page import MachinePage
from mcserver.web.metrics import metrics_text
from mcserver.web.past import Past
from mcserver.web.sessions import COOKIE, Sessions, Visitor
from mcserver.web.store import MAX_PROGRAM_BYTES
from mcserver.web.translation import mark, t, t_in
from mcserver.web.users import read_users

# a form; the page's own small messages; a program that is uploaded
LIMITS = DoorLimits(
    bodies=(
        ("/login", BodyLimit(4096, 10.0)),
        ("/logout", BodyLimit(4096, 10.0)),
        ("/_nicegui/client/", BodyLimit(MAX_PROGRAM_BYTES + 1024 * 1024, 600.0)),
    )
)
# of login.html
LOGIN_TEXTS = (mark("Log in"), mark("Motion server"), mark("Name"), mark("Password"))
# how often a page of an unknown machine looks whether it is there by now
SEEN_S = 1.0
# what a proxy adds
_PROXIED = frozenset({"x-forwarded-for", "x-forwarded-host", "forwarded", "x-real-ip"})


class WebOptions(msgspec.Struct, frozen=True):
    """How the page is served.

    Attributes:
        connect: Zenoh endpoints; empty: this computer. config_file: a Zenoh configuration for TLS.
        users: the password file; None: loopback only, no login. folder: uploaded programs.
        history: the folder of ``mcserver history``; None: the page shows none.
    """

    address: Address
    folder: Path
    connect: tuple[str, ...] = ()
    config_file: Path | None = None
    users: Path | None = None
    history: Path | None = None


PROTECTION = Protection(
    "MC064",
    "the page",
    "passwords",
    "make a password file with mcserver web --add-user NAME, and give it with --users",
)


async def serve(options: WebOptions) -> None:
    """Serve until SIGTERM or SIGINT.

    Raises:
        ConfigurationError: MC060 the password file, MC064 an address that others reach without a login, TLS.
        ServiceError: MC065 the address cannot be listened on.
    """
    users = None if options.users is None else read_users(options.users, time.monotonic)
    address = options.address
    PROTECTION.require(address, has_secrets=users is not None)
    sessions = Sessions(users, time.monotonic)
    past = None if options.history is None else Past(options.history)
    fleet = Fleet(options.connect, options.config_file, options.folder, past)
    site = build_site(sessions, fleet, secure=address.certificate is not None)
    listener = listen(address.host, address.port)
    fleet.start()
    try:
        await serve_until_stopped(
            site,
            listener,
            address,
            limits=LIMITS,
            holder_of=sessions.holder,
            max_frame_bytes=MAX_FRAME_BYTES,
        )
    finally:
        await fleet.close()


def build_site(sessions: Sessions, fleet: Fleet, *, secure: bool) -> FastAPI:
    """The application: ``/`` the fleet, ``/machine/{name}`` and its ``/drives``, ``/login``, ``/metrics``."""
    site = new_site(local=not sessions.needs_login)

    @site.get("/login", response_class=HTMLResponse)
    def login_form(request: Request, then: str = "/") -> str:
        return _login_page(request, "", then)

    @site.post("/login")
    async def log_in(request: Request) -> Response:
        fields = parse_qs((await request.body()).decode("utf-8", "replace"))
        name, password, then = (fields.get(key, [""])[0] for key in ("name", "password", "then"))
        address = request.client.host if request.client is not None else ""
        token = await asyncio.to_thread(sessions.log_in, name, password, address)
        if token is None:
            return HTMLResponse(
                _login_page(
                    request, mark("Wrong name or password, or too many tries: wait half a minute."), then
                ),
                401,
            )
        response = RedirectResponse(_inside(then), 303)
        # a proxy that ends TLS says so, the first of several; whoever else says it makes the cookie no weaker
        outermost = request.headers.get("x-forwarded-proto", "").partition(",")[0]
        tls = secure or outermost.strip().lower() == "https"
        response.set_cookie(COOKIE, token, httponly=True, samesite="strict", secure=tls)
        return response

    @site.post("/logout")
    def log_out(request: Request) -> Response:
        sessions.log_out(request.cookies.get(COOKIE, ""))
        return RedirectResponse("/login", 303)

    @site.get("/metrics")
    def metrics(request: Request) -> Response:
        if sessions.visitor(request.cookies.get(COOKIE, "")) is None and not _from_here(request):
            return Response("log in, or scrape from this computer", 403)
        return Response(metrics_text(fleet), media_type="text/plain; version=0.0.4")

    @ui.page("/", title="Machines")
    def fleet_page(request: Request) -> Response | None:
        visitor = _visitor(sessions, request)
        if visitor is None:
            return _to_login(request)
        add_head()
        ui.page_title(t("Machines"))
        FleetPage(visitor, fleet, FleetFilter.of(request.query_params))
        return None

    @ui.page("/machine/{name}", title="Machine")
    def machine_page(request: Request, name: str) -> Response | None:
        return looked_at(request, name, lambda visitor, link: MachinePage(visitor, link, fleet.past))

    @ui.page("/machine/{name}/drives", title="Drives")
    def desk_page(request: Request, name: str) -> Response | None:
        def build(visitor: Visitor, link: MachineLink) -> None:
            # NiceGUI looks at every object of the process as it starts, which one of canopen's does not bear
            from mcserver.web.desk_page import DeskPage

            DeskPage(visitor, link)

        return looked_at(request, name, build)

    def looked_at(
        request: Request, name: str, build: Callable[[Visitor, MachineLink], object]
    ) -> Response | None:
        """Build a page of a machine, which says why where that cannot be looked at; or send to the login."""
        visitor = _visitor(sessions, request)
        if visitor is None:
            return _to_login(request)
        add_head()
        ui.page_title(name)
        try:
            live_key(name)
            link = fleet.link(name, visitor.name)
        except MotionError as error:
            ui.label(f"{t(error.message)}: {t(error.hint)}")
        else:
            build(visitor, link)
            return None
        if not fleet.knows(name):
            # this process may have begun a moment ago, or the machine comes later
            ui.timer(SEEN_S, lambda: ui.navigate.reload() if fleet.knows(name) else None)
        return None

    add_machine_files(site, sessions, fleet)
    run_pages(site, "Machines")
    return site


def _visitor(sessions: Sessions, request: Request) -> Visitor | None:
    return sessions.visitor(request.cookies.get(COOKIE, ""))


def _to_login(request: Request) -> Response:
    """Return the way to the login, and from there to what was asked for."""
    wanted = request.url.path + (f"?{request.url.query}" if request.url.query else "")
    return RedirectResponse(f"/login?then={quote(wanted)}", 303)


def _from_here(request: Request) -> bool:
    """Whether a request comes from this computer itself: not by a proxy, nor by a page of another site."""
    near = request.client is not None and request.client.host in LOOPBACK
    named = request.url.hostname in LOOPBACK
    return near and named and not any(name in request.headers for name in _PROXIED)


def _inside(path: str) -> str:
    """Return a path of this site; ``/`` for anything else."""
    # what an address has; browsers take a backslash for a slash
    return path if re.fullmatch(r"/[!-\[\]-~]*", path) and not path.startswith("//") else "/"


def _login_page(request: Request, message: str, then: str) -> str:
    language = language_of(request)
    alert = f'<p role="alert">{html.escape(t_in(language, message))}</p>' if message else ""
    page = (STATIC / "login.html").read_text("utf-8")
    for text in LOGIN_TEXTS:
        page = page.replace(f">{text}<", f">{t_in(language, text)}<")
    hidden = f'<input type="hidden" name="then" value="{html.escape(_inside(then))}">'
    page = page.replace('lang="en"', f'lang="{language}"')
    return page.replace("<!-- message -->", alert).replace("<!-- then -->", hidden)
