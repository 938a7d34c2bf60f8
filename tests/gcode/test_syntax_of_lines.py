"""A parsed line has its groups, commands and columns."""

from mcserver.gcode.text.parser import scan_line


def test_a_simple_line_has_groups_and_columns_too() -> None:
    parsed = scan_line("\tG01  X1 Y-2", 4)
    (group,) = parsed.groups
    (command,) = group
    assert command.spec is not None
    assert command.spec.name == "G01"
    assert parsed.command_span(command) == (2, 13)
    assert [parsed.span(word.index) for word in command.items] == [(7, 9), (10, 13)]
