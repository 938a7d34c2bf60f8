"""Control entries from the planner to the executor, and events from the executor.

Each program has a time axis of its own, u, counted in cycles from its start. Setpoint rows exist at integer
u; control entries are at any u, in order. Each cycle the executor advances u by the playback rate. At a rate
of 1 without waits, u is an integer at every cycle and rows are played exactly; else they are interpolated
(`mcserver.motion.kernels.row_interpolation`).
"""

from __future__ import annotations

import enum

import msgspec
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class ControlKind(enum.IntEnum):
    """Kinds of control entries; ``values`` has one number an axis of the machine (by column)."""

    LINE_START = 1  # line begins at u (report its time)
    LINE_END = 2  # line has ended at u
    BEGIN = 3  # rows for ``axes`` follow: all must be energized (D-27) and free of independent motion
    END = 4  # rows for ``axes`` end at u: the axes hold ``values``, or their last setpoint without
    WAIT = (
        5  # u stops here until ``axes`` have ended independent motion and are in position (exact stop, D-34)
    )
    DWELL = 6  # u stops here for ``seconds``, which pass at the rate of holds (not of overrides)
    RAPID = 7  # independent motion of ``axes`` to ``values`` [m, rad] at the axes' own limits; energizes
    SPEED = 8  # velocity mode [m/s, rad/s]; ``values`` per axis; of a spindle also by the radius
    TORQUE = 9  # torque mode [N·m]; ``values`` per axis
    AXIS = 10  # axis operation ``operation`` on ``axes`` (D-40)
    HALT_AXES = (
        11  # bring independent motion, speed or torque on ``axes`` to rest in position mode, then u goes on
    )
    PAUSE = 12  # M00, M01: u stops here until resumed
    FINISH = 13  # the program has ended; its slot is free once this is passed
    HOME = 20  # ``axes`` find their references together; u stands until they are homed
    REFERENCE = 21  # ``axes`` are at ``values`` from here on; nothing moves
    PROBE = 22  # ``axes`` go straight to ``values`` until the probe changes
    PASSED = 24  # every line through ``line`` has ended: reported, so that it counts as done
    TOOL = 28  # tool ``operation`` is in the spindle from u on, 0: none: its shapers count
    ADVANCE = 29  # pressure advance of E is ``value`` [s] from u on
    MESH = 30  # the mesh of a printer's bed counts as ``operation`` says (`MeshUse`) from u on
    PAYLOAD = 23  # tools of ``operation`` are the chosen ones from u on: their payloads count in torques
    SETTLE = 14  # u stops here until the planner has read the positions (sync): acknowledged by ``token``
    OUTPUT = 15  # output ``channel`` is set to ``value``
    FOLLOW = 25  # u stops here while ``axes`` follow streamed targets, until no more are to come
    THREAD = 26  # ``axes`` go straight to ``values`` as the spindle turns; u stands until then
    FOLLOW_FROM = 27  # ``values`` are the least positions of the `FOLLOW` behind, whose own are the greatest
    INPUT = 16  # u stops here until input ``channel`` is as ``operation`` says (`WaitMode`), or ``seconds``


