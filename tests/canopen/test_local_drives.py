"""The service path and the cycle against python-canopen's own slaves, over EDS files written for it."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mcserver.canopen.canopen_errors import DriveError
from mcserver.canopen.service import CanopenService
from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import Machine
from tests.canopen.cycle_on_bus import Cycle
from tests.canopen.eds_files import I16, U32, eds, entry
from tests.canopen.local_drives import LocalDrive, until
from tests.canopen.rig import RunningHub, Watched, machine_on

# python-canopen's own reader of EDS files
pytestmark = pytest.mark.filterwarnings("ignore:The 'warn' method is deprecated:DeprecationWarning")

INTERPOLATED = (
    "[60C1]\nParameterName=Interpolation data\nObjectType=0x9\n[60C1sub0]\nParameterName=Count\nDataType=5\n"
    "AccessType=ro\nDefaultValue=1\n[60C1sub1]\nParameterName=Setpoint\nDataType=4\nAccessType=rww\n"
    "DefaultValue=0\nPDOMapping=1\n"
)


class LocalCell:
    """Slaves that are not ours on a hub, and the service path that boots them."""

    def __init__(self, hub: RunningHub, watched: Watched, folder: Path) -> None:
        self.watched = watched
        self.folder = folder
        self.made: list[LocalDrive] = []
        self._hub = hub

    def drive(self, text: str, node: int = 1, **keys: object) -> LocalDrive:
        (self.folder / f"drive{node}.eds").write_text(text)
        self.made.append(LocalDrive(self._hub, text, node, **keys).start())  # type: ignore[arg-type]
        return self.made[-1]

    def machine(
        self, more: str = "", nodes: Sequence[int] = (1,), heartbeat_ms: int = 200, **on: Any
    ) -> Machine:
        keys = f'eds = "{self.folder}/drive1.eds"\ncommand_timeout_ms = 5000\nheartbeat_ms = {heartbeat_ms}\n'
        return machine_on(self._hub.address(), nodes, keys + more, bus="silence_cycles = 1000", **on)

    def start(self, more: str = "", **on: Any) -> CanopenService:
        return self.watched.start(self.machine(more, **on))

    @contextmanager
    def cycle(self, drive: LocalDrive, more: str = "", **on: Any) -> Iterator[Cycle]:
        """The executor's end of the bus."""
        machine = self.machine(more, **on)
        cycle = Cycle(self.watched.start(machine), machine, [drive])
        try:
            yield cycle
        finally:
            cycle.close()


@pytest.fixture
def cell(hub: RunningHub, watched: Watched, tmp_path: Path) -> Iterator[LocalCell]:
    made = LocalCell(hub, watched, tmp_path)
    yield made
    for each in made.made:
        each.close()


@pytest.mark.parametrize("fixed", [False, True])
def test_a_drive_with_the_default_mapping_of_the_profile_moves(cell: LocalCell, fixed: bool) -> None:
    drive = cell.drive(eds(fixed=fixed), positions=(777,))
    with cell.cycle(drive) as cycle:
        cycle.run(DriveMode.POSITION, DriveState.ENERGIZED)
        assert drive.targets[0][0] == 777
        cycle.setpoints.position[:] = cycle.feedback.position + 0.01
        until(lambda: bool(cycle.bus.exchange(cycle.setpoints)) and drive.position[0] > 4000, "motion")
        assert drive.position[0] == pytest.approx(777 + 4096, abs=1)
    mapped = {index for index, _, _ in drive.written if 0x1600 <= index < 0x1700}
    assert bool(mapped) is not fixed


def test_a_drive_without_csp_moves_by_interpolated_position(cell: LocalCell) -> None:
    drive = cell.drive(eds(without=[0x607A], changes={0x6502: {"DefaultValue": "0x40"}}, more=INTERPOLATED))
    with cell.cycle(drive, 'mode = "ip"') as cycle:
        cycle.run(DriveMode.POSITION, DriveState.ENERGIZED)
        until(lambda: bool(cycle.bus.exchange(cycle.setpoints)) and bool(drive.targets[0]), "interpolation")
        cycle.setpoints.position[:] = 0.01
        until(lambda: bool(cycle.bus.exchange(cycle.setpoints)) and drive.position[0] > 4000, "motion")
        assert set(drive.targets[0]) == {0, 4096}


PROFILE = (
    entry(0x6081, "Profile velocity", U32)
    + entry(0x6083, "Profile acceleration", U32)
    + entry(0x6084, "Profile deceleration", U32)
)


def profile_text() -> str:
    return eds(without=[0x60FF], changes={0x6502: {"DefaultValue": "0x21"}}, more=PROFILE)


