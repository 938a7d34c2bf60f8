"""The page's languages: no text of it is missing in a catalogue, and none of a catalogue is of no use."""

from __future__ import annotations

import ast
import re
import string
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest
from mcclient import MotionError
from mcclient.broken_off import ENERGIZE, MANUAL_INPUT, WORK_OFFSET
from mcclient.types import AxisState, MachineState, ProgramState, RecordingState, RunState
from nicegui import Client, ui

from mcserver.errors import ServiceError
from mcserver.machine.homing_section import Method
from mcserver.machine.machine_file import load_machine
from mcserver.machine.probing_cycles import probing_cycles
from mcserver.service.axis_reports import PHASES
from mcserver.web.fleet import FLEET_TEXT
from mcserver.web.frame import BROWSER_TEXTS
from mcserver.web.jobs import JobState
from mcserver.web.machine_words import (
    HOMING_METHODS,
    HOMING_PHASES,
    PROBING_CYCLES,
    PROBING_NUMBERS,
    PROGRAM_NAMES,
    program_name,
)
from mcserver.web.past import WHATS, WHENS
from mcserver.web.translation import ENGLISH, LANGUAGES, catalogue, language_for, mark, t_in, texts_of

WEB = Path(__file__).parents[2] / "mcserver" / "web"
TRANSLATED = [each for each in LANGUAGES if each != ENGLISH]
PASSES = {"t", "t_in", "mark"}
# where a literal of these is a text that somebody reads
ELEMENTS = {"label", "button", "input", "number", "switch", "checkbox", "expansion", "textarea", "link"}
SAYS = {"notify", "notification", "NamedDialog", "show_refusal", "set_text", "tooltip", "_item"}
KEYWORDS = {"label", "placeholder", "close_button"}
# whose strings are for the browser alone
MACHINERY = {"classes", "props", "style", "run_javascript", "add_head_html", "compile", "warning", "Field"}
# what commands say in a terminal, services in their logs, and scripts are answered
READ_ELSEWHERE = {
    "credential_file.py",
    "history.py",
    "history_store.py",
    "robot_model.py",
    "users.py",
    "webhooks.py",
}
# the notation of programs, the same in every language
NOTATION = {"G01 X10 F600"}


def calls() -> Iterator[tuple[str, ast.Call]]:
    for file in sorted(WEB.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Call):
                yield f"{file.name}:{node.lineno}", node


