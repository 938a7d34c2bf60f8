"""Blocks of telemetry with the columns that they decode to."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from mcserver.net.messages import TelemetryBlock
from mcserver.net.status import TELEMETRY_FIELDS as FIELDS

CYCLE_S = 0.001


def telemetry() -> dict[str, Any]:
    """Blocks of several shapes: ``columns`` has, by field, the axes of the first row, then of the next."""
    vectors = []
    for axes, rows, seq in (((0, 1, 2), 2, 0), ((0,), 1, 2**40), (tuple(range(64)), 3, 70), ((5, 9), 0, 5)):
        count = rows * len(axes) * len(FIELDS)
        numbers = (np.arange(count, dtype=np.float32) * np.float32(0.1) - np.float32(1.0)).astype("<f4")
        if count > 8:
            # extremes that a detour by another type would change
            numbers[:4] = (
                np.float32(3.4028235e38),
                np.float32(-1e-45),
                np.float32(-0.0),
                np.float32(16777217),
            )
        shaped = numbers.reshape(rows, len(axes), len(FIELDS))
        block = msgspec.msgpack.encode(TelemetryBlock(seq, seq * CYCLE_S, numbers.tobytes()))
        vectors.append(
            {
                "name": f"{rows} rows of {len(axes)} axes",
                "axes": list(axes),
                "bytes": block.hex(),
                "seq": seq,
                "t": seq * CYCLE_S,
                "rows": rows,
                "columns": {
                    field: [float(each) for each in shaped[:, :, index].ravel()]
                    for index, field in enumerate(FIELDS)
                },
            }
        )
    return {
        "fields": list(FIELDS),
        "cycle_s": CYCLE_S,
        "vectors": vectors,
        "refused": [
            {
                "name": "a part of a row",
                "axes": [0, 1],
                "bytes": msgspec.msgpack.encode(TelemetryBlock(1, 0.001, bytes(36))).hex(),
            }
        ],
    }