def test_a_drive_that_has_profile_position_alone_goes_to_points(cell: LocalCell) -> None:
    drive = cell.drive(profile_text(), positions=(777,))
    with cell.cycle(drive, 'mode = "pp"') as cycle:
        assert drive.value(0x6083) == drive.value(0x6084) > 0
        cycle.run(DriveMode.POSITION, DriveState.ENERGIZED)
        cycle.setpoints.goal[:] = 0.01
        cycle.setpoints.goal_speed[:] = 0.02
        until(lambda: bool(cycle.bus.exchange(cycle.setpoints)) and drive.position[0] == 4096, "motion")
        assert drive.setpoints == [4096]
        assert drive.speeds == [8192]


def test_a_drive_that_has_torques_alone_follows_by_the_loop_that_is_closed_here(cell: LocalCell) -> None:
    text = eds(
        without=[0x607A, 0x60FF],
        changes={0x6502: {"DefaultValue": "0x200"}},
        more=entry(0x6071, "Target torque", I16),
    )
    drive = cell.drive(text, positions=(777,))
    keys, axis_keys = 'mode = "cst"\nrated_torque = 1.0\ninertia = 1e-3', "max_following_error = 20.0"
    # cycles go as the drive answers here: a thread that sends heartbeats by the clock may be late for them
    with cell.cycle(drive, keys, heartbeat_ms=0, axis_keys=axis_keys) as cycle:
        cycle.run(DriveMode.POSITION, DriveState.ENERGIZED)
        assert set(drive.torques) <= {0}
        start = float(cycle.setpoints.position[0])
        for step in range(121):
            # 10 mm in a second, and 0.2 s at its end
            share = min(step / 100, 1.0)
            cycle.setpoints.position[:] = start + 0.01 * share * share * (3.0 - 2.0 * share)
            before = drive.answered
            cycle.bus.exchange(cycle.setpoints)
            until(lambda seen=before: drive.answered > seen, "an answer")
        assert cycle.feedback.fault[0] == DriveFault.NONE
        assert drive.position[0] == pytest.approx(777 + 4096, abs=200)
        assert max(map(abs, drive.torques)) < 1000


def test_a_local_drive_that_acknowledges_nothing_is_a_fault_and_does_not_move(cell: LocalCell) -> None:
    drive = cell.drive(profile_text(), positions=(777,))
    drive.acknowledges = False
    with cell.cycle(drive, 'mode = "pp"') as cycle:
        cycle.run(DriveMode.POSITION, DriveState.ENERGIZED)
        cycle.setpoints.goal[:] = 0.01
        cycle.run(DriveMode.POSITION, DriveState.FAULT)
        assert int(cycle.feedback.fault[0]) == DriveFault.SETPOINT
        assert drive.position[0] == 777


PINS = entry(0x60FD, "Digital inputs", U32) + (
    "[60FE]\nParameterName=Digital outputs\nObjectType=0x9\n[60FEsub0]\nParameterName=Count\nDataType=5\n"
    "AccessType=ro\nDefaultValue=2\n[60FEsub1]\nParameterName=Physical outputs\nDataType=7\nAccessType=rww\n"
    "DefaultValue=0\nPDOMapping=1\n[60FEsub2]\nParameterName=Bit mask\nDataType=7\nAccessType=rw\n"
    "DefaultValue=0\n"
)


def test_inputs_and_outputs_of_a_drive_are_the_machines(cell: LocalCell) -> None:
    drive = cell.drive(eds(more=PINS))
    channels = (
        '[[input]]\nnumber = 0\nname = "guard"\nsource = { drive = 0, bit = 17 }\n'
        '[[output]]\nnumber = 0\nname = "brake"\ntarget = { drive = 0, bit = 16 }\n'
    )
    raw, fresh = np.zeros(1), np.zeros(1, np.bool_)
    with cell.cycle(drive, channels) as cycle:
        assert (cycle.bus.inputs, cycle.bus.outputs) == ((0,), (0,))
        assert drive.value(0x60FE, 2) == 1 << 16
        drive.local.data_store.setdefault(0x60FD, {})[0] = struct.pack("<I", 1 << 17)
        cycle.bus.write_outputs(np.ones(1))

        def seen() -> bool:
            cycle.bus.exchange(cycle.setpoints)
            cycle.bus.read_inputs(raw, fresh)
            return raw[0] == 1.0 and drive.value(0x60FE, 1) == 1 << 16

        until(seen, "input and output")
        assert fresh[0]


