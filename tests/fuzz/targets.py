"""What takes bytes from outside: each target may refuse its input with its own error, and nothing else."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from mcclient.errors import ProtocolError
from mcclient.types import MachineStatus
from mcclient.wire import decode as client_decode

from mcserver.canopen.eds import parse_description
from mcserver.canopen.esi import parse_esi
from mcserver.errors import ConfigurationError, ProgramRejected, ServiceError
from mcserver.gateway import frames
from mcserver.gcode.program_check import check_program
from mcserver.language.format import format_program
from mcserver.machine.machine_file import load_machine, parse_machine
from mcserver.net.decoding import MessageDecoder
from mcserver.net.keys import Keys
from mcserver.net.schemas import message_types
from mcserver.ros.interfaces import MalformedPayload, interfaces
from mcserver.ros.outcome import InvalidGoal
from mcserver.ros.tolerances import read_tolerances
from mcserver.ros.trajectory import Motion, read_trajectory
from tests.canopen.esi_files import esi
from tests.ros.goal_payloads import ROS_GOAL, ROS_JOINTS, ros_goal_payload

REPOSITORY = Path(__file__).parents[2]


class Target(msgspec.Struct, frozen=True):
    """One place where bytes come in.

    Attributes:
        run: takes an input. refusals: what it may raise. seeds: inputs that it understands, or nearly.
        share: of the inputs, beside the other targets'.
    """

    run: Callable[[bytes], object]
    refusals: tuple[type[Exception], ...]
    seeds: Sequence[bytes]
    share: int = 1


def targets() -> dict[str, Target]:
    """All of them by name."""
    programs = _programs()
    return {
        "messages": Target(_messages(), (ServiceError,), _message_seeds(), share=40),
        "keys": Target(
            _keys,
            (),
            [b"mc/@v1/bench/@rpc/alice/status", b"mc/@v1/*/in/a.b/p-1", b"mc/@v1/**/estop"],
            share=10,
        ),
        "program check": Target(_check("cartesian"), (), programs, share=10),
        "program check with tools": Target(_check("robot-dog"), (), programs, share=2),
        "program format": Target(_format, (), programs, share=4),
        "machine file": Target(_machine, (ConfigurationError,), _machines(), share=4),
        "EDS": Target(
            _eds, (ConfigurationError,), [_first(REPOSITORY / "mcserver/drive_sim/cia402.eds")], share=4
        ),
        "ESI": Target(
            lambda data: parse_esi(data, 5, "drive.xml"), (ConfigurationError,), [esi().encode()], share=4
        ),
        "gateway frames": Target(
            _frames(), (msgspec.MsgspecError, ValueError, RecursionError), _frame_seeds(), share=10
        ),
        "client": Target(
            lambda data: client_decode(MachineStatus, data), (ProtocolError,), _message_seeds(), share=10
        ),
        "ROS goals": Target(_ros_goal, (MalformedPayload, InvalidGoal), [ros_goal_payload()], share=10),
    }


def _ros_goal(data: bytes) -> None:
    goal = interfaces().decode(ROS_GOAL, data).goal
    trajectory = read_trajectory(goal.trajectory, ROS_JOINTS)
    read_tolerances(goal, trajectory.joints)
    still = np.zeros(len(trajectory.joints))
    Motion(trajectory, 0.0, still, still)


def _messages() -> Callable[[bytes], object]:
    decoders = [MessageDecoder(kind) for kind in message_types().values()]

    def run(data: bytes) -> None:
        # one input goes to one decoder, chosen by the input: the same input is the same run
        decoders[sum(data[:8]) % len(decoders)](data)

    return run


def _message_seeds() -> list[bytes]:
    encode = msgspec.msgpack.encode
    some: list[Any] = [
        {"request": 1, "program": "a-1", "first": 1, "lines": ["G01 X1", "M02"]},
        {"request": 2, "name": "demo", "axes": [0, 1], "before": ["G90"], "on_disconnect": "stop"},
        {"request": 3, "axis": 2, "distance": -1.5, "velocity": 10.0, "hold_s": 0.5},
        {"text": "G01 X1", "positions": {"0": 1.0}},
        {"percent": 50.0, "program": None, "request": 2**63},
        [1, ["G01 X1"] * 5],
        [7, 0.5, b"\x00" * 40],
        {
            "t": 1.0,
            "state": "ready",
            "axes": {"index": [0], "position": [1.0]},
            "programs": [{}],
            "faults": [],
        },
        {
            "client": "panel",
            "reason": "fire",
            "code": "MC500",
            "message": "x",
            "details": {"a": [1, {"b": None}]},
        },
    ]
    return [encode(each) for each in some]


def _keys(data: bytes) -> None:
    text = data.decode("utf-8", "replace")
    keys = Keys("bench")
    call = keys.call_of(text)
    assert call is None or "/" not in call.client + call.method
    keys.stream_of(text)
    keys.is_stop(text)


def _programs() -> list[bytes]:
    folders = ("tests/golden", "tests/corpus", "examples")
    return [_first(path) for folder in folders for path in sorted((REPOSITORY / folder).glob("*.gcode"))]


def _first(path: Path, size: int = 2000) -> bytes:
    # the beginning: mutations of long texts are slow and find no more
    return path.read_bytes()[:size]


def _check(name: str) -> Callable[[bytes], object]:
    from mcserver.machine.machine_kinematics import build_kinematics

    machine = load_machine(name)
    kinematics = build_kinematics(machine)

    def run(data: bytes) -> None:
        text = data.decode("utf-8", "replace")
        lines = text.count("\n") + text.count("\r") + 1
        for diagnostic in check_program(text, machine, kinematics):
            assert diagnostic.code.startswith("MC"), diagnostic
            assert 0 <= diagnostic.line <= lines, diagnostic

    return run


def _format(data: bytes) -> None:
    text = data.decode("utf-8", "replace")
    try:
        once = format_program(text)
    except ProgramRejected:
        return
    assert format_program(once) == once, "formatting twice is not formatting once"


def _machine(data: bytes) -> None:
    parse_machine(data.decode("utf-8", "replace"))


def _machines() -> list[bytes]:
    written = [_first(path, 3000) for path in sorted((REPOSITORY / "mcserver/machine").rglob("*.toml"))]
    return [each for each in written if b"[machine]" in each]


def _eds(data: bytes) -> None:
    parse_description(data.decode("latin-1"), 5)


def _frames() -> Callable[[bytes], object]:
    return msgspec.msgpack.Decoder(frames.Request).decode


def _frame_seeds() -> list[bytes]:
    encode = msgspec.msgpack.encode
    return [
        encode({"op": "call", "id": 1, "machine": "bench", "method": "status", "params": {"a": 1}}),
        encode({"op": "subscribe", "id": 2, "machine": "bench", "topic": "state"}),
        encode({"op": "estop", "id": 3, "machine": "bench", "reason": "x"}),
        encode({"op": "machines", "id": 4}),
    ]
