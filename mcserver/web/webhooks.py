"""Messages to other programs: a signed POST for each event that they want to know of."""

from __future__ import annotations

import asyncio
import fnmatch
import hashlib
import hmac
import json
import logging
import os
import tomllib
from collections import deque
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import urlsplit

import httpx
import msgspec
from mcclient import Event
from msgspec import Meta

from mcserver.errors import ConfigurationError

log = logging.getLogger(__name__)

EventName = Literal["finished", "aborted", "rejected", "interrupted", "fault", "estop"]
BY_DEFAULT: tuple[EventName, ...] = ("finished", "interrupted", "fault", "estop")
MAX_HOOKS = 32
# Messages that wait for one receiver; what comes beyond is dropped and counted.
MAX_WAITING = 200
ATTEMPTS = 6
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 60.0
# Of a receiver that asks for another try.
AGAIN = frozenset({408, 425, 429})
LEAST_SECRET = 16
ENDINGS: dict[str, EventName] = {
    "finished": "finished",
    "aborted": "aborted",
    "rejected": "rejected",
    "interrupted": "interrupted",
}


class HookSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``[[webhook]]``.

    Attributes:
        url: http or https. events: which. machines: names, or patterns such as ``cell-*``.
        secret_env, secret_file: where the secret of the signature is; it does not stand in the file itself.
    """

    url: str
    events: Annotated[tuple[EventName, ...], Meta(min_length=1)] = BY_DEFAULT
    machines: tuple[str, ...] = ("*",)
    secret_env: str = ""
    secret_file: str = ""
    timeout_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 5.0


class HookFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A whole webhook file."""

    webhook: Annotated[list[HookSection], Meta(min_length=1, max_length=MAX_HOOKS)]


class Hook(msgspec.Struct, frozen=True):
    """A receiver; ``name`` may be logged: it has nothing of the address that could be a secret."""

    section: HookSection
    secret: bytes
    name: str

    def __repr__(self) -> str:
        return f"Hook({self.name})"


def read_hooks(path: Path) -> list[Hook]:
    """The receivers of a webhook file (TOML).

    Raises:
        ConfigurationError: MC066 it cannot be read or meant, or a secret is missing or too short.
    """
    try:
        file = msgspec.convert(tomllib.loads(path.read_text("utf-8")), HookFile)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, msgspec.ValidationError) as error:
        raise ConfigurationError("MC066", f"{path}: {error}", "see docs/webhooks.md") from error
    return [_hook(section, path) for section in file.webhook]


def _hook(section: HookSection, path: Path) -> Hook:
    try:
        parts = urlsplit(section.url)
        sound = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.username is None
    except ValueError:
        sound = False
    if not sound:
        raise ConfigurationError(
            "MC066", f"{path}: a url is no http or https address", "such as https://example.org/hook"
        )
    secret = ""
    if section.secret_env:
        secret = os.environ.get(section.secret_env, "")
    elif section.secret_file:
        try:
            secret = (path.parent / section.secret_file).read_text("utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigurationError(
                "MC066", f"{path}: the secret of {parts.hostname} cannot be read", "check secret_file"
            ) from error
    if len(secret) < LEAST_SECRET:
        raise ConfigurationError(
            "MC066",
            f"{path}: {parts.hostname} has no secret of at least {LEAST_SECRET} characters",
            "give secret_env or secret_file: without a signature anybody could send it messages",
        )
    return Hook(section, secret.encode(), f"{parts.scheme}://{parts.hostname}")


def event_name(event: Event) -> EventName | None:
    """What an event is called for receivers; None: it is of no interest to them."""
    if event.kind == "fault":
        return "fault"
    if event.kind == "estop":
        return "estop"
    if event.kind == "program.ended" and event.state in ENDINGS:
        return ENDINGS[event.state]
    return None


