"""Machines as robots of LeRobot, on a real server; where LeRobot is not installed, a stand-in is led."""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
import time
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import TYPE_CHECKING, Any

import pytest
from mcclient import ProgramAborted, RequestRefused
from mcclient.sync import Machine

from tests.e2e.servers import ServerProcess

if TYPE_CHECKING:
    from lerobot_robot_mcserver import McserverRobot

MakeRobot = Callable[..., "McserverRobot"]


def stand_in() -> dict[str, ModuleType]:
    """What of LeRobot the package imports, in the form of its release 0.6.1."""

    @dataclasses.dataclass(kw_only=True)
    class RobotConfig:
        id: str | None = None

        @classmethod
        def register_subclass(cls, _name: str) -> Callable[[type], type]:
            return lambda subclass: subclass

    class Robot:
        def __init__(self, config: RobotConfig) -> None:
            self.id = config.id

    def checked(connected: bool) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
        def decorate(method: Callable[..., Any]) -> Callable[..., Any]:
            def call(self: Any, *arguments: Any, **options: Any) -> Any:
                if self.is_connected is not connected:
                    raise ConnectionError
                return method(self, *arguments, **options)

            return call

        return decorate

    contents: dict[str, dict[str, Any]] = {
        "lerobot": {},
        "lerobot.cameras": {"CameraConfig": object},
        "lerobot.cameras.utils": {"make_cameras_from_configs": dict},
        "lerobot.robots": {"Robot": Robot, "RobotConfig": RobotConfig},
        "lerobot.utils": {},
        "lerobot.utils.decorators": {
            "check_if_not_connected": checked(True),
            "check_if_already_connected": checked(False),
        },
    }
    made = {}
    for name, content in contents.items():
        made[name] = ModuleType(name)
        vars(made[name]).update(content)
    return made


@pytest.fixture
def make_robot(server: ServerProcess, monkeypatch: pytest.MonkeyPatch) -> Iterator[MakeRobot]:
    """Connects robots of axes 0 and 1, and lets go of them."""
    if importlib.util.find_spec("lerobot") is None:
        for name, module in stand_in().items():
            monkeypatch.setitem(sys.modules, name, module)
    from lerobot_robot_mcserver import McserverRobot, McserverRobotConfig

    made = []

    def make(**options: Any) -> McserverRobot:
        config = McserverRobotConfig(**{"axes": [1, 0], "connect": server.endpoint} | options)
        robot = McserverRobot(config)
        robot.connect()
        made.append(robot)
        return robot

    yield make
    for robot in made:
        if robot.is_connected:
            robot.disconnect()


def lead(robot: McserverRobot, action: dict[str, float]) -> None:
    """Send an action over and over."""
    for _ in range(20):
        robot.send_action(action)
        time.sleep(0.02)


def test_a_robot_goes_where_its_actions_say_and_is_there(make_robot: MakeRobot) -> None:
    robot = make_robot()
    before = robot.get_observation()
    assert list(before) == list(robot.observation_features) == list(robot.action_features)
    assert list(before) == ["axis_1.pos", "axis_0.pos"]
    there = {"axis_1.pos": before["axis_1.pos"] + 2.0, "axis_0.pos": before["axis_0.pos"]}
    lead(robot, there)
    robot.disconnect()
    robot.connect()
    assert robot.get_observation() == pytest.approx(there, abs=1e-3)


def test_a_pause_is_gone_on_from_and_what_a_person_has_ended_is_not(
    make_robot: MakeRobot, server: ServerProcess
) -> None:
    robot = make_robot(counts_s=0.5)
    here = robot.get_observation()
    with Machine.connect(connect=server.endpoint) as person:
        lead(robot, here)
        time.sleep(1.5)
        lead(robot, here)
        person.abort()
    for _ in range(2):
        with pytest.raises(ProgramAborted):
            lead(robot, here)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"axis_0.pos": float("nan")}, "MC340"),
        ({"gripper.pos": 0.0}, "MC340"),
        # such as radians for degrees, or another unit of length
        ({"axis_0.pos": 250.0}, "MC341"),
    ],
)
def test_an_action_of_other_features_or_units_opens_nothing(
    make_robot: MakeRobot, server: ServerProcess, change: dict[str, float], code: str
) -> None:
    robot = make_robot()
    here = robot.get_observation()
    with pytest.raises(RequestRefused, match=code):
        robot.send_action(here | change)
    with Machine.connect(connect=server.endpoint) as machine:
        assert not [each for each in machine.programs() if each.state not in {"finished", "aborted"}]


def test_actions_lead_no_axis_beyond_its_bounds_and_what_is_sent_is_returned(make_robot: MakeRobot) -> None:
    place = make_robot().get_observation()
    low, high = ([place[f"axis_{axis}.pos"] + by for axis in (1, 0)] for by in (-1.0, 1.0))
    robot = make_robot(low=low, high=high)
    sent = robot.send_action(place | {"axis_0.pos": place["axis_0.pos"] + 5.0})
    assert sent["axis_0.pos"] == pytest.approx(place["axis_0.pos"] + 1.0)


@pytest.mark.parametrize("options", [{"axes": [0, 99]}, {"axes": [0, 0]}, {"low": [0.0, 0.0]}])
def test_a_robot_of_other_axes_is_refused(make_robot: MakeRobot, options: dict[str, Any]) -> None:
    with pytest.raises(RequestRefused, match="MC340"):
        make_robot(**options)