def test_the_drive_homes_itself_and_its_position_is_read_afterwards(cell: LocalCell) -> None:
    drive = cell.drive(eds(), positions=(50_000,))
    homing = "[axis.drive.homing]\nmethod = 33\nposition = 2.5\nspeed_switch = 20.0\n"
    with cell.cycle(drive, homing) as cycle:
        assert drive.value(0x6098) == 33
        assert drive.value(0x607C) == 1024
        assert drive.value(0x6099, 1) == 8192
        cycle.run(DriveMode.HOMING, DriveState.HOMED)
        assert cycle.feedback.position[0] == pytest.approx(0.0025, abs=1e-5)
        cycle.run(DriveMode.POSITION, DriveState.ENERGIZED)
        assert drive.targets[0][0] == pytest.approx(1024, abs=1)


def test_two_axes_of_one_node_move_each_by_its_own_objects(cell: LocalCell) -> None:
    drive = cell.drive(eds(axes=2), positions=(100, 2000))
    with cell.cycle(drive, nodes=(1, 1), own_keys=("", "node_axis = 1\npdo_node = 9")) as cycle:
        cycle.run(DriveMode.POSITION, DriveState.ENERGIZED)
        cycle.run(DriveMode.POSITION, DriveState.ENERGIZED, 1)
        assert (drive.targets[0][0], drive.targets[1][0]) == (100, 2000)
        cycle.setpoints.position[1] += 0.01
        until(lambda: bool(cycle.bus.exchange(cycle.setpoints)) and drive.position[1] > 6000, "motion")
        assert drive.position[0] == 100
        assert drive.position[1] == pytest.approx(2000 + 4096, abs=1)


def test_monitored_objects_are_mapped_and_shown(cell: LocalCell) -> None:
    from mcserver.canopen.access import OperatorAccess

    drive = cell.drive(eds())
    with cell.cycle(drive, 'monitor = ["6079h:00 DC link voltage"]') as cycle:
        access = OperatorAccess(cell.watched.services[-1])
        try:
            until(
                lambda: bool(cycle.bus.exchange(cycle.setpoints)) and _shown(access) == 48000, "the voltage"
            )
        finally:
            access.close()


def _shown(access: object) -> object:
    (info,) = asyncio.run(access.drives())  # type: ignore[attr-defined]
    (shown,) = info.monitor
    return shown.value


def test_an_emergency_is_reported_for_its_sender_although_a_dcf_gives_it_another_s_cob_id(
    cell: LocalCell,
) -> None:
    text = eds(changes={0x1014: {"ParameterValue": "0x82"}, 0x1017: {"ParameterValue": "77"}})
    text += "[2000]\nParameterName=Node-ID\nDataType=5\nAccessType=rw\nDefaultValue=1\nParameterValue=2\n"
    drive = cell.drive(text)
    cell.drive(eds(), node=2)
    cell.start(nodes=(1, 2))
    assert drive.value(0x1014) == 0x81
    assert drive.value(0x1017) == 200
    assert not [write for write in drive.written if write[0] == 0x2000]
    drive.emergency(0x3210)
    event = cell.watched.expect("drive.emergency")
    assert (event.axis, event.code) == (0, "MC556")
    # the same once more is no news, and that it is gone has no code
    drive.emergency(0x3210)
    drive.emergency(0x0000)
    assert cell.watched.expect("drive.emergency").code == ""


def test_a_drive_that_says_it_has_no_csp_is_refused_with_what_it_has(cell: LocalCell) -> None:
    cell.drive(eds(changes={0x6502: {"DefaultValue": "0x45"}}))
    with pytest.raises(ConfigurationError, match=r'MC552.*6502h.*it has pp, pv, ip.*mode = "ip"'):
        cell.start()
    # the firmware may differ from the EDS
    (cell.folder / "drive1.eds").write_text(eds())
    with pytest.raises(DriveError, match=r"MC551.*6502h.*it has pp, pv, ip"):
        cell.start()


def test_a_mapping_that_is_not_that_of_the_eds_is_refused(cell: LocalCell) -> None:
    cell.drive(eds(fixed=True, rpdos=((0x60400010,), (0x60400010, 0x607A0020), (0x60400010,), (0x60400010,))))
    (cell.folder / "drive1.eds").write_text(eds(fixed=True))
    with pytest.raises(DriveError, match=r"MC551.*160[12]h.* holds 0x"):
        cell.start()


def test_a_stopped_node_is_started_again(cell: LocalCell) -> None:
    drive = cell.drive(eds())
    cell.start()
    drive.local.nmt.state = "STOPPED"
    cell.watched.expect("drive.rebooted")
    cell.watched.expect("drive.started")
    assert drive.local.nmt.state == "OPERATIONAL"


def test_objects_that_no_mode_needs_may_be_missing(cell: LocalCell) -> None:
    assert U32 == 7
    drive = cell.drive(eds(without=[0x60FF, 0x6061, 0x1014, 0x1005]))
    with cell.cycle(drive, heartbeat_ms=0) as cycle:
        cycle.run(DriveMode.POSITION, DriveState.ENERGIZED)
