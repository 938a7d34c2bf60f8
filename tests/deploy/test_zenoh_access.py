"""The router example: TLS, and each role's rights, with real sessions over loopback."""

from __future__ import annotations

import shutil
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zenoh

DEPLOY = Path(__file__).resolve().parents[2] / "deploy" / "zenoh"
CELL = "mc/@v1/cell"
ROLES = ("machine", "operator", "observer", "engineer")

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="certificates need openssl")


class Site:
    """A router with certificates of its own, and sessions of every role."""

    def __init__(self, folder: Path) -> None:
        subprocess.run(
            [DEPLOY / "make-certificates.sh", "certificates", "127.0.0.1", *ROLES],
            cwd=folder,
            check=True,
            capture_output=True,
            timeout=60,
        )
        self._folder = folder
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self._endpoint = f"tls/127.0.0.1:{probe.getsockname()[1]}"
        router = self._config("zenohd.json5")
        router.insert_json5("listen/endpoints", f'["{self._endpoint}"]')
        self._sessions = [zenoh.open(router)]

    def _config(self, name: str, role: str = "") -> zenoh.Config:
        text = (DEPLOY / name).read_text("utf-8")
        text = text.replace("certificates/", f"{self._folder}/certificates/").replace("NAME", role)
        return zenoh.Config.from_json5(text.replace("tls/192.168.1.10:7447", getattr(self, "_endpoint", "")))

    def session(self, role: str) -> zenoh.Session:
        session = zenoh.open(self._config("client.json5", role))
        self._sessions.append(session)
        return session

    def close(self) -> None:
        for session in reversed(self._sessions):
            session.close()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    site = Site(tmp_path_factory.mktemp("site"))
    yield site
    site.close()


@pytest.fixture(scope="module")
def machine(site: Site) -> Iterator[zenoh.Session]:
    """A machine that answers every method, tells its state and listens to the emergency stop."""
    session = site.session("machine")
    for key in (f"{CELL}/info", f"{CELL}/@rpc/*"):
        session.declare_queryable(key, lambda query: query.reply(query.key_expr, b"done"))
    token = session.liveliness().declare_token(f"{CELL}/live/1")
    yield session
    token.undeclare()


def answered(session: zenoh.Session, key: str) -> bool:
    return any(reply.ok is not None for reply in session.get(key, timeout=5.0))


def soon(question: Callable[[], bool]) -> bool:
    """Declarations travel through the router: asks again, for a second or two, until the answer is yes."""
    pause = threading.Event()
    return any(question() or pause.wait(0.02) for _ in range(100))


@pytest.mark.usefixtures("machine")
@pytest.mark.parametrize("role", ["observer", "operator", "engineer"])
def test_everybody_may_look(site: Site, role: str) -> None:
    session = site.session(role)
    assert soon(lambda: answered(session, f"{CELL}/info"))
    assert soon(lambda: answered(session, f"{CELL}/@rpc/status"))
    assert soon(lambda: any(True for _ in session.liveliness().get("mc/@v1/*/live/*", timeout=5.0)))


@pytest.mark.usefixtures("machine")
@pytest.mark.parametrize(("role", "may"), [("observer", False), ("operator", True), ("engineer", True)])
def test_only_operators_and_engineers_may_move(site: Site, role: str, may: bool) -> None:
    session = site.session(role)
    assert soon(lambda: answered(session, f"{CELL}/@rpc/status"))
    assert answered(session, f"{CELL}/@rpc/submit") is may


@pytest.mark.parametrize("role", ["observer", "operator", "engineer"])
def test_everybody_may_stop(site: Site, machine: zenoh.Session, role: str) -> None:
    stopped = threading.Event()
    subscriber = machine.declare_subscriber(f"{CELL}/estop", lambda _: stopped.set())
    session = site.session(role)

    def press() -> bool:
        session.put(f"{CELL}/estop", b"")
        return stopped.wait(0.1)

    assert soon(press)
    subscriber.undeclare()


def test_telemetry_reaches_an_observer(site: Site, machine: zenoh.Session) -> None:
    seen = threading.Event()
    observer = site.session("observer")
    observer.declare_subscriber(f"{CELL}/tele/state", lambda _: seen.set())

    def tell() -> bool:
        machine.put(f"{CELL}/tele/state", b"state")
        return seen.wait(0.1)

    assert soon(tell)


def test_nobody_but_a_machine_may_answer_for_one(site: Site, machine: zenoh.Session) -> None:
    impostor = site.session("operator")
    impostor.declare_queryable("mc/@v1/other/info", lambda query: query.reply(query.key_expr, b"false"))
    assert soon(lambda: answered(impostor, f"{CELL}/info"))
    assert not answered(machine, "mc/@v1/other/info")


def test_a_session_without_a_certificate_is_not_let_in(site: Site) -> None:
    config = zenoh.Config.from_json5('{mode: "client", scouting: {multicast: {enabled: false}}}')
    config.insert_json5("connect/endpoints", f'["{site._endpoint}"]')
    config.insert_json5("connect/timeout_ms", "1000")
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)
