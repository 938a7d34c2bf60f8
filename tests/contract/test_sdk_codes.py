"""Every code that an SDK can raise stands on the page of errors."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "wire" / "errors.md").read_text("utf-8")
SOURCES = {
    "python": "clients/python/mcclient/*.py",
    "typescript": "clients/typescript/src/*.ts",
    "go": "clients/go/*.go",
    "rust": "clients/rust/src/**/*.rs",
    "java": "clients/java/src/main/**/*.java",
}


@pytest.mark.parametrize("language", SOURCES)
def test_a_code_that_an_sdk_raises_is_on_the_page_of_errors(language: str) -> None:
    files = list(ROOT.glob(SOURCES[language]))
    assert files
    codes = {code for file in files for code in re.findall(r'"(MC\d{3})"', file.read_text("utf-8"))}
    assert "MC532" in codes
    named = set(re.findall(r"MC\d{3}", PAGE))
    assert codes - named == set()


def test_the_end_of_a_stream_of_targets_is_on_the_page_of_errors() -> None:
    assert "MC465" in PAGE
