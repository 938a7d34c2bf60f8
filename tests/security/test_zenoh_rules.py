"""What the site's rules rely on in Zenoh, where Zenoh has open issues: tried with the installed version."""

from __future__ import annotations

import base64
import json
import queue
import ssl
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from mcserver.security.access import access_control
from tests.bench.server import free_port
from tests.net.deafening import deafen
from tests.security.conftest import MACHINE, RunningSite
from tests.zenoh_sessions import opened

LIMIT_S = 10.0
# long enough for a message that is let through to be there: what is not must not come
SETTLED_S = 0.5


@pytest.fixture
def site(tmp_path: Path) -> Iterator[RunningSite]:
    made = RunningSite(tmp_path / "site")
    yield made
    made.close()


def tokens(session: zenoh.Session, key: str) -> list[str]:
    replies = session.liveliness().get(key, timeout=2.0)
    return sorted(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)


# ------------------------------------------------------------ liveliness tokens under deny-all (zenoh#1562)


def test_a_token_that_no_rule_allows_is_seen_by_nobody(site: RunningSite) -> None:
    alice, bob, machine = (site.session(each) for each in ("alice", "bob", f"machine.{MACHINE}"))
    heard: queue.SimpleQueue[str] = queue.SimpleQueue()
    watches = [
        each.liveliness().declare_subscriber(
            f"mc/@v1/{MACHINE}/client/*", lambda sample: heard.put(str(sample.key_expr)), history=True
        )
        for each in (alice, machine)
    ]
    # an observer is no client that holds anything, nor a server
    forged = [
        bob.liveliness().declare_token(f"mc/@v1/{MACHINE}/{key}")
        for key in ("client/bob.x", "client/alice.x", "live/1.2e")
    ]
    allowed = alice.liveliness().declare_token(f"mc/@v1/{MACHINE}/client/alice.hmi")
    # the allowed one, which came later, is there: so would be the others
    assert heard.get(timeout=LIMIT_S).endswith("/client/alice.hmi")
    time.sleep(SETTLED_S)
    due = time.monotonic() + LIMIT_S
    # an answer in time may need more than one try beside other work
    while not (found := tokens(machine, f"mc/@v1/{MACHINE}/client/*")) and time.monotonic() < due:
        time.sleep(SETTLED_S)
    assert found == [f"mc/@v1/{MACHINE}/client/alice.hmi"]
    assert tokens(machine, f"mc/@v1/{MACHINE}/live/*") == []
    while not heard.empty():
        assert heard.get().endswith("/client/alice.hmi")
    for each in (*forged, allowed, *watches):
        each.undeclare()


def test_the_end_of_a_token_passes_the_rules_that_let_it_in(site: RunningSite) -> None:
    machine = site.session(f"machine.{MACHINE}")
    gone: queue.SimpleQueue[str] = queue.SimpleQueue()

    def on_token(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            gone.put(str(sample.key_expr))

    watch = machine.liveliness().declare_subscriber(f"mc/@v1/{MACHINE}/client/*", on_token, history=True)
    alice = site.session("alice")
    for ending in ("undeclared", "closed"):
        key = f"mc/@v1/{MACHINE}/client/alice.{ending}"
        token = alice.liveliness().declare_token(key)
        until = time.monotonic() + LIMIT_S
        while key not in tokens(machine, key) and time.monotonic() < until:
            pass
        token.undeclare() if ending == "undeclared" else alice.close()
        # programs end with it: a token that stayed would let them run on
        assert gone.get(timeout=LIMIT_S) == key
    watch.undeclare()


# ------------------------------------------------------------ rules for interfaces (zenoh#2143)


def test_no_rule_of_a_site_depends_on_an_interface(site: RunningSite) -> None:
    rules = access_control(site.site)
    assert rules["default_permission"] == "deny"
    # whoever comes over another interface has the same certificate, and the same rules
    assert all("interfaces" not in subject for subject in rules["subjects"])
    assert all(subject["cert_common_names"] for subject in rules["subjects"])


@pytest.mark.parametrize(("interface", "arrives"), [(None, True), ("lo", True), ("nosuch0", False)])
def test_a_subject_without_an_interface_is_everywhere(interface: str | None, arrives: bool) -> None:
    subject = {"id": "everybody", **({} if interface is None else {"interfaces": [interface]})}
    rule = {
        "id": "all",
        "permission": "allow",
        "flows": ["ingress", "egress"],
        "messages": ["put", "declare_subscriber"],
        "key_exprs": ["k"],
    }
    control = {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule],
        "subjects": [subject],
        "policies": [{"rules": ["all"], "subjects": ["everybody"]}],
    }
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    heard: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    with (
        opened({"mode": "router", "listen/endpoints": [endpoint], "access_control": control}),
        opened({"mode": "client", "connect/endpoints": [endpoint]}) as one,
        opened({"mode": "client", "connect/endpoints": [endpoint]}) as other,
        one.declare_subscriber("k", lambda sample: heard.put(sample.payload.to_bytes())),
    ):
        time.sleep(SETTLED_S)
        other.put("k", b"x")
        time.sleep(SETTLED_S)
        assert (not heard.empty()) == arrives


# ------------------------------------------------------------ malformed declarations (docs/security.md)


def tls_of(site: RunningSite, user: str, folder: Path) -> ssl.SSLContext:
    """What a program of another make connects with in a user's name."""
    configuration = json.loads(site.path(user).read_text("utf-8").split("\n", 1)[1])
    own = configuration["transport"]["link"]["tls"]
    both = folder / f"{user}.pem"
    both.write_bytes(
        base64.b64decode(own["connect_certificate_base64"])
        + b"\n"
        + base64.b64decode(own["connect_private_key_base64"])
    )
    context = ssl.create_default_context(cafile=str(site.folder / "authority.pem"))
    context.load_cert_chain(both)
    return context


def test_the_rules_keep_a_malformed_declaration_from_the_routers_tables(
    site: RunningSite, tmp_path: Path
) -> None:
    machine, context = site.session(f"machine.{MACHINE}"), tls_of(site, "bob", tmp_path)
    told = machine.declare_queryable(
        f"mc/@v1/{MACHINE}/info",
        zenoh.handlers.Callback(lambda query: query.reply(query.key_expr, b"here"), indirect=False),
    )
    deafen(site.site.endpoint, MACHINE, context, lambda _: site.session("bob"))
    alice = site.session("alice")
    answers = alice.get(f"mc/@v1/{MACHINE}/info", timeout=LIMIT_S)
    assert [reply.ok.payload.to_bytes() for reply in answers if reply.ok is not None] == [b"here"]
    told.undeclare()
