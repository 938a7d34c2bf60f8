"""A bus full of frames that nobody should send: what goes out to a drive stays lawful."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator

import pytest

from mcserver.can.cob import NMT, SYNC, Function
from mcserver.can.pdo_layout import RPDO1, RPDO2, TPDO1
from mcserver.drives.bus import DriveMode, DriveState
from mcserver.drives.cia402.profile_position import HALT, NEW_SETPOINT
from tests.drives.can_rig import Bench
from tests.drives.profile_drive import ProfileDrive, agreed
from tests.drives.torque_drive import torque_bench

NODE, CYCLES, SEEDS = 1, 150, 6
COMMANDS = (DriveMode.POSITION, DriveMode.POSITION, DriveMode.OFF, DriveMode.RESET, DriveMode.STOP)
GOALS_M = (0.01, -0.02, 1e9, math.nan)
COUNTS_OF_GOALS = {10_000, -20_000}
OF_THE_NODE = (
    *(Function.TPDO1 + NODE, Function.TPDO2 + NODE, Function.TPDO3 + NODE, Function.EMCY + NODE),
    *(Function.HEARTBEAT + NODE, Function.RPDO1 + NODE, Function.RPDO2 + NODE, NMT, SYNC, 0x77F),
)
WORDS, MODES = (0x0237, 0x0250, 0x0231, 0x0233, 0x0218, 0x1237), (0, 1, 8, 9, 10)


def hostile(chance: random.Random) -> tuple[int, bytes]:
    """A frame of any length, or a TPDO1 that says something else than the drive does."""
    if chance.random() < 0.3:
        count = chance.randrange(-(2**31), 2**31) if chance.random() < 0.3 else chance.randrange(-3000, 3000)
        payload = TPDO1.packing.pack(chance.choice(WORDS), chance.choice(MODES), count)
        return Function.TPDO1 + NODE, payload
    return chance.choice((*OF_THE_NODE, chance.randrange(0x800))), chance.randbytes(chance.randrange(9))


def attacked(bench: Bench, chance: random.Random) -> Iterator[tuple[DriveState, list[tuple[int, bytes]]]]:
    """Cycles with hostile frames, silence and commands at random: state and frames that were sent."""
    bench.tell(DriveMode.POSITION)
    for _ in range(CYCLES):
        if chance.random() < 0.15:
            bench.port.waiting += [hostile(chance) for _ in range(chance.randrange(1, 4))]
        if chance.random() < 0.02:
            bench.drives[0].muted = not bench.drives[0].muted
        if chance.random() < 0.02:
            bench.tell(chance.choice(COMMANDS))
        if chance.random() < 0.05:
            bench.setpoints.goal[:], bench.setpoints.goal_speed[:] = chance.choice(GOALS_M), 0.1
        before = len(bench.port.sent)
        bench.exchange()
        yield DriveState(int(bench.feedback.state[0])), bench.port.sent[before:]


@pytest.mark.parametrize("seed", range(SEEDS))
def test_no_torque_goes_to_a_drive_that_is_not_energized_and_none_beyond_its_limit(seed: int) -> None:
    for state, sent in attacked(torque_bench(), random.Random(seed)):
        for identifier, payload in sent:
            if identifier == Function.RPDO2 + NODE:
                word, _, torque = RPDO2.packing.unpack(payload)
                assert abs(torque) <= 1000
                assert not torque or (word & 0xF == 0xF and state is DriveState.ENERGIZED)


@pytest.mark.parametrize("seed", range(SEEDS))
def test_a_drive_is_never_let_go_to_another_point_than_those_it_was_given(seed: int) -> None:
    for _, sent in attacked(Bench(agreed(), (1000,), ProfileDrive), random.Random(seed)):
        for identifier, payload in sent:
            if identifier == Function.RPDO1 + NODE:
                word, _, target = RPDO1.packing.unpack(payload)
                free = word & NEW_SETPOINT and not word & HALT
                assert not free or target in COUNTS_OF_GOALS


def test_the_frames_are_hostile_enough_to_latch_a_fault() -> None:
    faults = set()
    for seed in range(SEEDS):
        bench = torque_bench()
        for _ in attacked(bench, random.Random(seed)):
            faults.add(int(bench.feedback.fault[0]))
    assert len(faults) > 2
