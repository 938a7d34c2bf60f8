"""Quality of service by kind of key (docs/keyspace.md, "Keys").

Messages from clients block, those from the server are dropped: so a stalled consumer affects nobody else.
"""

from __future__ import annotations

import msgspec
import zenoh

from mcserver.net.method_table import METHODS


class Qos(msgspec.Struct, frozen=True):
    """Priority, congestion control, express and reliability of a publication."""

    priority: zenoh.Priority
    congestion: zenoh.CongestionControl = zenoh.CongestionControl.DROP
    express: bool = False
    reliability: zenoh.Reliability = zenoh.Reliability.RELIABLE


ACK = Qos(zenoh.Priority.INTERACTIVE_HIGH, express=True)
EVENT = Qos(zenoh.Priority.DATA_HIGH)
BATCH = Qos(zenoh.Priority.DATA, reliability=zenoh.Reliability.BEST_EFFORT)
STATE = Qos(zenoh.Priority.DATA_LOW, reliability=zenoh.Reliability.BEST_EFFORT)
AXIS = Qos(zenoh.Priority.BACKGROUND, reliability=zenoh.Reliability.BEST_EFFORT)
EMERGENCY_STOP = Qos(zenoh.Priority.REAL_TIME, zenoh.CongestionControl.BLOCK, express=True)


def reply_qos() -> list[dict[str, object]]:
    """Return Zenoh's ``qos/network`` for replies, which have the quality of service of their query.

    A reply that waited for room in a stalled link would block one of Zenoh's threads, and at a router the
    link between the machine and all other callers: it is dropped, and its caller asks again. Methods that
    only read may have large replies, in a queue separate from that of commands and states.
    """
    prompt = [method.name for method in METHODS if method.changes or method.name in ("status", "info")]
    bulky = [method.name for method in METHODS if method.name not in prompt]
    calls = {
        "replies": ([f"mc/@v1/*/@rpc/*/{name}" for name in prompt] + ["mc/@v1/*/info"], {}),
        "large-replies": ([f"mc/@v1/*/@rpc/*/{name}" for name in bulky], {"priority": "interactive_low"}),
    }
    return [
        {
            "id": name,
            "messages": ["query"],
            "flows": ["ingress"],
            "key_exprs": keys,
            "overwrite": {"congestion_control": "drop", **overwritten},
        }
        for name, (keys, overwritten) in calls.items()
    ]
