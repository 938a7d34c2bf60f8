"""The page stands alone, and a program's text cannot break out of it."""

from __future__ import annotations

import json
import re

import numpy as np

from mcserver.plot.html import MAX_POINTS, page_of
from tests.plot.synthetic import scene, smooth

PAGE = page_of(scene(smooth(400, 50.0), smooth(400, 20.0)))


def _facts(page: str) -> dict[str, object]:
    found = re.search(r"const facts = (\{.*\});\n", page)
    assert found is not None
    facts: dict[str, object] = json.loads(found.group(1))
    return facts


def test_the_page_loads_nothing() -> None:
    assert re.findall(r"""(?:src|href)\s*=|https?://|url\(|import\s*\(|fetch\(""", PAGE) == []


def test_text_of_the_program_stays_text() -> None:
    assert PAGE.count("</script>") == 1
    assert "\u2028" not in PAGE
    timed = _facts(PAGE)["timed"]
    assert isinstance(timed, list)
    assert timed[1]["source"] == "</script><b>\u2028&"


def test_times_and_limits_are_in_the_page() -> None:
    facts = _facts(PAGE)
    axes = facts["axes"]
    assert isinstance(axes, list)
    assert [axis["name"] for axis in axes] == ["X", "Y"]
    assert axes[0]["limits"] == {"velocity": 200.0, "acceleration": 1000.0, "jerk": 50000.0}
    assert facts["duration"] == 0.4


def test_a_long_run_is_thinned_without_losing_its_peaks() -> None:
    column = np.zeros(50_000)
    column[31_234:] = 1.0
    facts = _facts(page_of(scene(column, column)))
    axes = facts["axes"]
    assert isinstance(axes, list)
    assert len(axes[0]["series"]["velocity"]) == MAX_POINTS
    assert max(axes[0]["series"]["velocity"]) == 1000.0
