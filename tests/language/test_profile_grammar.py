"""For a machine with a profile the grammar derives what that profile reads, and the programs of its posts."""

from __future__ import annotations

import os
import re
from functools import cache
from pathlib import Path
from random import Random

import lark
import pytest

from mcserver.gcode.profiles.reader import reader_of
from mcserver.gcode.text.source import split_lines
from mcserver.gcode.text.words import Word
from mcserver.language.grammar.derive import derive
from mcserver.language.grammar.dialect import build_grammar
from mcserver.language.grammar.expressions import Grammar
from mcserver.language.grammar.notations import Notation, write_grammar
from mcserver.machine.machine_file import Machine, load_machine, parse_machine
from tests.language.grammar_reader import Recognizer, pattern_of, read_grammar
from tests.machine_text import axes_text

CORPUS = Path(__file__).resolve().parents[1] / "corpus"
PROFILES = ("cnc", "printer", "robot")
POSTS = sorted(path.name for path in CORPUS.iterdir() if path.suffix in (".gcode", ".nc", ".ngc", ".tap"))
# 10 000 by GRAMMAR_PROGRAMS=10000
LINES = int(os.environ.get("GRAMMAR_PROGRAMS", "600"))


@cache
def machine_of(profile: str) -> Machine:
    return load_machine(str(CORPUS / f"{profile}.toml"))


@cache
def grammar_of(profile: str) -> Grammar:
    return build_grammar(machine_of(profile))


@cache
def recognizer(profile: str) -> Recognizer:
    return Recognizer(grammar_of(profile))


def faults(line: str, profile: str) -> list[str]:
    """Faults of a line's text under a profile, and axes that the machine lacks."""
    parsed = reader_of(machine_of(profile).dialect)(line, 2)
    known = {axis.index for axis in machine_of(profile).axes}
    named = {
        item.axis
        for group in parsed.groups
        for command in group
        for item in command.items
        if isinstance(item, Word)
    }
    return [fault.message for fault in parsed.faults] + [
        f"axis {axis}" for axis in sorted(named - known) if axis >= 0
    ]


@pytest.mark.parametrize("profile", PROFILES)
def test_lines_derived_for_a_profile_have_no_fault_of_text_code_or_axis(profile: str) -> None:
    random = Random(4)
    for _ in range(LINES):
        line = derive(grammar_of(profile), random, "line")
        assert faults(line, profile) == [], line


@pytest.mark.parametrize("name", POSTS)
def test_every_program_of_a_post_can_be_derived_for_its_profile(name: str) -> None:
    accepts = recognizer(name.split(".")[-2]).accepts
    lines = split_lines((CORPUS / name).read_text("utf-8"))
    assert [line for line in lines if not accepts(line)] == []


NEAR_MISSES = (
    *("GO1 X1", "G1 XO", "G1 X1 X2", "G1 X1 F1 F2", "G1 F0", "G1 X1e5", "G1 X--1", "G1 X#1", "G1 X[1+2]"),
    *("G05.1 X1", "G41 X1", "G84 X1 Y1 Z-1 R1", "G33 Z-1 K1", "G96 S100", "M98 P1", "M99", "G68 R45"),
    *("IF [1 EQ 1] GOTO 5", "#1=5", "O100 SUB", "G1 [50]1", "G1030 X5", "G02 X1 R5 I5", "G1 X", "X1 é"),
)


def misses(profile: str) -> list[str]:
    """Near misses of a profile: a printer has an axis E, and M98 is without effect there; cnc has G41."""
    right = {"printer": ("G1 X1e5", "M98 P1", "M99"), "cnc": ("G41 X1",)}.get(profile, ())
    return [line for line in NEAR_MISSES if line not in right]


@pytest.mark.parametrize("profile", PROFILES)
def test_near_misses_cannot_be_derived_for_any_profile(profile: str) -> None:
    assert [line for line in misses(profile) if recognizer(profile).accepts(line)] == []


