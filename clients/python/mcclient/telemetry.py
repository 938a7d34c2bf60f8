"""Telemetry: the whole machine for dashboards, and every cycle as arrays."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mcclient.errors import MotionError, ProtocolError
from mcclient.feed import Feed, Queue
from mcclient.transport import Arrived, Link
from mcclient.types import Info
from mcclient.wire import unpack

log = logging.getLogger(__name__)

STATES_LIMIT = 32
SAMPLES_LIMIT = 4096

T = TypeVar("T")
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Samples:
    """Some cycles of every axis, in mm, deg and s.

    Attributes:
        seq: number of the first row's cycle; a jump means cycles lost on the way.
        time_s: shape (N,), executor time [s].
        axes: the K axes' numbers.
        fields: by name (``setpoint``, ``position``, ``velocity``, ``torque``), shape (N, K) each.
    """

    seq: int
    time_s: Array
    axes: tuple[int, ...]
    fields: dict[str, Array]

    @property
    def setpoint(self) -> Array:
        """Shape (N, K) [mm, deg]."""
        return self.fields["setpoint"]

    @property
    def actual(self) -> Array:
        """The encoders' readings, shape (N, K) [mm, deg]."""
        return self.fields["position"]

    @property
    def velocity(self) -> Array:
        """Shape (N, K) [mm/s, deg/s]."""
        return self.fields["velocity"]

    @property
    def torque(self) -> Array:
        """Shape (N, K) [N·m]."""
        return self.fields["torque"]


def decode_samples(payload: bytes, info: Info) -> Samples:
    """Return a message of ``tele/batch``, read as ``info`` says.

    Raises:
        ProtocolError: MC533 it is no such message.
    """
    block = unpack(payload)
    axes, names = info.telemetry.axes, info.telemetry.fields
    try:
        seq, start_s, rows = block
        values = np.frombuffer(rows, dtype="<f4").reshape(-1, len(axes), len(names)).astype(np.float64)
    except (TypeError, ValueError) as error:
        raise ProtocolError(
            "MC533", f"the samples do not fit the machine's axes: {error}", "has its configuration changed?"
        ) from error
    time_s: Array = float(start_s) + info.cycle_s * np.arange(len(values), dtype=np.float64)
    return Samples(int(seq), time_s, axes, {name: values[:, :, i] for i, name in enumerate(names)})


def open_feed(link: Link, key: str, read: Callable[[bytes], T], *, limit: int) -> Feed[T]:
    """Return a feed of what is said under a key; a slow reader gets the newest.

    Args:
        read: a payload; MotionError: it cannot be read.
    """
    queue: Queue[T] = Queue(limit)

    def on_sample(arrived: Arrived) -> None:
        try:
            queue.push(read(arrived.payload))
        except MotionError as error:
            log.warning("telemetry was not understood: %s", error)

    return Feed(queue, link.subscribe(key, on_sample, limit=limit).close)
