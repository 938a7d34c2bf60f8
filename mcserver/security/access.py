"""The router's access rules for a site: who may send what inwards, and what goes out to whom.

Inwards (Zenoh's ``ingress``: from a client or machine to the router) each identity has rules of its own,
which hold its name: a user calls only with client ids that begin with ``user.``, a machine answers and
publishes only under its own name. Outwards (``egress``) the rules keep from somebody what he may not read.

A message passes where its key expression lies within a rule's. So a rule for one machine never lets a
wildcard over several machines through. ``*`` and ``**`` never match the verbatim chunks ``@v1`` and ``@rpc``.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mcserver.net.method_table import method_names
from mcserver.net.roles import ASKERS
from mcserver.security.site import EVERY_MACHINE, Role, Site, User, machine_identity

# what a machine publishes, below its name; @adv: the cache that late readers of events ask
PUBLISHED = ("tele/**", "ack/*", "event", "event/@adv/**")
ADMIN_SPACE = "@/**"

Rule = dict[str, Any]


def access_control(site: Site) -> dict[str, Any]:
    """Zenoh's ``access_control`` for a site's router; without a certificate of the site nothing passes."""
    rules: list[Rule] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for identity, own in _by_identity(site):
        rules += own
        subject: dict[str, Any] = {"id": identity, "cert_common_names": [identity]}
        if site.passwords:
            # both have to be this identity's
            subject["usernames"] = [identity]
        subjects.append(subject)
        policies.append({"subjects": [identity], "rules": [rule["id"] for rule in own]})
    # an empty list of rules would be refused by Zenoh
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _by_identity(site: Site) -> Iterable[tuple[str, list[Rule]]]:
    for machine in site.machines:
        yield machine_identity(machine), machine_rules(machine)
    for user in site.users:
        yield user.name, user_rules(user)


def user_rules(user: User) -> list[Rule]:
    """Return what one user may."""
    roots = [f"mc/@v1/{machine}" for machine in user.machines]
    mine = f"{user.name}.$*"
    published = [f"{root}/{key}" for root in roots for key in PUBLISHED]
    calls = [f"{root}/@rpc/{mine}/{method}" for root in roots for method in method_names(user.role)]
    asked = [*calls, *[f"{root}/info" for root in roots], *[f"{root}/event/@adv/**" for root in roots]]
    # which machines there are is no secret, and a client looks for its machine by a wildcard
    live = [f"mc/@v1/{EVERY_MACHINE}/live/*"]
    clients = [f"{root}/client/*" for root in roots]
    rules = [
        _rule(user.name, "listen", "ingress", ["declare_subscriber"], published),
        _rule(user.name, "call", "ingress", ["query"], asked),
        _rule(
            user.name,
            "find",
            "ingress",
            ["liveliness_query", "declare_liveliness_subscriber"],
            # the last: publishers of events, looked for by whoever recovers them
            [*live, *clients, *[f"{root}/event/@adv/**" for root in roots]],
        ),
        _rule(user.name, "stop", "ingress", ["put"], [f"{root}/estop" for root in roots]),
        _rule(user.name, "hear", "egress", ["put", "delete"], published),
        _rule(user.name, "answers", "egress", ["reply"], asked),
        _rule(
            user.name,
            "there",
            "egress",
            ["liveliness_token"],
            [*live, *clients, *[f"{root}/event/@adv/**" for root in roots]],
        ),
        # who declares what is of use to Zenoh alone: whether anybody listens or answers
        _rule(user.name, "known", "egress", ["declare_queryable", "declare_subscriber"], _everything(roots)),
    ]
    if user.role in ASKERS:
        # programs and requests end with their client
        tokens = [f"{root}/client/{mine}" for root in roots]
        rules.append(_rule(user.name, "alive", "ingress", ["liveliness_token"], tokens))
        # lines and targets go to programs of their own, which others than movers have only by an approval
        lines = [f"{root}/in/{mine}/*" for root in roots]
        rules.append(_rule(user.name, "stream", "ingress", ["put"], lines))
    if user.role is Role.ENGINEER:
        rules += [
            _rule(user.name, "admin", "ingress", ["query"], [ADMIN_SPACE]),
            _rule(user.name, "admin-answers", "egress", ["reply", "declare_queryable"], [ADMIN_SPACE]),
        ]
    return rules


def machine_rules(machine: str) -> list[Rule]:
    """Return what one machine may: everything under its own name that a server does, and nothing under
    another.
    """
    identity = machine_identity(machine)
    root = f"mc/@v1/{machine}"
    published = [f"{root}/{key}" for key in PUBLISHED]
    calls = [f"{root}/@rpc/*/*", f"{root}/info", f"{root}/event/@adv/**"]
    every = f"mc/@v1/{EVERY_MACHINE}"
    return [
        _rule(identity, "serve", "ingress", ["declare_queryable", "reply"], calls),
        _rule(identity, "publish", "ingress", ["put", "delete"], published),
        _rule(identity, "listen", "ingress", ["declare_subscriber"], [f"{root}/in/*/*", f"{root}/estop"]),
        _rule(
            identity, "alive", "ingress", ["liveliness_token"], [f"{root}/live/*", f"{root}/event/@adv/**"]
        ),
        _rule(
            identity,
            "watch",
            "ingress",
            ["declare_liveliness_subscriber", "liveliness_query"],
            [f"{root}/client/*", f"{root}/live/*"],
        ),
        # a call or a stop by wildcard reaches a machine that may hear the whole wildcard
        _rule(
            identity,
            "asked",
            "egress",
            ["query"],
            [f"{every}/@rpc/*/*", f"{every}/info", f"{every}/event/@adv/**"],
        ),
        _rule(identity, "take", "egress", ["put"], [f"{root}/in/*/*", f"{every}/estop"]),
        _rule(identity, "there", "egress", ["liveliness_token"], [f"{root}/client/*", f"{root}/live/*"]),
        _rule(identity, "known", "egress", ["declare_subscriber", "declare_queryable"], _everything([every])),
    ]


def _everything(roots: Iterable[str]) -> list[str]:
    return [key for root in roots for key in (f"{root}/**", f"{root}/@rpc/**", f"{root}/**/@adv/**")]


def _rule(identity: str, what: str, flow: str, messages: list[str], keys: list[str]) -> Rule:
    return {
        "id": f"{identity}/{what}",
        "permission": "allow",
        "flows": [flow],
        "messages": messages,
        "key_exprs": keys,
    }
