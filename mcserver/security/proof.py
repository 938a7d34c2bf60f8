"""Prove a site's access rules against its running router: each identity tries what it may and may not.

Nothing moves for it: calls hold no request number, which a server refuses before it does anything, and puts
go to names that nobody uses. Where a machine's server is not there, its identity stands in for it.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import msgspec
import zenoh

from mcserver.errors import ServiceError
from mcserver.net.method_table import METHODS
from mcserver.net.roles import ASKERS
from mcserver.security.site import EVERY_MACHINE, Role, Site, User, machine_identity
from mcserver.security.site_files import configuration_path

CONNECT_MS = 5000
CALL_S = 2.0
PAUSE_S = 0.1
# declarations take their way through the router: what is to pass is tried again, what is not, twice
TRIES_ALLOWED = 20
TRIES_DENIED = 2
NOBODY = "security-check"
STRANGER = "nobody-of-this-site"


class Finding(msgspec.Struct, frozen=True):
    """One attempt.

    Attributes:
        who: the identity. what: what it tried. allowed: whether the rules are to let it. passed: whether it
            got through.
    """

    who: str
    what: str
    allowed: bool
    passed: bool

    @property
    def holds(self) -> bool:
        return self.allowed is self.passed


def prove(folder: Path, site: Site, router: str | None = None) -> Iterator[Finding]:
    """Try every identity's rights at the router.

    Args:
        router: its endpoint, where it is not reached as the site says.

    Raises:
        ServiceError: MC562 the router cannot be reached, or lets the site's own identities not in.
    """
    endpoint = router or site.endpoint
    yield Finding("anybody", "connect without a certificate", False, _connects(_bare(endpoint)))
    with ExitStack() as stack:

        def session(identity: str) -> zenoh.Session:
            return stack.enter_context(_session(folder, identity, endpoint))

        machines = {name: session(machine_identity(name)) for name in site.machines}
        users = {user.name: session(user.name) for user in site.users}
        for name, own in machines.items():
            yield from _prove_machine(name, own, site, machines)
        for name, own in machines.items():
            with _standing_in(own, f"mc/@v1/{name}"):
                # those who may first: where they are answered, the others are not left out by chance
                for user in sorted(site.users, key=lambda user: not _is_here(user, name)):
                    watcher = next(
                        (
                            users[other.name]
                            for other in site.users
                            if other != user and _is_here(other, name)
                        ),
                        None,
                    )
                    yield from _prove_user(user, name, users[user.name], own, watcher)
        for user in site.users:
            yield _admin(user, users[user.name])


def passed_methods(findings: Iterable[Finding], site: Site) -> dict[str, frozenset[Role]]:
    """Return which roles got a method's call through, for every method, in the order of the table.

    Only machines that the user's role holds for count.
    """
    passed: dict[str, set[Role]] = {method.name: set() for method in METHODS}
    users = {user.name: user for user in site.users}
    for each in findings:
        machine, _, method = each.what.partition(": ")
        user = users.get(each.who)
        if each.passed and user is not None and method in passed and _is_here(user, machine):
            passed[method].add(user.role)
    return {name: frozenset(roles) for name, roles in passed.items()}


def _prove_machine(
    name: str, own: zenoh.Session, site: Site, machines: dict[str, zenoh.Session]
) -> Iterator[Finding]:
    who = machine_identity(name)
    other = next((each for each in site.machines if each != name), STRANGER)
    asker = machines.get(other, own)
    key = f"mc/@v1/{other}/tele/{NOBODY}"
    yield Finding(who, f"publish as {other}", False, _reaches(own, key, asker))
    with _answering(own, f"mc/@v1/{other}/@rpc/*/{NOBODY}"):
        passed = _answered(asker, f"mc/@v1/{other}/@rpc/{NOBODY}/{NOBODY}")
    yield Finding(who, f"answer as {other}", False, passed)
    yield Finding(who, f"be alive as {other}", False, _is_alive(own, f"mc/@v1/{other}/live/{NOBODY}", asker))
    yield Finding(who, "call another machine", False, _answered(own, f"mc/@v1/{other}/@rpc/{NOBODY}/abort"))


def _prove_user(
    user: User, machine: str, own: zenoh.Session, served: zenoh.Session, watcher: zenoh.Session | None
) -> Iterator[Finding]:
    root = f"mc/@v1/{machine}"
    here = _is_here(user, machine)
    mine = f"{user.name}.{NOBODY}"
    # status first, which everybody has who may anything: it waits for the declarations to be there
    for method in sorted(METHODS, key=lambda method: method.name != "status"):
        allowed = here and user.role in method.roles
        passed = _answered(own, f"{root}/@rpc/{mine}/{method.name}", allowed=allowed)
        yield Finding(user.name, f"{machine}: {method.name}", allowed, passed)
    key = f"{root}/@rpc/{STRANGER}.{NOBODY}/status"
    yield Finding(user.name, f"{machine}: call as another user", False, _answered(own, key))
    lines = f"{root}/in/{mine}/{NOBODY}"
    moves = here and user.role in ASKERS
    yield Finding(user.name, f"{machine}: send lines", moves, _reaches(own, lines, served, allowed=moves))
    lines = f"{root}/in/{STRANGER}.{NOBODY}/{NOBODY}"
    yield Finding(user.name, f"{machine}: send lines as another user", False, _reaches(own, lines, served))
    token = f"{root}/client/{STRANGER}.{NOBODY}"
    yield Finding(user.name, f"{machine}: be another client", False, _is_alive(own, token, served))
    if watcher is not None:
        for what in (f"ack/{NOBODY}", f"tele/{NOBODY}"):
            passed = _reaches(own, f"{root}/{what}", watcher)
            yield Finding(user.name, f"{machine}: publish {what.partition('/')[0]}", False, passed)
        token = f"{root}/live/{NOBODY}"
        yield Finding(user.name, f"{machine}: be alive as the machine", False, _is_alive(own, token, watcher))


def _admin(user: User, own: zenoh.Session) -> Finding:
    router = str(next(iter(own.info.routers_zid()), ""))
    allowed = user.role is Role.ENGINEER
    passed = bool(router) and _answered(own, f"@/{router}/router", allowed=allowed)
    return Finding(user.name, "read the router's admin space", allowed, passed)


def _is_here(user: User, machine: str) -> bool:
    return machine in user.machines or EVERY_MACHINE in user.machines


# ---------------------------------------------------------------- attempts


def _answered(session: zenoh.Session, key: str, *, allowed: bool = False) -> bool:
    """Return whether anybody answers, if with an error; Zenoh's own errors (a time-out on the way) do not
    count.
    """

    def once() -> bool:
        replies = session.get(
            key,
            payload=b"\x80",
            timeout=CALL_S,
            target=zenoh.QueryTarget.BEST_MATCHING,
            consolidation=zenoh.ConsolidationMode.NONE,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        return any(
            reply.ok is not None or (reply.err is not None and not _is_time_out(reply.err))
            for reply in replies
        )

    return _eventually(once, allowed)


def _is_time_out(error: zenoh.ReplyError) -> bool:
    return error.payload.to_bytes() == b"Timeout"


def _reaches(sender: zenoh.Session, key: str, receiver: zenoh.Session, *, allowed: bool = False) -> bool:
    arrived = threading.Event()

    def on_sample(_: zenoh.Sample) -> None:
        arrived.set()

    subscriber = receiver.declare_subscriber(
        key, zenoh.handlers.Callback(on_sample, indirect=False), allowed_origin=zenoh.Locality.REMOTE
    )

    def once() -> bool:
        sender.put(key, b"", congestion_control=zenoh.CongestionControl.BLOCK)
        return arrived.wait(PAUSE_S)

    try:
        return _eventually(once, allowed)
    finally:
        subscriber.undeclare()  # type: ignore[no-untyped-call]


def _is_alive(session: zenoh.Session, key: str, watcher: zenoh.Session) -> bool:
    """Return whether another session sees this one's token; always False where there is no other."""
    if watcher is session:
        return False
    token = session.liveliness().declare_token(key)

    def once() -> bool:
        return any(reply.ok is not None for reply in watcher.liveliness().get(key, timeout=CALL_S))

    try:
        return _eventually(once, allowed=False)
    finally:
        token.undeclare()  # type: ignore[no-untyped-call]