def body_of(machine: str, name: EventName, event: Event) -> bytes:
    """The message as JSON."""
    fault = event.fault
    message: dict[str, Any] = {
        "id": f"{event.instance}-{event.seq}",
        "event": name,
        "machine": machine,
        "time": event.wall,
        "t": event.t,
        "program": event.program,
        "state": event.state,
        "reason": event.reason,
        "fault": None
        if fault is None
        else {
            "code": fault.code,
            "message": fault.message,
            "hint": fault.hint,
            "axis": fault.axis,
            "line": fault.line,
        },
    }
    return json.dumps(message, ensure_ascii=False).encode()


def signature(secret: bytes, timestamp: str, body: bytes) -> str:
    """``sha256=`` and the HMAC-SHA256 of ``timestamp.body``, in hexadecimal digits."""
    return "sha256=" + hmac.new(secret, timestamp.encode() + b"." + body, hashlib.sha256).hexdigest()


class Receiver:
    """One receiver with its own queue: a dead one waits by itself.

    Args:
        hook: where to. client: sends. clock: Unix time [s]. sleep: between attempts.

    Attributes:
        delivered, failed, dropped: counts.
    """

    def __init__(
        self,
        hook: Hook,
        client: httpx.AsyncClient,
        clock: Callable[[], float],
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self.delivered = self.failed = self.dropped = 0
        self._hook = hook
        self._client = client
        self._clock = clock
        self._sleep = sleep
        self._waiting: deque[tuple[str, EventName, bytes]] = deque()
        self._arrived = asyncio.Event()

    def take(self, machine: str, event: Event) -> None:
        """Queue the message of an event that this receiver wants; never waits."""
        name = event_name(event)
        section = self._hook.section
        if name not in section.events or not any(
            fnmatch.fnmatchcase(machine, each) for each in section.machines
        ):
            return
        assert name is not None
        if len(self._waiting) >= MAX_WAITING:
            self.dropped += 1
            log.warning("MC068: %s is too slow: %d messages dropped", self._hook.name, self.dropped)
            return
        identifier = f"{event.instance}-{event.seq}"
        self._waiting.append((identifier, name, body_of(machine, name, event)))
        self._arrived.set()

    async def run(self) -> None:
        """Send until cancelled, one message after the other."""
        while True:
            while not self._waiting:
                self._arrived.clear()
                await self._arrived.wait()
            identifier, name, body = self._waiting[0]
            if await self._deliver(identifier, name, body):
                self.delivered += 1
            else:
                self.failed += 1
            self._waiting.popleft()

    async def _deliver(self, identifier: str, name: EventName, body: bytes) -> bool:
        pause_s = FIRST_PAUSE_S
        outcome = ""
        for attempt in range(ATTEMPTS):
            if attempt:
                await self._sleep(pause_s)
                pause_s = min(4.0 * pause_s, LONGEST_PAUSE_S)
            status, outcome = await self._post(identifier, name, body)
            if 200 <= status < 300:
                return True
            if 300 <= status < 500 and status not in AGAIN:
                break
        log.warning("MC067: %s did not take %s %s: %s", self._hook.name, name, identifier, outcome)
        return False

    async def _post(self, identifier: str, name: EventName, body: bytes) -> tuple[int, str]:
        timestamp = str(int(self._clock()))
        headers = {
            "Content-Type": "application/json",
            "User-Agent": "mcserver",
            "X-MC-Event": name,
            "X-MC-Delivery": identifier,
            "X-MC-Timestamp": timestamp,
            "X-MC-Signature": signature(self._hook.secret, timestamp, body),
        }
        section = self._hook.section
        try:
            # the whole exchange, not each of its parts; what the receiver says is not read
            async with (
                asyncio.timeout(section.timeout_s),
                self._client.stream("POST", section.url, content=body, headers=headers) as response,
            ):
                return response.status_code, f"answered {response.status_code}"
        except TimeoutError:
            return 0, f"no answer within {section.timeout_s:g} s"
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            # its text may hold the address
            return 0, type(error).__name__
