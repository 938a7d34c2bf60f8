"""The Python SDK's servo mode plays the contract's sequences of targets, without a network."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, cast

import msgspec
import pytest
from mcclient.errors import MotionError
from mcclient.keys import Keys
from mcclient.machine_calls import MachineCalls
from mcclient.servo import Servo
from mcclient.transport import Arrived, Link
from mcclient.types import ErrorReply, ProgramStatus, ServoReply
from mcclient.wire import decode

from tests.contract.vectors import names, read


class ScriptedServer:
    """Stands for link and calls: notes what is put, and says what the script says."""

    def __init__(self) -> None:
        self.sent: deque[list[Any]] = deque()
        self.status: list[ProgramStatus] = []
        self.deliver: Callable[[Arrived], None] = lambda _: None

    def subscribe(self, _key: str, deliver: Callable[[Arrived], None], **_: object) -> ScriptedServer:
        self.deliver = deliver
        return self

    def close(self) -> None:
        self.deliver = lambda _: None

    async def put(self, _key: str, payload: bytes, **_: object) -> None:
        self.sent.append(msgspec.msgpack.decode(payload))

    async def programs(self, **_: object) -> list[ProgramStatus]:
        return self.status


class Player:
    """Plays one sequence."""

    def __init__(self) -> None:
        self.server = ScriptedServer()
        self.now = 0.0
        self.servo: Servo
        self.failure: MotionError | None = None

    async def step(self, what: str, value: Any) -> None:
        match what:
            case "servo":
                self.servo = Servo(
                    decode(ServoReply, bytes.fromhex(value["bytes"])),
                    link=cast(Link, self.server),
                    keys=Keys("cell", "contract-1"),
                    calls=cast(MachineCalls, self.server),
                    counts_s=0.1,
                    on_return=lambda _call: lambda: None,
                    clock=lambda: self.now,
                )
            case "refused":
                error = decode(ErrorReply, bytes.fromhex(value["bytes"]))
                self.failure = MotionError(error.code, error.message, error.hint)
            case "targets":
                self.now, self.failure = value["sent"], None
                try:
                    await self.servo.send(
                        value["positions"],
                        value["velocities"],
                        times=value["times"],
                        counts_s=value["counts_s"],
                        tool=value["tool"],
                        frame=value["frame"],
                    )
                except MotionError as error:
                    self.failure = error
            case "puts":
                assert self.server.sent.popleft() == value
            case "lost":
                pass
            case "asked":
                self.server.status = [decode(ProgramStatus, bytes.fromhex(value["bytes"]))]
            case "counts":
                counted = (await self.servo.status()).servo
                assert {name: getattr(counted, name) for name in value} == value
            case "ack":
                self.server.deliver(Arrived("", bytes.fromhex(value["bytes"]), False))
            case "knows":
                assert self.servo.state == value["state"]
            case "fails":
                assert self.failure is not None
                assert self.failure.code == value["code"]
                assert value["says"] in self.failure.message
                assert not self.server.sent
            case _:
                raise AssertionError(f"there is no step {what}")


@pytest.mark.parametrize("name", names("targets"))
async def test_servo_mode_goes_as_the_contract_says(name: str) -> None:
    player = Player()
    for step in read(f"targets/{name}.json")["steps"]:
        ((what, value),) = step.items()
        await player.step(what, value)