def name_of(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def texts() -> set[str]:
    found = {
        each.value
        for _, call in calls()
        if name_of(call) in PASSES
        for each in call.args[:2]
        if isinstance(each, ast.Constant) and isinstance(each.value, str)
    }
    words = (AxisState, MachineState, ProgramState, RecordingState, RunState, JobState)
    return found | {str(each.value) for word in words for each in word} | {*WHATS, *WHENS}


def fields(text: str) -> list[str]:
    """Fields of a template with their formats; order is the language's own."""
    return sorted(
        f"{name}!{conversion}:{spec}"
        for _, name, spec, conversion in string.Formatter().parse(text)
        if name is not None
    )


@pytest.mark.parametrize("language", TRANSLATED)
def test_every_text_of_the_page_is_in_every_catalogue_and_no_other(language: str) -> None:
    known, shown = set(catalogue(language)), texts()
    assert shown - known == set(), "missing"
    assert known - shown == set(), "of no use"


@pytest.mark.parametrize("language", TRANSLATED)
def test_a_translation_has_the_fields_of_its_text_and_no_markup_of_its_own(language: str) -> None:
    for text, said in catalogue(language).items():
        assert fields(said) == fields(text), text
        assert {*'<>&"'}.isdisjoint(said), text
        # what joins onto another text
        assert [said[:1].isspace(), said[-1:].isspace()] == [text[:1].isspace(), text[-1:].isspace()] or (
            language == "zh-CN"
        ), text


def test_what_people_read_passes_by_the_catalogues() -> None:
    for place, call in calls():
        name = name_of(call)
        given = call.args[:2] if name in ELEMENTS | SAYS else []
        given = [*given, *(each.value for each in call.keywords if each.arg in KEYWORDS)]
        if not given or (name in ELEMENTS and not isinstance(call.func, ast.Attribute)):
            continue
        for each in given:
            parts = each.values if isinstance(each, ast.JoinedStr) else [each]
            for part in parts:
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    plain = part.value in NOTATION or part.value.startswith("/")
                    assert plain or not re.search(r"[A-Za-z]{3}", part.value), f"{place}: {part.value}"


def test_no_words_of_a_panel_pass_by_the_catalogues() -> None:
    for file in sorted((WEB / "panels").glob("*.py")):
        tree = ast.parse(file.read_text("utf-8"))
        passed = {
            id(part)
            for node in ast.walk(tree)
            if (isinstance(node, ast.Call) and name_of(node) in PASSES | MACHINERY)
            # a docstring
            or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
            for part in ast.walk(node)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in passed:
                shown = re.sub(r"<[^>]*>?", " ", node.value)
                assert "=>" in shown or not re.search(r"[A-Za-z]{3} [a-z]{2}", shown), node.value
                assert not re.search(r">\s*[A-Za-z]{3}", node.value.replace("=>", "")), node.value


def test_what_errors_of_the_page_say_passes_by_the_catalogues() -> None:
    for place, call in calls():
        if place.partition(":")[0] in READ_ELSEWHERE or not name_of(call).endswith("Error"):
            continue
        for each in call.args[1:]:
            assert not isinstance(each, ast.Constant | ast.JoinedStr), f"{place}: {ast.unparse(each)}"


def test_texts_of_scripts_are_given_to_them() -> None:
    scripts = "".join(file.read_text("utf-8") for file in (WEB / "static").glob("*.js"))
    assert set(re.findall(r'mcTexts\["([^"]+)"\]', scripts)) == set(BROWSER_TEXTS)


@pytest.mark.parametrize(
    ("chosen", "accepted", "language"),
    [
        ("", "de-AT,de;q=0.9,en;q=0.8", "de"),
        ("", "fr, zh;q=0.7, de;q=0.8", "de"),
        ("", "zh-Hans-CN", "zh-CN"),
        ("", "de;q=0, zh;q=0.1", "zh-CN"),
        ("", "", "en-US"),
        ("", "xx;q=nan;;,*;q=,\x00", "en-US"),
        ("zh-CN", "de", "zh-CN"),
        ("../de", "de", "de"),
    ],
)
def test_the_choice_comes_before_what_the_browser_asks_for(chosen: str, accepted: str, language: str) -> None:
    assert language_for(chosen, accepted) == language


def test_a_message_is_english_where_it_is_kept_and_translated_where_it_is_read() -> None:
    kept = mark("{name} has no line {line}", name="part{0}.nc", line=mark("not known"))
    assert kept == "part{0}.nc has no line not known"
    assert t_in("de", kept) == "part{0}.nc hat keine Zeile nicht bekannt"
    for error in (ServiceError("MC061", kept), MotionError("MC061", kept)):
        assert str(error) == "MC061: part{0}.nc has no line not known"
        assert t_in("de", error.message) == t_in("de", kept)
    assert t_in("de", "a sentence of the server {with} braces") == "a sentence of the server {with} braces"


def test_a_catalogue_is_read_as_translators_tools_write_it_and_what_is_wrong_in_it_stays_english(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    po = (
        'msgid ""\nmsgstr "Language: de\\n"\n\n'
        '#: page.py:7\n#, python-format\nmsgid ""\n"Take "\n"it"\nmsgstr ""\n"Nimm "\n"\\"es\\""\n\n'
        '#, fuzzy, python-format\nmsgid "Run"\nmsgstr "Lauf"\n\n'
        'msgid "Stop"\nmsgstr ""\n \n'
        'msgid "Hold"\nmsgstr "\\q"\n\n'
        '#~ msgid "Gone"\n#~ msgstr "Weg"\n\n'
        'msgid "{name} waits"\nmsgstr "{nmae} wartet"\n'
    )
    read = texts_of(po)
    assert read == {"Take it": 'Nimm "es"', "{name} waits": "{nmae} wartet"}
    monkeypatch.setattr("mcserver.web.translation.catalogue", lambda _: read)
    assert t_in("de", "{name} waits", name="part.nc") == "part.nc waits"


def test_words_of_the_motion_server_that_the_page_says_are_those_that_it_has() -> None:
    machine = load_machine(str(WEB.parents[1] / "examples" / "mill.toml"))
    cycles = probing_cycles(machine)
    assert {each.name for each in cycles} | {each.group for each in cycles} == set(PROBING_CYCLES)
    assert {number.name for each in cycles for number in each.argument} == set(PROBING_NUMBERS)
    assert set(PHASES.values()) == set(HOMING_PHASES)
    assert set(get_args(Method)) == HOMING_METHODS.keys()
    assert {ENERGIZE, MANUAL_INPUT, WORK_OFFSET, FLEET_TEXT} == set(PROGRAM_NAMES)


def test_programs_that_are_no_files_are_called_in_the_language_of_the_page() -> None:
    page = ui.page("/names")
    page.language = "de"
    with Client(page):
        assert program_name("manual input") == "Handeingabe"
        assert program_name("Top by ada by the window") == "Top by ada by the window"
        assert program_name("Top by ada") == "Oberseite von ada"
        assert program_name("part by ada.nc") == "part by ada.nc"
