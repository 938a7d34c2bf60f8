"""60FDh and 60FEh of drives: the machine's inputs and outputs, and home switches."""

from __future__ import annotations

import struct

import msgspec
import pytest

from mcserver.can.cob import Function
from mcserver.canopen.configuration import configure
from mcserver.canopen.dictionary import generic_dictionary
from mcserver.canopen.settings import settings_of
from mcserver.errors import ConfigurationError
from mcserver.executor.entries import ControlKind, EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.machine.bus_load import bus_loads
from mcserver.machine.machine_file import Machine, parse_machine
from tests.drives.can_rig import CanRig
from tests.drives.fake_can import FakeBus, FakeDrive

INPUT = '[[input]]\nnumber = 0\nname = "guard"\nsource = { drive = 0, bit = 17 }\n'
OUTPUT = '[[output]]\nnumber = 0\nname = "brake"\ntarget = { drive = 0, bit = 16 }\nsafe = true\n'
MM = 1e-3


class DriveWithPins(FakeDrive):
    """60FDh in TPDO2 at every SYNC, 60FEh in RPDO2.

    Attributes:
        pins: 60FDh, by itself or from the position. outputs: each 60FEh that came. keeps_inputs: 60FDh stays
            out.
    """

    keeps_inputs = False
    lengths = 4
    switch_from = -3000

    def __init__(self, bus: FakeBus, node: int, position: int = 0, cycle_s: float = 1e-3) -> None:
        super().__init__(bus, node, position, cycle_s)
        self.pins = 0
        self.outputs: list[int] = []

    def receive(self, identifier: int, payload: bytes) -> None:
        if identifier == Function.RPDO2 + self.node and len(payload) == 4:
            self.outputs.append(struct.unpack("<I", payload)[0])
            return
        super().receive(identifier, payload)

    def _answer(self) -> None:
        super()._answer()
        if not self.keeps_inputs:
            pins = self.pins | 4 * (self.position <= self.switch_from)
            self.say(Function.TPDO2, struct.pack("<I", pins)[: self.lengths])


def machine(channels: str, axis: str = "", cycle_hz: float = 1000.0) -> Machine:
    """The machine as it is after boot-up."""
    text = (
        f'[machine]\nname = "m"\ncycle_hz = {cycle_hz}\n[[axis]]\nindex = 0\ntype = "linear"\n'
        "max_velocity = 1000.0\nmax_acceleration = 10000.0\nmax_following_error = 2.0\n"
        f"min_position = -100.0\nmax_position = 100.0\nunits_per_motor_rev = 10.0\n{axis}\n"
        '[axis.drive]\nkind = "cia402"\nbus = "can0"\nnode = 1\ncounts_per_motor_rev = 10000\n'
    )
    described = parse_machine(text + channels)
    [settings] = settings_of(described)
    _, planned = configure(settings, described.cycle_s, generic_dictionary(1), 127)
    [section] = described.axes
    drive = msgspec.structs.replace(section.drive, process_data=planned.process_data)
    return msgspec.structs.replace(described, axes=(msgspec.structs.replace(section, drive=drive),))


class PinRig(CanRig):
    @property
    def pins(self) -> DriveWithPins:
        [drive] = self.drives
        assert isinstance(drive, DriveWithPins)
        return drive


def rig(channels: str = INPUT + OUTPUT, axis: str = "", *, homed: bool = True) -> PinRig:
    return PinRig(machine(channels, axis), make=DriveWithPins, homed=homed)


def test_a_bit_of_60fd_is_an_input_of_the_machine() -> None:
    made = rig()
    made.step(5)
    assert made.core.row.inputs[0] == 0.0
    made.pins.pins = 1 << 17
    made.step(3)
    assert made.core.row.inputs[0] == 1.0


def test_the_highest_bit_is_no_sign() -> None:
    made = rig(INPUT.replace("17", "31"))
    made.pins.pins = 1 << 31
    made.step(3)
    assert made.core.row.inputs[0] == 1.0