def _eventually(once: Callable[[], bool], allowed: bool) -> bool:
    if once():
        return True
    pause = threading.Event()
    further = (TRIES_ALLOWED if allowed else TRIES_DENIED) - 1
    return any(pause.wait(PAUSE_S) or once() for _ in range(further))


@contextmanager
def _answering(session: zenoh.Session, key: str) -> Iterator[None]:
    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply_err(b"\x80")

    queryable = session.declare_queryable(key, zenoh.handlers.Callback(answer, indirect=False), complete=True)
    try:
        yield
    finally:
        queryable.undeclare()  # type: ignore[no-untyped-call]


@contextmanager
def _standing_in(machine: zenoh.Session, root: str) -> Iterator[None]:
    """Answer for the machine where its server is not there."""
    if any(reply.ok is not None for reply in machine.liveliness().get(f"{root}/live/*", timeout=CALL_S)):
        yield
        return
    with _answering(machine, f"{root}/@rpc/*/*"):
        yield


# ---------------------------------------------------------------- sessions


@contextmanager
def _session(folder: Path, identity: str, endpoint: str) -> Iterator[zenoh.Session]:
    config = zenoh.Config.from_file(configuration_path(folder, identity))
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("connect/timeout_ms", str(CONNECT_MS))
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise ServiceError(
            "MC562",
            f"{identity} cannot reach the router at {endpoint}",
            "is it running with router.json5 of this folder? zenohd --config router.json5",
        ) from error
    try:
        yield session
    finally:
        close: Callable[[], Any] = session.close
        close()


def _bare(endpoint: str) -> zenoh.Config:
    config = zenoh.Config.from_json5('{mode: "client", scouting: {multicast: {enabled: false}}}')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("connect/timeout_ms", "1000")
    return config


def _connects(config: zenoh.Config) -> bool:
    try:
        session = zenoh.open(config)
    except zenoh.ZError:
        return False
    close: Callable[[], Any] = session.close
    close()
    return True
