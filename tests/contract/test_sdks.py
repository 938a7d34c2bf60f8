"""The SDKs' types and calls are those of the server."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcserver.contract.sdk.files import LANGUAGES, files
from mcserver.contract.sdk.model import model
from mcserver.net.method_table import METHODS

CLIENTS = Path(__file__).parents[2] / "clients"


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_sdk_s_types_and_calls_are_current(language: str) -> None:
    made = {name: text for name, text in files().items() if name.startswith(f"{language}/")}
    stale = [name for name, text in made.items() if (CLIENTS / name).read_text("utf-8") != text]
    assert stale == [], "run: python -m mcserver.contract.sdk clients"


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_sdk_has_every_method(language: str) -> None:
    written = "".join(text for name, text in files().items() if name.startswith(f"{language}/"))
    assert [method.name for method in METHODS if f'"{method.name}"' not in written] == []


def test_no_two_methods_have_one_name_in_an_sdk() -> None:
    names = [call.name for call in model().calls]
    assert len(set(names)) == len(METHODS)
