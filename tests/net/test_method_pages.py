"""The pages show the table of methods as it is."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcserver.net.method_pages import END, TABLES, Place, written

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("place", TABLES, ids=lambda place: place.page)
def test_a_page_s_table_is_current(place: Place) -> None:
    page = (DOCS / place.page).read_text("utf-8")
    assert page == written(page, place), "run: python -m mcserver.net.method_pages docs"


@pytest.mark.parametrize("place", TABLES, ids=lambda place: place.page)
def test_a_page_without_a_place_for_its_table_is_refused(place: Place) -> None:
    with pytest.raises(ValueError, match=place.page):
        written(f"{place.begin}\n| old |\n", place)
    assert END in written(f"{place.begin}\n| old |\n{END}", place)
