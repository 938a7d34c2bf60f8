"""Times of ROS: seconds and nanoseconds, since 1970 or of a duration."""

from __future__ import annotations

from typing import Any

from mcserver.ros.interfaces import interfaces

NANO = 1_000_000_000


def stamp_of(seconds: float) -> Any:
    """Return a ``builtin_interfaces/msg/Time``."""
    whole, nanosec = divmod(round(seconds * NANO), NANO)
    return interfaces().make("builtin_interfaces/msg/Time", sec=whole, nanosec=nanosec)


def duration_of(seconds: float) -> Any:
    """Return a ``builtin_interfaces/msg/Duration``."""
    whole, nanosec = divmod(round(seconds * NANO), NANO)
    return interfaces().make("builtin_interfaces/msg/Duration", sec=whole, nanosec=nanosec)


def seconds_of(message: Any) -> float:
    """Return what a time or duration says [s]."""
    return float(message.sec + message.nanosec / NANO)
