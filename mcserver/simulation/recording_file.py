"""A recorded run as CSV and NPZ (interfaces: ``--output``)."""

from __future__ import annotations

from typing import Any, BinaryIO

import msgspec
import numpy as np

from mcserver.simulation.recorder import Recorded

_ROWS_AT_ONCE = 4096


def write_csv(recording: Recorded, stream: BinaryIO) -> None:
    """Header ``time_s,line,setpoint_0,actual_0,…`` and one row a cycle; numbers read back exactly.

    Tools follow the axes: ``tool_3_x,tool_3_y,tool_3_z,tool_3_a,tool_3_b,tool_3_c``, then inputs and
    outputs by their names: ``input_door,output_lamp``.

    msgspec writes the shortest decimal that gives the same double, some ten times as fast as formatting
    by ``%``: the rows are encoded as JSON arrays and the brackets taken off.
    """
    names = ["time_s", "line"]
    for axis in recording.axes:
        names += [f"setpoint_{int(axis)}", f"actual_{int(axis)}"]
    for tool in recording.tools:
        names += [f"tool_{tool}_{letter}" for letter in "xyzabc"]
    names += [f"input_{name}" for name in recording.inputs]
    names += [f"output_{name}" for name in recording.outputs]
    stream.write(",".join(names).encode() + b"\n")
    count = len(recording.time_s)
    interleaved = np.empty((count, 2 * len(recording.axes)))
    interleaved[:, 0::2] = recording.setpoint
    interleaved[:, 1::2] = recording.actual
    channels = [each[:, np.newaxis] for each in (*recording.inputs.values(), *recording.outputs.values())]
    numbers = np.concatenate([interleaved, *recording.tools.values(), *channels], axis=1)
    line = recording.line.astype(np.int64)
    encoder = msgspec.json.Encoder()
    for first in range(0, count, _ROWS_AT_ONCE):
        part = slice(first, first + _ROWS_AT_ONCE)
        columns = [recording.time_s[part].tolist(), line[part].tolist()]
        columns += [column.tolist() for column in numbers[part].T]
        rows = encoder.encode(list(zip(*columns, strict=True)))
        stream.write(rows[2:-2].replace(b"],[", b"\n").replace(b"null", b"nan") + b"\n")


def write_npz(recording: Recorded, stream: BinaryIO) -> None:
    """Arrays ``time_s``, ``line``, ``axes``, ``setpoint``, ``actual``, ``tool_3`` of each tool: float64.

    Inputs and outputs are ``input_door``, ``output_lamp``, shape (N,).
    """
    arrays = {
        "time_s": recording.time_s,
        "line": recording.line,
        "axes": recording.axes,
        "setpoint": recording.setpoint,
        "actual": recording.actual,
    }
    arrays |= {f"tool_{tool}": poses for tool, poses in recording.tools.items()}
    arrays |= {f"input_{name}": values for name, values in recording.inputs.items()}
    arrays |= {f"output_{name}": values for name, values in recording.outputs.items()}
    converted: dict[str, Any] = {
        name: np.asarray(values, dtype=np.float64) for name, values in arrays.items()
    }
    np.savez(stream, **converted)