def test_an_output_is_a_bit_of_60fe_in_the_cycle_in_which_it_is_set() -> None:
    made = rig()
    made.program.capture()
    made.program.control(ControlKind.OUTPUT, channel=0, value=1.0)
    made.program.dwell(0.02)
    made.program.control(ControlKind.OUTPUT, channel=0, value=0.0)
    made.program.finish()
    made.run()
    assert set(made.pins.outputs) == {0, 1 << 16}
    assert made.pins.outputs[-1] == 0
    assert 18 <= made.pins.outputs.count(1 << 16) <= 22


def test_outputs_are_written_while_the_axis_is_off_too_and_get_safe_values() -> None:
    made = rig()
    made.step(3)
    assert made.pins.outputs[-1] == 0
    made.executor.mailbox.emergency_stop()
    made.step(3)
    assert made.pins.outputs[-1] == 1 << 16


def test_inputs_that_stay_out_stop_the_programs() -> None:
    made = rig()
    made.program.capture()
    made.program.dwell(5.0)
    made.program.finish()
    made.step(50)
    made.pins.keeps_inputs = True
    made.step(6)
    assert FaultCode.IO_LOST in {event.code for event in made.of(EventKind.FAULT)}


def test_inputs_of_a_wrong_length_count_as_not_come() -> None:
    made = rig()
    made.step(5)
    made.pins.pins = 1 << 17
    made.pins.lengths = 2
    made.step(6)
    assert made.core.row.inputs[0] == 0.0
    assert FaultCode.IO_LOST in {event.code for event in made.of(EventKind.FAULT)}


def test_an_axis_finds_its_home_switch_by_its_own_drive() -> None:
    homing = '[axis.homing]\nmethod = "switch"\nvelocity = 20.0\nlatch_velocity = 2.0\nposition = 5.0\n'
    made = rig("", homing, homed=False)
    made.program.capture()
    made.program.control(ControlKind.HOME, axes=1)
    made.program.finish()
    made.run(60_000)
    assert [event.code for event in made.of(EventKind.FAULT)] == []
    assert made.core._cycle.homed.mask == 1
    # the switch closes at -3000 counts of 1 µm, which is 5 mm now
    reading = (made.pins.position - DriveWithPins.switch_from) * 1e-6
    assert made.actual[-1, 0] == pytest.approx(5.0 * MM + reading, abs=2e-5)


def test_the_drive_is_configured_for_what_the_machine_uses_of_it() -> None:
    described = machine(INPUT + OUTPUT)
    [settings] = settings_of(described)
    writes, planned = configure(settings, 0.001, generic_dictionary(1), 127)
    data = planned.process_data
    assert [(each.index, each.subindex) for pdo in data.tpdos for each in pdo.objects][-1] == (0x60FD, 0)
    assert (0x60FE, 1) in {(each.index, each.subindex) for pdo in data.rpdos for each in pdo.objects}
    [mask] = [each.payload for each in writes if (each.index, each.subindex) == (0x60FE, 2)]
    assert mask == struct.pack("<I", 1 << 16)
    [load] = bus_loads(described)
    assert {share.what for share in load.shares} >= {"inputs of drives", "outputs of drives"}


@pytest.mark.parametrize("index", [0x60FD, 0x60FE])
def test_a_drive_without_these_objects_is_refused(index: int) -> None:
    dictionary = generic_dictionary(1)
    del dictionary.indices[index]
    [settings] = settings_of(machine(INPUT + OUTPUT))
    with pytest.raises(ConfigurationError, match=f"{index:04X}h"):
        configure(settings, 0.001, dictionary, 127)


@pytest.mark.parametrize(
    ("channel", "mistake"),
    [
        (INPUT.replace("drive = 0", "drive = 7"), "there is no such axis"),
        (INPUT.replace("drive = 0", 'drive = 0, bus = "can0"'), "follows from drive"),
        (INPUT.replace(", bit = 17", ""), "is a bit"),
        (INPUT.replace("drive = 0, ", ""), "is missing"),
        (INPUT.replace("drive = 0", 'bus = "can0", node = 1, object = "60FDh"'), "drive = 0, bit"),
    ],
)
def test_a_place_that_does_not_fit_is_refused(channel: str, mistake: str) -> None:
    bus = '[[bus]]\nname = "can0"\n'
    with pytest.raises(ConfigurationError) as refused:
        machine(bus + channel)
    assert mistake in f"{refused.value.message} {refused.value.hint}"
