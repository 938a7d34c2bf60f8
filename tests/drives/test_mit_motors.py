"""Motors in MIT mode, whatever their frames are: energized where they stand, followed, stopped, silent."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest

from mcserver.drive_sim.streamed_node import BOOT_S
from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from mcserver.drives.damiao import codec as damiao
from mcserver.drives.robstride import codec as robstride
from mcserver.errors import RuntimeFault
from mcserver.units import TURN
from tests.drives.mit_bench import MitBench, mit_machine

GAINS = "kp = 50.0\nkd = 1.0\n"


@dataclass(frozen=True)
class Family:
    """How one kind says it.

    Attributes:
        ranges: keys of the machine file. off, let_go: what a motor says that is disabled, and whose time-out
            has ended. exact: to which its frames say a velocity or a torque. cycles: in which it has not been
            looked at wholly after its power came.
    """

    kind: str
    ranges: str
    off: str
    let_go: str
    exact: float
    cycles: int

    def bench(self, more: str = "", angle: float = 0.0) -> MitBench:
        return MitBench(mit_machine(self.kind, self.ranges + GAINS + more), angle)

    def commanded(self, bench: MitBench) -> tuple[float, ...]:
        """Position, velocity, kp, kd and torque of the latest command."""
        identifier, payload = bench.port.sent[-1]
        ranges = bench.described.axes[0].drive.ranges  # type: ignore[attr-defined]
        if isinstance(ranges, damiao.Ranges):
            return ranges.decode_command(payload)
        assert isinstance(ranges, robstride.Ranges)
        return ranges.decode_command(identifier, payload)

    def orders(self, bench: MitBench) -> list[str]:
        """What was sent, as far as it energizes the motor or writes to it."""
        return [self._order(*frame) for frame in bench.port.sent]

    def _order(self, identifier: int, payload: bytes) -> str:
        if self.kind == "damiao":
            writes = identifier == damiao.REGISTERS and payload[2] == damiao.WRITE
            enables = identifier == 3 and payload == damiao.Order.ENABLE.payload
        else:
            writes, enables = (
                identifier >> 24 & 0x1F == kind for kind in (robstride.Kind.WRITE, robstride.Kind.ENABLE)
            )
        return "write" if writes else "enable" if enables else ""


FAMILIES = (
    Family(
        "damiao", "p_max = 12.5\nv_max = 30.0\nt_max = 10.0\n", "DISABLED", "COMMUNICATION_LOST", 0.01, 10
    ),
    Family(
        "robstride",
        "v_max = 44.0\nt_max = 17.0\nkp_max = 500.0\nkd_max = 5.0\n",
        "RESET",
        "RESET",
        0.001,
        5,
    ),
)


@pytest.fixture(params=FAMILIES, ids=lambda family: family.kind)
def family(request: pytest.FixtureRequest) -> Family:
    made = request.param
    assert isinstance(made, Family)
    return made


def test_it_is_energized_where_it_stands_and_follows_positions(family: Family) -> None:
    made = family.bench(angle=40.0).boot().energize()
    assert made.degrees == pytest.approx(40.0, abs=0.03)
    assert made.motor.motor.position * 360.0 == pytest.approx(40.0, abs=0.05)
    for cycle in range(500):
        made.exchange(
            DriveMode.POSITION, position=math.radians(40.0 + 0.1 * cycle), velocity=math.radians(100)
        )
    made.exchange(DriveMode.POSITION, 200, velocity=0.0)
    assert made.degrees == pytest.approx(40.0 + 49.9, abs=0.5)


def test_an_inverted_motor_turns_the_other_way(family: Family) -> None:
    made = family.bench("invert = true\n").boot().energize()
    made.exchange(DriveMode.POSITION, 300, position=0.2)
    assert made.feedback.position[0] == pytest.approx(0.2, abs=0.02)
    assert made.motor.motor.position * TURN == pytest.approx(-0.2, abs=0.02)


def test_a_motor_that_is_silent_is_said_to_be(family: Family) -> None:
    made = family.bench()
    made.motor.wrong.mute = True
    with pytest.raises(RuntimeFault, match="MC411: "):
        made.boot()


def test_speeds_and_torques_go_without_stiffness_and_a_stop_brakes_by_damping(family: Family) -> None:
    made = family.bench().boot().energize()
    made.exchange(DriveMode.TORQUE, torque=2.0)
    assert family.commanded(made)[2:] == pytest.approx((0.0, 0.0, 2.0), abs=family.exact)
    made.exchange(DriveMode.VELOCITY, velocity=1.0, torque=0.0)
    assert family.commanded(made)[1:3] == pytest.approx((1.0, 0.0), abs=family.exact)
    made.exchange(DriveMode.VELOCITY, 200, velocity=3.0)
    assert family.commanded(made)[1:] == pytest.approx((3.0, 0.0, 1.0, 0.0), abs=family.exact)
    made.exchange(DriveMode.STOP)
    assert made.feedback.state[0] == DriveState.STOPPING
    assert family.commanded(made)[1:] == pytest.approx((0.0, 0.0, 1.0, 0.0), abs=family.exact)
    assert family.commanded(made)[2] == pytest.approx(0.0)
    made.exchange(DriveMode.STOP, 1000)
    assert made.feedback.state[0] == DriveState.OFF
    made.exchange(DriveMode.OFF, 3)
    assert made.motor.describe()["power"] == family.off


def test_a_motor_whose_master_is_gone_lets_go_at_its_time_out(family: Family) -> None:
    made = family.bench().boot().energize()
    made.exchange(DriveMode.SILENT)
    made.pass_time(0.1)
    assert made.motor.describe()["power"] == family.let_go


@pytest.mark.parametrize("seen", [True, False])
def test_a_motor_that_was_switched_off_and_on_gets_its_time_out_again(family: Family, seen: bool) -> None:
    made = family.bench().boot().energize()
    made.motor.switch_on(made.now)
    made.port.sent.clear()
    if not seen:
        made.pass_time(2.0 * BOOT_S)
    made.exchange(DriveMode.POSITION, family.cycles)
    wanted = (DriveState.FAULT, DriveFault.COMMUNICATION) if seen else (DriveState.STARTING, DriveFault.NONE)
    assert (made.state, made.feedback.fault[0]) == wanted
    assert made.motor.timeout_s == 0.0
    made.exchange(DriveMode.RESET, 100)
    made.energize()
    orders = family.orders(made)
    assert "write" not in orders[orders.index("enable") :]
    assert made.motor.timeout_s == pytest.approx(0.02)


def test_a_reading_that_jumps_is_a_lost_position_and_the_motor_brakes(family: Family) -> None:
    made = family.bench().boot().energize()
    made.exchange(DriveMode.VELOCITY, 200, velocity=3.0)
    made.motor.motor.position += 0.5
    made.exchange(DriveMode.POSITION, 2)
    assert (made.state, made.feedback.fault[0]) == (DriveState.FAULT, DriveFault.POSITION_LOST)
    # it brakes by damping, without a position, and is disabled then
    assert family.commanded(made)[1:4] == pytest.approx((0.0, 0.0, 1.0), abs=0.01)
    made.exchange(DriveMode.OFF, 1000)
    assert made.motor.describe()["power"] == family.off
