"""``[[input]]`` and ``[[output]]``: what they become, and every mistake with its place."""

from __future__ import annotations

import math

import pytest

from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected

BASE = """[machine]
name = "cell"
[[axis]]
index = 0
type = "linear"
max_velocity = 100.0
max_acceleration = 1000.0
[[bus]]
name = "can0"
"""


def read(text: str) -> Machine:
    return parse_machine(BASE + text)


def mistakes(text: str) -> list[str]:
    with pytest.raises(MachineFileRejected) as caught:
        read(text)
    return [each.message for each in caught.value.diagnostics]


def test_digital_ones_come_first_and_each_kind_by_number() -> None:
    machine = read(
        '[[input]]\nnumber = 1\nname = "b"\n[[input]]\nnumber = 0\nname = "p"\nkind = "analog"\n'
        '[[input]]\nnumber = 0\nname = "a"\n'
    )
    assert [(each.name, each.digital, each.number) for each in machine.inputs] == [
        ("a", True, 0),
        ("b", True, 1),
        ("p", False, 0),
    ]


def test_an_interlock_is_a_range_that_an_input_may_not_leave() -> None:
    machine = read(
        '[[input]]\nnumber = 0\nname = "door"\nhold_on = true\n'
        '[[input]]\nnumber = 1\nname = "guard"\nstop_on = false\n'
        '[[input]]\nnumber = 0\nname = "air"\nkind = "analog"\nhold_below = 4.0\nstop_above = 9.0\n'
    )
    door, guard, air = machine.inputs
    assert (door.holds(1.0), door.holds(0.0), door.stops(1.0)) == (True, False, False)
    assert (guard.stops(1.0), guard.stops(0.0)) == (False, True)
    assert [air.holds(value) for value in (3.9, 4.0, 20.0)] == [True, False, False]
    assert [air.stops(value) for value in (3.9, 9.0, 9.1)] == [False, False, True]
    assert math.isinf(air.hold_above)


def test_an_output_is_safe_as_it_began_unless_the_file_says_otherwise() -> None:
    machine = read(
        '[[output]]\nnumber = 0\nname = "a"\ninitial = true\n'
        '[[output]]\nnumber = 1\nname = "b"\nsafe = "keep"\n'
        '[[output]]\nnumber = 0\nname = "c"\nkind = "analog"\nmax = 24000.0\nsafe = 5\n'
    )
    assert [each.safe for each in machine.outputs] == [1.0, None, 5.0]
    assert [(each.low, each.high) for each in machine.outputs] == [(0.0, 1.0), (0.0, 1.0), (0.0, 24000.0)]


def test_the_type_of_known_objects_need_not_be_written() -> None:
    machine = read(
        '[[input]]\nnumber = 0\nname = "a"\n'
        'source = { bus = "can0", node = 5, object = "60FDh:00", bit = 17 }\n'
        '[[output]]\nnumber = 0\nname = "b"\nkind = "analog"\n'
        'target = { bus = "can0", node = 6, object = "6411h:02" }\n'
    )
    source, target = machine.inputs[0].source, machine.outputs[0].target
    assert source is not None
    assert (source.index, source.subindex, source.bit, source.type) == (0x60FD, 0, 17, "u32")
    assert target is not None
    assert (target.index, target.subindex, target.bit, target.type) == (0x6411, 2, None, "i16")


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ('[[input]]\nname = "a"\n', "input[0].number: is missing"),
        ('[[input]]\nnumber = 64\nname = "a"\n', "input[0].number"),
        ('[[input]]\nnumber = 0\nname = ""\n', "input[0].name"),
        ('[[input]]\nnumber = 0\nname = "a\\u0000b"\n', "input[0].name"),
        ('[[input]]\nnumber = 0\nname = "a"\ninitial = 2\n', "input[0].initial"),
        ('[[input]]\nnumber = 0\nname = "a"\ninitial = nan\n', "input[0].initial"),
        ('[[input]]\nnumber = 0\nname = "a"\nhold_below = 1.0\n', "input[0].hold_below"),
        ('[[input]]\nnumber = 0\nname = "a"\nscale = 2.0\n', "input[0].scale"),
        ('[[input]]\nnumber = 0\nname = "a"\nkind = "analog"\nscale = 0.0\n', "input[0].scale"),
        ('[[input]]\nnumber = 0\nname = "a"\nkind = "analog"\nhold_on = true\n', "input[0].hold_on"),
        ('[[input]]\nnumber = 0\nname = "a"\nkind = "analog"\ninvert = true\n', "input[0].invert"),
        (
            '[[input]]\nnumber = 0\nname = "a"\nkind = "analog"\nstop_below = 5\nstop_above = 5\n',
            "input[0].stop_below",
        ),
        ('[[input]]\nnumber = 0\nname = "a"\nsimulated = [{ at_s = -1, value = 1 }]\n', "at_s"),
        ('[[input]]\nnumber = 0\nname = "a"\nsimulated = [{ at_s = 1, value = 5 }]\n', "simulated[0].value"),
        ('[[input]]\nnumber = 0\nname = "a"\ndebounce = 5\n', "input[0].debounce: is no key here"),
        (
            '[[input]]\nnumber = 0\nname = "a"\n[[input]]\nnumber = 0\nname = "b"\n',
            "input[1].number: digital input 0 is there twice",
        ),
        (
            '[[input]]\nnumber = 0\nname = "a"\n[[output]]\nnumber = 0\nname = "a"\n',
            'output[0].name: "a" is an input\'s name',
        ),
        ('[[output]]\nnumber = 0\nname = "a"\nmin = 0.5\n', "output[0].min"),
        ('[[output]]\nnumber = 0\nname = "a"\nsafe = "on"\n', "output[0].safe"),
        ('[[output]]\nnumber = 0\nname = "a"\nkind = "analog"\nmin = 2\nmax = 1\n', "output[0].max"),
        ('[[output]]\nnumber = 0\nname = "a"\nkind = "analog"\ninitial = 2\n', "output[0].initial"),
        (
            '[[input]]\nnumber = 0\nname = "a"\n'
            'source = { bus = "x", node = 5, object = "6000h:01", bit = 0 }\n',
            'input[0].source.bus: the file has no bus "x"',
        ),
        (
            '[[input]]\nnumber = 0\nname = "a"\nsource = { bus = "can0", node = 5, object = "6000h:01" }\n',
            "input[0].source: a digital one is a bit of its object",
        ),
        (
            '[[input]]\nnumber = 0\nname = "a"\n'
            'source = { bus = "can0", node = 5, object = "6000h:01", bit = 8 }\n',
            "input[0].source.bit",
        ),
        (
            '[[output]]\nnumber = 0\nname = "a"\n'
            'target = { bus = "can0", node = 5, object = "2000h", bit = 0 }\n',
            "output[0].target.object",
        ),
        (
            '[[output]]\nnumber = 0\nname = "a"\ntarget = { bus = "can0", node = 0, object = "6200h:01" }\n',
            "output[0].target.node",
        ),
    ],
)
def test_a_mistake_is_said_with_its_path(section: str, said: str) -> None:
    assert any(said in each for each in mistakes(section)), mistakes(section)


def test_all_mistakes_are_said_at_once_with_their_lines() -> None:
    with pytest.raises(MachineFileRejected) as caught:
        read('[[input]]\nnumber = 0\nname = "a"\nfoo = 1\n[[output]]\nnumber = 0\nname = "b"\nsafe = 7\n')
    assert [each.line for each in caught.value.diagnostics] == [13, 17]