class Control(msgspec.Struct, frozen=True, gc=False):
    """One control entry.

    Attributes:
        kind: what to do.
        u: where on the program's time axis [cycles], not below the entry before.
        line: number of the G-code line that it belongs to.
        axes: bit mask over the machine's columns (bit 0 = first axis of the machine).
        values: shape (K,) for RAPID, SPEED and TORQUE, and for FOLLOW where it is bounded; for END optionally
            the final positions (without them the axes hold the row at or right after u); else None.
        seconds: for DWELL; for PROBE the speed along the line [m/s]; for THREAD the pitch [m]; for WAIT the
            time-out; for SPEED by constant surface speed that speed [m/s]; for OUTPUT of a laser the path
            speed of ``axes`` at which it has its value [m/s or rad/s], 0: not scaled.
        operation: for PROBE: a `ProbeKind`; for SPEED: 1 for constant surface speed by the position of
            column ``channel``, whose value is the position of the spindle's axis; for THREAD: 1 for tapping;
            for AXIS: index of the operation in ``list(AxisOperation)``; for MESH: a `MeshUse`; for FINISH: 1
            where a faulty line has ended the program, whose outputs become safe; for INPUT: a `WaitMode`;
            for PAYLOAD: tools, as bits of `mckinematics.dynamics.JointDynamics.bits_of`.
        token: for SETTLE: a number that the executor reports back with the positions; for PROBE 1 where the
            contact is a point of the bed mesh.
        channel: for OUTPUT and INPUT: column of the machine's output or input; for THREAD: of the spindle.
        value: for OUTPUT; for ADVANCE K [s]; for SPEED by constant surface speed the greatest [rad/s]; for
            THREAD the spindle's speed [1/s]; for FOLLOW the share of the acceleration limits that axes may
            use (and its root of the velocity limits), 0: all.
    """

    kind: ControlKind
    u: float
    line: int
    axes: int = 0
    values: tuple[float, ...] | None = None
    seconds: float = 0.0
    operation: int = 0
    token: int = 0
    channel: int = 0
    value: float = 0.0


class HomingPhase(enum.IntEnum):
    """What an axis does while it is homed: the token of a HOMING event."""

    START = 0
    RELEASE = 1  # off a switch that is active at the start
    APPROACH = 2  # fast to the switch, the index or the stop
    BACK_OFF = 3
    LATCH = 4  # slowly to it again
    INDEX = 5  # on to the index
    REFERENCE = 6  # coming to rest: the reference is given there
    DEPART = 7  # to `then_move_to`
    DRIVE = 8  # the drive homes itself
    HOLD = 9  # its own homing is over: back to position mode
    DONE = 10


class EventKind(enum.IntEnum):
    """What the executor reports; kept apart from telemetry and never dropped silently."""

    LINE_START = 1
    LINE_END = 2
    FINISHED = 3
    SETTLED = 4
    PAUSED = 5
    FAULT = 6
    AXIS_DONE = 7
    STARVED = 8  # the ring ran dry inside a motion; held on the path
    HOMING = 20  # ``axis`` begins a phase of its homing: ``token``, a `HomingPhase`
    HOMED = 21  # ``axis`` has its reference: ``values`` are its offset and what its encoder reads
    UNHOMED = 22  # ``axis`` has lost its reference
    PROBED = 23  # a probing move has ended: ``token`` is 1 if it tripped, ``values`` the positions (K,)
    STOPPED = 9  # the program was aborted or stopped by a fault and its axes are at rest
    INPUT = 10  # M66 has read an input
    PASSED = 24  # every line through ``line`` has ended
    INPUT_WAIT = 25  # M66 begins to wait for an input
    MESHED = 26  # the mesh of the bed counts otherwise: ``token`` is a `MeshUse`


class ExecutorEvent(msgspec.Struct, frozen=True, gc=False):
    """One report.

    Attributes:
        kind: what happened.
        program: slot of the program (-1: the machine).
        line: G-code line (0: none).
        time: executor time [s], not rounded to the cycle.
        code: for FAULT: the stable code (number behind MC).
        axis: for FAULT: axis number, else -1.
        token: for SETTLED, HOMING, PROBED and MESHED; for INPUT and INPUT_WAIT: column of the input; for
            PAUSED: mask of the columns that others may move until it is confirmed; of a FAULT before a
            switched zone: 1 if it moved; of STOPPED: 1 within a thread.
        values: for SETTLED: (setpoints (K,), encoder positions (K,)); for FAULT: (value, limit); for INPUT:
            (value, seconds that were waited).
    """

    kind: EventKind
    program: int
    line: int
    time: float
    code: int = 0
    axis: int = -1
    token: int = 0
    values: tuple[float, ...] = ()