@pytest.mark.parametrize(
    ("line", "profiles"),
    [
        ("M104 S215", {"printer"}),
        ("EXCLUDE_OBJECT_START NAME=a", {"printer"}),
        ("G1 X1 E0.5", {"printer"}),
        ("G43 Z15. H1", {"cnc"}),
        ("M6 T3", {"cnc", "printer"}),
        ("G54 G0 X1", {"cnc", "robot"}),
        ("G64 P0.1", {"cnc", "robot", "printer"}),
        ("G1010 P0", {"cnc", "robot", "printer"}),
        ("G1030 X5", set()),
        ("G99 G83 X1 Y1 Z-5 R2 Q1.5 F90", {"cnc"}),
        ("G82 X1 Z-5 P0.5 R2 L3", {"cnc"}),
        ("G82 X1 P0.5 R2 P0.5", set()),
        ("G64 P0.1 G82 X1 P0.5", set()),
        ("G64 P0.1 G64 P0.2", set()),
        ("G10 L20 P1 X0 Y0", {"cnc", "robot"}),
        ("G10 L1 P3 Z75.2 R3", {"cnc"}),
        ("O1002 (BRACKET)", {"cnc", "robot", "printer"}),
        ("G1 U5", {"robot"}),
        ("M62 P0", {"printer"}),  # without effect there
        ("G38.2 Z-5 F100", set()),
    ],
)
def test_profiles_differ_in_what_can_be_derived(line: str, profiles: set[str]) -> None:
    assert {profile for profile in PROFILES if recognizer(profile).accepts(line)} == profiles


CHANNELS = """
[probe]
input = 4
[[input]]
number = 4
name = "probe"
[[input]]
number = 0
name = "pressure"
kind = "analog"
[[output]]
number = 1
name = "laser"
[[output]]
number = 0
name = "power"
kind = "analog"
max = 100.0
"""


def test_a_machine_with_inputs_outputs_and_a_probe_has_their_codes() -> None:
    described = (CORPUS / "cnc.toml").read_text("utf-8")
    machine = parse_machine(described + CHANNELS)
    accepts = Recognizer(build_grammar(machine)).accepts
    right = ["M62 P1", "M65P1", "M67 E0 Q50", "M68 E0 Q.5", "M66 P4 L3 Q10", "M66 E0", "G38.2 Z-5 F100"]
    wrong = ["M62 P0", "M67 E1 Q5", "M66 P0 L3 Q1", "M66 P4 L5 Q1", "G38.2 A5 F100"]
    assert [line for line in right if not accepts(line)] == []
    assert [line for line in wrong if accepts(line)] == []
    read = reader_of(machine.dialect)
    assert [fault for line in right for fault in read(line, 2).faults] == []
    random = Random(6)
    for _ in range(200):
        line = derive(build_grammar(machine), random, "line")
        assert read(line, 2).faults == (), line


def test_a_printer_that_probes_its_bed_has_the_codes_of_its_mesh() -> None:
    assert machine_of("printer").dialect.mesh_axis is None
    mesh = "[axis.compensation.mesh]\naxes = [0, 1]\nfirst = [10.0, 90.0]\nsecond = [10.0, 90.0]\n"
    mesh += "[axis.compensation.mesh.probe]\nspeed = 5.0\nclear = 3.0\ngreatest = 0.4\n"
    text = '[machine]\nname = "bed"\n[dialect]\nprofile = "printer"\n[probe]\nsimulated_at = { Z = 0.0 }\n'
    for index in range(3):
        keys = "max_jerk = 50000.0\nmin_position = -5.0\nmax_position = 100.0\n"
        text += axes_text([index], keys=keys + (mesh if index == 2 else ""))
    machine = parse_machine(text)
    accepts = Recognizer(build_grammar(machine)).accepts
    assert [line for line in ("G29", "M420 S1", "M420S0", "M421") if not accepts(line)] == []
    assert [line for line in ("G29 S5", "M420 S2", "M420", "BED_MESH_CLEAR X") if accepts(line)] == []
    read = reader_of(machine.dialect)
    random = Random(8)
    for _ in range(200):
        line = derive(build_grammar(machine), random, "line")
        assert read(line, 2).faults == (), line


@pytest.mark.parametrize("profile", PROFILES)
def test_every_notation_of_a_profile_is_the_same_language(profile: str) -> None:
    grammar = grammar_of(profile)
    random = Random(5)
    lines = [derive(grammar, random, "line") for _ in range(40)]
    parser = lark.Lark(write_grammar(grammar, Notation.LARK), parser="earley")
    for line in lines[:10]:
        parser.parse(line)
    for line in misses(profile)[:8]:
        with pytest.raises(lark.exceptions.LarkError):
            parser.parse(line)
    for notation in (Notation.EBNF, Notation.GBNF):
        _, rules = read_grammar(write_grammar(grammar, notation))
        printed = re.compile(pattern_of(rules, "line"))
        for line in lines:
            assert printed.fullmatch(line), line
        assert not [line for line in misses(profile) if printed.fullmatch(line)]
