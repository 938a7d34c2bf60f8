"""Motors in MIT mode, whatever their frames are: energized where they stand, followed, inverted, silent."""

from __future__ import annotations

import math

import pytest

from mcserver.drives.bus import DriveMode
from mcserver.errors import RuntimeFault
from mcserver.units import TURN
from tests.drives.mit_bench import MitBench, mit_machine

GAINS = "kp = 50.0\nkd = 1.0\n"
RANGES = {
    "damiao": "p_max = 12.5\nv_max = 30.0\nt_max = 10.0\n",
    "robstride": "v_max = 44.0\nt_max = 17.0\nkp_max = 500.0\nkd_max = 5.0\n",
}


@pytest.fixture(params=sorted(RANGES))
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def bench(kind: str, more: str = "", angle: float = 0.0) -> MitBench:
    return MitBench(mit_machine(kind, RANGES[kind] + GAINS + more), angle)


def test_it_is_energized_where_it_stands_and_follows_positions(kind: str) -> None:
    made = bench(kind, angle=40.0).boot().energize()
    assert made.degrees == pytest.approx(40.0, abs=0.03)
    assert made.motor.motor.position * 360.0 == pytest.approx(40.0, abs=0.05)
    for cycle in range(500):
        made.exchange(
            DriveMode.POSITION, position=math.radians(40.0 + 0.1 * cycle), velocity=math.radians(100)
        )
    made.exchange(DriveMode.POSITION, 200, velocity=0.0)
    assert made.degrees == pytest.approx(40.0 + 49.9, abs=0.5)


def test_an_inverted_motor_turns_the_other_way(kind: str) -> None:
    made = bench(kind, "invert = true\n").boot().energize()
    made.exchange(DriveMode.POSITION, 300, position=0.2)
    assert made.feedback.position[0] == pytest.approx(0.2, abs=0.02)
    assert made.motor.motor.position * TURN == pytest.approx(-0.2, abs=0.02)


def test_a_motor_that_is_silent_is_said_to_be(kind: str) -> None:
    made = bench(kind)
    made.motor.wrong.mute = True
    with pytest.raises(RuntimeFault, match="MC411: "):
        made.boot()
