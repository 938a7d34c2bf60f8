"""Quality of service by kind of key (docs/keyspace.md, "Keys").

What clients send blocks, what the server sends drops: a stalled consumer then costs nobody else anything.
"""

from __future__ import annotations

import msgspec
import zenoh


class Qos(msgspec.Struct, frozen=True):
    """Priority, congestion control, express and reliability of one publication."""

    priority: zenoh.Priority
    congestion: zenoh.CongestionControl = zenoh.CongestionControl.DROP
    express: bool = False
    reliability: zenoh.Reliability = zenoh.Reliability.RELIABLE


def ack_qos() -> Qos:
    return Qos(zenoh.Priority.INTERACTIVE_HIGH, express=True)


def event_qos() -> Qos:
    return Qos(zenoh.Priority.DATA_HIGH)


def batch_qos() -> Qos:
    return Qos(zenoh.Priority.DATA, reliability=zenoh.Reliability.BEST_EFFORT)


def state_qos() -> Qos:
    return Qos(zenoh.Priority.DATA_LOW, reliability=zenoh.Reliability.BEST_EFFORT)


def axis_qos() -> Qos:
    return Qos(zenoh.Priority.BACKGROUND, reliability=zenoh.Reliability.BEST_EFFORT)


def emergency_stop_qos() -> Qos:
    return Qos(zenoh.Priority.REAL_TIME, zenoh.CongestionControl.BLOCK, express=True)
