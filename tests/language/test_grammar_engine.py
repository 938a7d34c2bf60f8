"""The grammars in an engine that language models are run with: llguidance, which llama.cpp and vLLM can use.

It takes Lark, and GBNF by its own translator; no model is needed, each byte is a token.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from random import Random

import pytest
from llguidance import LLMatcher, LLTokenizer, grammar_from
from llguidance.gbnf_to_lark import gbnf_to_lark

from mcserver.gcode.text.source import split_lines
from mcserver.language.grammar.derive import derive
from mcserver.language.grammar.dialect import build_grammar
from mcserver.language.grammar.expressions import Grammar
from mcserver.language.grammar.notations import Notation, write_grammar
from mcserver.machine.machine_file import load_machine
from tests.language import test_grammar, test_profile_grammar
from tests.language.test_profile_grammar import CORPUS, POSTS, PROFILES

MACHINES = (test_grammar.PLAIN, "robot-dog", "arm6", *(str(CORPUS / f"{each}.toml") for each in PROFILES))
NOTATIONS = (Notation.GBNF, Notation.LARK)
# 10 000 by GRAMMAR_PROGRAMS=10000
PROGRAMS = int(os.environ.get("GRAMMAR_PROGRAMS", "20"))


@cache
def grammar_of(machine: str) -> Grammar:
    return build_grammar(load_machine(machine))


@cache
def engine(machine: str, notation: Notation) -> LLMatcher:
    """The engine with a machine's grammar; it says what it does not understand."""
    written = write_grammar(grammar_of(machine), notation)
    grammar = grammar_from("lark", gbnf_to_lark(written) if notation is Notation.GBNF else written)
    bytewise = LLTokenizer("byte")
    assert LLMatcher.validate_grammar(grammar, bytewise) == ""
    return LLMatcher(bytewise, grammar)


def accepts(machine: str, notation: Notation, text: str) -> bool:
    matcher = engine(machine, notation)
    matcher.reset()
    written = list(text.encode())
    return matcher.try_consume_tokens(written) == len(written) and matcher.is_accepting()


@pytest.mark.parametrize("notation", NOTATIONS)
@pytest.mark.parametrize("machine", MACHINES, ids=lambda name: Path(name).stem)
def test_an_engine_allows_the_programs_that_the_grammar_derives(machine: str, notation: Notation) -> None:
    random = Random(6)
    for _ in range(PROGRAMS):
        text = derive(grammar_of(machine), random)
        assert accepts(machine, notation, text), text


@pytest.mark.parametrize("notation", NOTATIONS)
def test_an_engine_allows_every_shipped_program_without_faulty_text(notation: Notation) -> None:
    known = test_grammar.recognizer("robot-dog")
    for path in test_grammar.SHIPPED:
        text = path.read_text("utf-8")
        right = all(map(known.accepts, split_lines(text)))
        assert accepts("robot-dog", notation, text) == right, path


@pytest.mark.parametrize("notation", NOTATIONS)
@pytest.mark.parametrize("name", POSTS)
def test_an_engine_allows_the_programs_of_posts(name: str, notation: Notation) -> None:
    machine = str(CORPUS / f"{name.split('.')[-2]}.toml")
    assert accepts(machine, notation, (CORPUS / name).read_text("utf-8"))


@pytest.mark.parametrize("notation", NOTATIONS)
def test_an_engine_allows_no_near_miss(notation: Notation) -> None:
    misses = {test_grammar.PLAIN: list(test_grammar.NEAR_MISSES)}
    misses |= {str(CORPUS / f"{each}.toml"): test_profile_grammar.misses(each) for each in PROFILES}
    for machine, lines in misses.items():
        assert [line for line in lines if accepts(machine, notation, line)] == []
