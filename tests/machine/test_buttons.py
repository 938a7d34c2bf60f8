"""``[[button]]``: programs of a machine's own, checked as the machine file is."""

from __future__ import annotations

import pytest

from mcserver.machine.button_section import filled
from mcserver.machine.machine_file import parse_machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.simulation.button_faults import find_button_faults

MILL = """[machine]
name = "mill"
[dialect]
profile = "cnc"
[[axis]]
index = 0
type = "linear"
max_velocity = 200.0
max_acceleration = 2000.0
min_position = -500.0
max_position = 500.0
"""
DRILL = """[[button]]
name = "go"
text = '''
G0 X{to} (there)
G1 X{to} F100 Q{slow}
'''
[[button.argument]]
name = "to"
low = -10
high = {high}
default = 5
[[button.argument]]
name = "slow"
low = 1
high = 2
"""


def rejected(text: str) -> list[str]:
    with pytest.raises(MachineFileRejected) as found:
        parse_machine(MILL + text)
    return [each.message for each in found.value.diagnostics]


def test_numbers_go_into_their_places_as_programs_write_them() -> None:
    assert filled("G0 X{to} Y-{to}", {"to": 1e-5}) == "G0 X0.00001 Y-0.00001"
    assert filled("G0 X{to}", {"to": -100.0}) == "G0 X-100"


@pytest.mark.parametrize("text", ["G0 X5", "G0 X{to}"])
def test_a_sound_button_has_no_fault(text: str) -> None:
    asked = '[[button.argument]]\nname = "to"\nlow = 0\nhigh = 500\n' if "{" in text else ""
    source = f'{MILL}[[button]]\nname = "go"\ntext = "{text}"\n{asked}'
    assert find_button_faults(parse_machine(source), source) == []


def test_a_fault_stands_at_its_place_in_the_machine_file_with_the_numbers_that_show_it() -> None:
    source = MILL + DRILL.replace("{high}", "600")
    found = find_button_faults(parse_machine(source), source)
    lines = source.split("\n")
    shown = [(each.code, lines[each.line - 1][each.column - 1 : each.end_column - 1]) for each in found]
    assert shown == [("MC113", "Q{slow}"), ("MC201", "X{to}"), ("MC201", "X{to}")]
    assert found[1].message.startswith('button "go" with to = 600, slow = 2: axis 0 goes to 600 mm')


def test_a_fault_in_a_text_of_one_line_stands_at_its_column() -> None:
    source = MILL + '[[button]]\nname = "go"\ntext = "G0 X5 Y5"\n'
    (fault,) = find_button_faults(parse_machine(source), source)
    assert (fault.code, fault.line, fault.column) == ("MC108", source.count("\n"), 15)


def test_where_escapes_hide_the_place_the_key_is_named() -> None:
    source = MILL + '[[button]]\nname = "go"\ntext = "G0\\u0020X5\\nG0 Y5"\n'
    (fault,) = find_button_faults(parse_machine(source), source)
    assert (fault.line, fault.column, fault.end_column) == (source.count("\n"), 1, 5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[[button]]\nname = "a"\ntext = "G4 P1"\n' * 2, '"a" is there twice'),
        ('[[button]]\nname = "a"\ntext = "G0 X{to}"\n', "{to} is not asked for"),
        ('[[button]]\nname = "a"\ntext = ""\n', "button[0].text"),
        ('[[button]]\nname = "a"\ntext = "G4 P1"\nrole = "boss"\n', "button[0].role"),
        ('[[button]]\nname = "a"\ntext = "G4 P1"\nconfirms = ""\n', "button[0].confirms"),
        (
            '[[button]]\nname = "a"\ntext = "X{a}"\n[[button.argument]]\nname = "a"\nlow = 0\nhig = 1\n',
            "button[0].argument[0].hig",
        ),
        ('[[button]]\nname = "a"\ntext = 5\n', "button[0].text"),
        (
            '[[button]]\nname = "a"\ntext = "G4 P1"\n[[button.argument]]\nname = "to"\nlow = 0\nhigh = 1\n',
            "the text has no {to}",
        ),
        (
            '[[button]]\nname = "a"\ntext = "X{a}"\n[[button.argument]]\nname = "a"\nlow = 2\nhigh = 1\n',
            "low, default and high are not in order",
        ),
    ],
)
def test_a_button_that_contradicts_itself_is_refused(text: str, said: str) -> None:
    messages = rejected(text)
    assert said in messages[0]
