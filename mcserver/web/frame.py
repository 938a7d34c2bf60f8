"""What all pages are served with: headers, styles, scripts, and NiceGUI below one application."""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import cast

from fastapi import FastAPI, Request, Response
from nicegui import app as nicegui_app
from nicegui import ui
from nicegui.language import Language

from mcserver.doors.listening import refuse_foreign_hosts
from mcserver.web.resuming import forget_closed_pages, resume_after_cuts, take_events_once
from mcserver.web.translation import COOKIE as LANGUAGE_COOKIE
from mcserver.web.translation import language_for, mark, t

MAX_FRAME_BYTES = 4 * 1024 * 1024
# A page goes on as it is where its link was cut for less; NiceGUI gives a link up that has been silent for
# 0.4 of it. That the page is silent is shown long before (page.js).
RECONNECT_S = 30.0
# the page's framework makes scripts and styles as it goes; nothing comes from or goes to another site
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:;"
    " style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:;"
    " connect-src 'self' ws: wss: blob: data:; worker-src 'self' blob:; object-src 'none'; base-uri 'self';"
    " form-action 'self'; frame-ancestors 'none'",
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
}
STATIC = Path(__file__).parent / "static"
VERSION = hashlib.sha256(
    b"".join(path.read_bytes() for path in sorted(STATIC.iterdir()) if path.suffix in (".css", ".js"))
).hexdigest()[:12]


# what scripts say by ``mcTexts``, and what styles say
BROWSER_TEXTS = (
    mark("Choose a file"),
    mark("loading"),
    mark("This browser draws no 3-D pictures (WebGL)."),
    mark("It is not certain that this arrived: {what}"),
    mark("close"),
    mark("Connecting …"),
    mark("No connection: what you write stays and is sent later; only stops can be pressed"),
)
STYLE_TEXTS = (mark(" – old: nothing comes"), mark(" (no link)"))


def new_site(*, local: bool) -> FastAPI:
    """Return an application without pages; ``local``: it is reached by names of this computer alone."""
    site = FastAPI(openapi_url=None)
    if local:
        refuse_foreign_hosts(site)

    @site.middleware("http")
    async def add_headers(request: Request, call_next: Callable[[Request], Awaitable[Response]]) -> Response:
        response = await call_next(request)
        response.headers.update(HEADERS)
        return response

    return site


def run_pages(site: FastAPI, title: str) -> None:
    """Have an application serve the pages that were declared with ``ui.page``."""
    nicegui_app.add_static_files("/mc-static", STATIC)
    take_events_once()
    forget_closed_pages()
    # its own history would send what was missed after what is new: `ResumingOutbox` has another one
    ui.run_with(
        site,
        title=title,
        dark=None,
        show_welcome_message=False,
        reconnect_timeout=RECONNECT_S,
        message_history_length=0,
    )


def add_head() -> None:
    """Give a page its language, colours, styles and scripts; before all else."""
    client = ui.context.client
    resume_after_cuts(client)
    client.on_connect(lambda: ui.run_javascript("mcLinked()"))
    # the page of a route is shared by all who look at it; NiceGUI takes the language of its own texts from it
    client.page = copy.copy(client.page)
    client.page.language = cast("Language", language_of(client.request))
    texts = json.dumps({text: t(text) for text in BROWSER_TEXTS}, ensure_ascii=False)
    ui.add_head_html(f"<script>window.mcTexts = {texts}</script>")
    silent, no_link = (json.dumps(t(text), ensure_ascii=False) for text in STYLE_TEXTS)
    ui.add_head_html(f"<style>:root {{ --mc-silent: {silent}; --mc-no-link: {no_link}; }}</style>")
    ui.colors(primary="#1d4ed8", positive="#166534", negative="#b91c1c", warning="#92400e")
    # browsers keep these files for an hour: those of another version have another address
    ui.add_head_html(f'<link rel="stylesheet" href="/mc-static/page.css?{VERSION}">')
    for script in ("page", "browser", "charts"):
        ui.add_body_html(f'<script src="/mc-static/{script}.js?{VERSION}"></script>')


def language_of(request: Request) -> str:
    """Return the language of a request's page: the one chosen there, else one that the browser asks for."""
    accepted = request.headers.get("accept-language", "")
    return language_for(request.cookies.get(LANGUAGE_COOKIE, ""), accepted)
