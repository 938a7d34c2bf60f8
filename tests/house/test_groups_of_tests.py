"""The groups in which tests run are of files and folders that there are, and each file is in one."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import COMPUTING, GROUPS, LONG, ROOT, TOGETHER, chosen_groups, group_of


def test_every_place_that_is_named_is_there() -> None:
    named = {*LONG, *TOGETHER, *(each for places in GROUPS.values() for each in places)}
    assert [each for each in sorted(named) if not (ROOT / each).exists()] == []


@pytest.mark.parametrize(
    ("place", "group"),
    [
        ("motion/test_laws.py", COMPUTING),
        ("language/test_lsp.py", COMPUTING),
        ("language/test_neovim.py", "clients"),
        ("e2e", "realtime"),
        ("e2e/test_mcctl.py", "realtime"),
        ("e2e_can_of_another_name.py", COMPUTING),
    ],
)
def test_a_file_is_in_one_group(place: str, group: str) -> None:
    assert group_of(Path(place)) == group


@pytest.mark.parametrize(
    ("expression", "groups"),
    [
        ("realtime", {"realtime"}),
        ("realtime or clients", {"realtime", "clients"}),
        ("computing", {COMPUTING}),
        # whoever chooses otherwise has every file collected
        ("", set()),
        ("not computing", set()),
        ("realtime and clients", set()),
        ("long", set()),
    ],
)
def test_a_choice_of_whole_groups_is_understood(expression: str, groups: set[str]) -> None:
    assert chosen_groups(expression) == groups
