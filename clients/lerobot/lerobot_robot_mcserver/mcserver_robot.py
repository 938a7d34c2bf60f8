"""A machine as a robot of LeRobot: positions are observed and sent, in mm and degrees."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.robots import Robot
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected
from mcclient import MotionError, ProgramAborted, RequestRefused
from mcclient.lerobot_dataset import feature_of
from mcclient.sync import Machine, Servo
from mcclient.types import AxesStatus
from numpy.typing import NDArray

from lerobot_robot_mcserver.config_mcserver_robot import McserverRobotConfig

Array = NDArray[np.float64]

log = logging.getLogger(__name__)

# Longest wait for where the axes are [s].
STATUS_S = 1.0
# Reason of a program whose targets have ceased.
CEASED = "MC465"


class McserverRobot(Robot):
    """Axes of a machine that follow actions in servo mode.

    Servo mode is opened by the first action, so that a machine that something else moves can be observed. A
    pause between actions stops the axes, and the next action opens it again; whatever else ends it (a stop,
    a fault, a person) is raised and stays so until `connect` is called again.
    """

    config_class = McserverRobotConfig
    name = "mcserver"

    def __init__(self, config: McserverRobotConfig) -> None:
        super().__init__(config)
        self.config = config
        self.cameras = make_cameras_from_configs(config.cameras)
        self._names = [feature_of(axis) for axis in config.axes]
        self._machine: Machine | None = None
        self._servo: Servo | None = None

    @property
    def observation_features(self) -> dict[str, Any]:
        pictures = {name: (each.height, each.width, 3) for name, each in self.cameras.items()}
        return self.action_features | pictures

    @property
    def action_features(self) -> dict[str, type]:
        return dict.fromkeys(self._names, float)

    @property
    def is_connected(self) -> bool:
        return self._machine is not None and all(each.is_connected for each in self.cameras.values())

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:
        """Find the machine; nothing moves.

        Raises:
            MotionError: MC530 nobody answers, MC531 several machines are there, MC340 the machine has other
                axes, MC450 an axis is not homed.
        """
        config = self.config
        machine = Machine.connect(config.machine or None, config.connect or None, client="lerobot")
        try:
            _refuse_unfit(config, {axis.index for axis in machine.info.axes})
            self._machine = machine
            if calibrate and not self.is_calibrated:
                self.calibrate()
            for camera in self.cameras.values():
                camera.connect()
        except BaseException:
            self._machine = None
            machine.close()
            raise

    @property
    def is_calibrated(self) -> bool:
        """Whether all axes know where they are."""
        axes = self._status()
        return all(axes.homed[column] for column in self._columns(axes))

    def calibrate(self) -> None:
        """Begin nothing: homing moves the machine. Raises MC450 where an axis is not homed."""
        if not self.is_calibrated:
            raise RequestRefused("MC450", "an axis is not homed", "home the machine: mcctl home")

    def configure(self) -> None:
        """Do nothing: the machine file has it all."""

    @check_if_not_connected
    def get_observation(self) -> dict[str, Any]:
        """Return where the axes are [mm, deg], and the cameras' pictures."""
        found: dict[str, Any] = dict(zip(self._names, self._positions().tolist(), strict=True))
        return found | {name: camera.read_latest() for name, camera in self.cameras.items()}

    @check_if_not_connected
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Send where the axes are to be [mm, deg]; returned is the same within their travel.

        Raises:
            MotionError: MC340 an action of other features, or of numbers that are not finite; MC341 the first
                one is far from where the axes are; as of `mcclient.Servo.send` and `mcclient.Machine.servo`.
        """
        unfit = set(self._names) ^ set(action) or {
            name for name, value in action.items() if not np.isfinite(float(value))
        }
        if unfit:
            raise RequestRefused(
                "MC340",
                f"an action does not fit in {', '.join(sorted(unfit))}",
                f"give {', '.join(self._names)}, finite numbers of mm and degrees",
            )
        wanted = np.array([float(action[name]) for name in self._names]).clip(*self._bounds())
        if self._servo is None or not self._send(self._servo, wanted):
            self._servo = self._opened(wanted)
            self._send(self._servo, wanted)
        return dict(zip(self._names, wanted.tolist(), strict=True))

    @check_if_not_connected
    def disconnect(self) -> None:
        """Let the axes rest at the last action, and let go of them."""
        machine, servo = self._connected, self._servo
        try:
            if servo is not None:
                servo.close()
        except MotionError as error:
            log.warning("%s", error)
        finally:
            self._machine = self._servo = None
            machine.close()
            for camera in self.cameras.values():
                camera.disconnect()

    # ------------------------------------------------------------------ servo mode

    def _opened(self, wanted: Array) -> Servo:
        axes, away = self.config.axes, np.abs(wanted - self._positions())
        worst = int(np.argmax(away))
        if not away[worst] <= self.config.start_within:
            raise RequestRefused(
                "MC341",
                f"the first action has axis {axes[worst]} {away[worst]:.1f} mm or deg from where it is",
                "bring the machine there, or raise --robot.start_within; are actions in mm and degrees?",
            )
        low, high = self.config.low, self.config.high
        within = dict(zip(axes, zip(low, high, strict=True), strict=True)) if low else None
        return self._connected.servo(axes, name="LeRobot", within=within, counts_s=self.config.counts_s)

    def _send(self, servo: Servo, wanted: Array) -> bool:
        """Send targets; False: servo mode has ended by a pause."""
        places = dict(zip(self.config.axes, wanted.tolist(), strict=True))
        try:
            servo.send([places[axis] for axis in servo.axes])
        except ProgramAborted as error:
            if CEASED not in str(error):
                raise
            return False
        return True

    def _bounds(self) -> tuple[Array, Array]:
        """Return the ends of travel, or the configured ones within, shape (n,) each [mm or deg]."""
        found = {axis.index: (axis.min_position, axis.max_position) for axis in self._connected.info.axes}
        low, high = zip(*(found[axis] for axis in self.config.axes), strict=True)
        least = np.array([-np.inf if each is None else each for each in low])
        most = np.array([np.inf if each is None else each for each in high])
        return np.maximum(least, self.config.low or -np.inf), np.minimum(most, self.config.high or np.inf)

    # ------------------------------------------------------------------ where the axes are

    @property
    def _connected(self) -> Machine:
        assert self._machine is not None
        return self._machine

    def _status(self) -> AxesStatus:
        return self._connected.status(deadline_s=STATUS_S).axes

    def _columns(self, axes: AxesStatus) -> list[int]:
        return [axes.index.index(axis) for axis in self.config.axes]

    def _positions(self) -> Array:
        axes = self._status()
        return np.array([axes.position[column] for column in self._columns(axes)])


def _refuse_unfit(config: McserverRobotConfig, known: set[int]) -> None:
    count, bounds = len(config.axes), (len(config.low), len(config.high))
    if (
        not set(config.axes) <= known
        or len(set(config.axes)) != count
        or bounds not in ((0, 0), (count, count))
    ):
        raise RequestRefused(
            "MC340",
            f"axes {config.axes} from {config.low} to {config.high} do not fit the machine's {sorted(known)}",
            "name axes of the machine, each once, and low and high of all of them or of none",
        )
