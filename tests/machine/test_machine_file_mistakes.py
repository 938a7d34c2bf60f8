"""All mistakes of a machine file at once, each with its place, and what may stand there."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.cli.app import run_command_line
from mcserver.errors import Diagnostic
from mcserver.machine.machine_file import BUILT_IN, load_machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.machine.toml_positions import Path as TomlPath
from mcserver.machine.toml_positions import find_positions

Capture = pytest.CaptureFixture[str]

MANY = """[machine]
name = "a b"
[motion]
path_tolerance = 0.1
[[axis]]
index = 0
type = "liner"
max_velocity = -1
max_acceleration = "fast"
max_jerk = nan
[[axis]]
index = 64
type = "rotary"
max_acceleration = 1.0
drive = { kind = "cia403", initial_position = 0.0 }
[kinematic]
urdf = "arm.urdf"
"""


def mistakes(text: str) -> tuple[Diagnostic, ...]:
    with pytest.raises(MachineFileRejected) as rejected:
        parse_machine(text)
    return rejected.value.diagnostics


def axis(keys: str = "", drive: str = "") -> str:
    return (
        '[machine]\nname = "m"\n[[axis]]\nindex = 0\ntype = "linear"\nmax_velocity = 1.0\n'
        f"max_acceleration = 1.0\n{keys}\n[axis.drive]\n{drive}\n"
    )


def test_every_mistake_is_listed_with_its_path_and_line() -> None:
    found = [(each.line, each.column, each.message.split(":")[0]) for each in mistakes(MANY)]
    assert found == [
        (2, 1, "machine.name"),
        (4, 1, "motion.path_tolerance"),
        (7, 1, "axis[0].type"),
        (8, 1, "axis[0].max_velocity"),
        (9, 1, "axis[0].max_acceleration"),
        (10, 1, "axis[0].max_jerk"),
        (11, 3, "axis[1].max_velocity"),
        (12, 1, "axis[1].index"),
        (15, 11, "axis[1].drive.kind"),
        (16, 2, "kinematic"),
    ]


def test_a_value_that_is_no_choice_gets_the_choices_and_the_nearest() -> None:
    fault = next(each for each in mistakes(MANY) if "type" in each.message)
    assert fault.message == 'axis[0].type: "liner" is not one of "linear", "rotary"'
    assert fault.hint == "did you mean 'linear'?"
    kind = next(each for each in mistakes(MANY) if "kind" in each.message)
    # a family of drives is found by its folder, and is named here without a line of its own
    assert kind.message.split(" is not one of ")[1].split(", ")[:3] == ['"simulated"', '"ideal"', '"cia402"']


def test_contradictions_are_found_beside_wrong_keys() -> None:
    found = mistakes(axis("min_position = 5\nmax_position = 1\nspeed = 3"))
    assert [(each.code, each.line) for each in found] == [("MC004", 8), ("MC003", 10)]


@pytest.mark.parametrize(
    ("keys", "line"),
    [("max_jerk = inf", 8), ("max_jerk = 0", 8), ("in_position = -1.0", 8), ("max_position = nan", 8)],
)
def test_numbers_that_no_limit_can_have_are_refused(keys: str, line: int) -> None:
    (fault,) = mistakes(axis(keys))
    assert (fault.line, fault.hint != "") == (line, True)


def test_a_key_that_is_needed_is_not_advised_to_be_left_out() -> None:
    (fault,) = mistakes(axis().replace("max_velocity = 1.0", "max_velocity = 0"))
    assert (fault.code, fault.hint) == ("MC004", "give a number above 0")


def test_a_key_of_another_kind_of_drive_names_its_kind() -> None:
    drive = 'kind = "cia402"\nbus = "can0"\nnode = 1\ncounts_per_motor_rev = 4\npole_pairs = 3'
    (fault,) = mistakes(axis("units_per_motor_rev = 1.0", drive))
    assert (fault.line, fault.hint) == (14, 'it belongs to kind = "servosila"')


def test_a_machine_is_tried_without_its_drives_by_changing_the_kind_alone() -> None:
    drive = 'kind = "{}"\nbus = "can0"\nnode = 1\ncounts_per_motor_rev = 4'
    for kind in ("cia402", "simulated", "ideal"):
        machine = parse_machine(axis("units_per_motor_rev = 1.0", drive.format(kind)))
        assert machine.axes[0].drive.kind == kind


@pytest.mark.parametrize(
    "text",
    ["", "axis = 3", "machine = 1\naxis = [1, 2]", 'machine.name = "m"\naxis = []', "[[machine]]\n[axis]"],
)
def test_tables_where_none_belong_are_mistakes_and_no_crash(text: str) -> None:
    assert mistakes(text)


def test_positions_of_inline_tables_arrays_and_quoted_keys() -> None:
    text = (
        'a = [ # one\n  1, [2,\n 3] ]\n"b.c" = { x = "}#", y.z = 2 }\n'
        '[[d]]\n[d.e]\nf = """\nx = 1\n"""\ng = 1\n'
    )
    positions = find_positions(text)
    lines = {path: place.line for path, place in positions.items()}
    assert lines[("a", 1, 1)] == 3
    assert lines[("b.c", "y", "z")] == 4
    assert lines[("d", 0, "e")] == 6
    assert lines[("d", 0, "e", "g")] == 10
    assert positions[("b.c", "y", "z")].column == 21


KEYS = st.text(alphabet='ab.#]"\\ =', max_size=4)
VALUES = st.recursive(
    st.integers(-99, 99) | st.booleans() | KEYS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=8,
)


def as_toml(value: object) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(key)} = {as_toml(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ",".join(map(as_toml, value)) + "]"
    return json.dumps(value)


def paths(value: object, path: TomlPath = ()) -> Iterator[TomlPath]:
    if path:
        yield path
    if isinstance(value, dict):
        for key, each in value.items():
            yield from paths(each, (*path, key))
    if isinstance(value, list):
        for index, each in enumerate(value):
            yield from paths(each, (*path, index))


@given(st.dictionaries(KEYS, VALUES, max_size=3))
def test_everything_in_a_file_has_a_position(values: dict[str, object]) -> None:
    text = "".join(f"{json.dumps(key)} = {as_toml(value)} # =\n" for key, value in values.items())
    assert tomllib.loads(text) == values
    assert set(paths(values)) == set(find_positions(text))


def test_the_command_line_shows_each_mistake_with_its_line(tmp_path: Path, capfd: Capture) -> None:
    file = tmp_path / "m.toml"
    file.write_text(MANY)
    assert run_command_line(["machine", "check", str(file)]) == 3
    shown = capfd.readouterr().err
    assert shown.count("error[") == 10
    assert f" --> {file}:7:1\n7 | type = " in shown
    assert run_command_line(["machine", "check", str(file), "--json"]) == 3
    answer = json.loads(capfd.readouterr().out)
    assert (answer["ok"], len(answer["diagnostics"]), answer["diagnostics"][2]["line"]) == (False, 10, 7)


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_built_in_machine_that_is_shown_is_a_machine_file(name: str, capfd: Capture) -> None:
    assert run_command_line(["machine", "show", name]) == 0
    assert parse_machine(capfd.readouterr().out).axes == load_machine(name).axes


def test_showing_a_machine_that_is_not_built_in_names_the_nearest(capfd: Capture) -> None:
    assert run_command_line(["machine", "show", "cartesan"]) == 3
    assert "did you mean 'cartesian'?" in capfd.readouterr().err


@pytest.mark.parametrize(
    "key",
    [
        "compensation = { pitch_errors = [[0.0, 0.0], [1.0, nan]] }",
        "compensation = { mesh = { axes = [0, 1], first = [0, 1], second = [0, inf], errors = [[0]] } }",
        "follow = { leader = 0, tolerance = 1.0, cam = [[0, 0], [1, -inf]] }",
    ],
)
def test_a_number_in_a_list_that_is_not_finite_is_refused_too(key: str) -> None:
    axis = '[[axis]]\nindex = 2\ntype = "linear"\nmax_velocity = 1.0\nmax_acceleration = 1.0\n'
    with pytest.raises(MachineFileRejected) as caught:
        parse_machine(f'[machine]\nname = "a"\n{axis}{key}')
    assert "is not a finite number" in caught.value.diagnostics[0].message


def test_the_remedy_of_a_number_that_is_not_finite_leaves_no_key_out_that_is_needed() -> None:
    axis = '[[axis]]\nindex = 2\ntype = "linear"\nmax_velocity = inf\nmax_acceleration = 1.0\n'
    with pytest.raises(MachineFileRejected) as caught:
        parse_machine(f'[machine]\nname = "a"\n{axis}max_jerk = inf')
    hints = [each.hint for each in caught.value.diagnostics]
    assert hints == ["give a number above 0", "leave the key out where there is no limit"]
