"""The newcomer's twenty tasks of docs/web.md: none above five clicks, and each click is on a page."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
MOST_CLICKS = 5
# made of an axis, a direction, a step, a percent, a system of numbers: how the page writes them
MADE = {
    "X+": "{axis_name(axis.index)}{sign}",
    "Z+": "{word}{sign}",
    "X": "{axis_name(axis.index)} [{axis.unit}]",
    "G55": "{each} {shows.names.get(each, '')}",
    "Zero X": "Zero {name}",
    "step 1": "step {step:g}",
    "50 %": "{percent} %",
    "Run from line": "Run from line {",
    "Go on at line": "Go on at line {",
    "Take this way": "Take this way: ",
    "Continue at line": "Continue at line {",
}


def tasks() -> dict[int, list[str]]:
    rows = re.findall(
        r"^\| (\d+) \| [^|]+ \| ([^|]+) \|$", (ROOT / "docs" / "web.md").read_text("utf-8"), re.M
    )
    return {int(number): re.findall(r"\*([^*]+)\*", clicks) for number, clicks in rows}


def test_each_of_the_twenty_tasks_takes_five_clicks_at_most_on_what_the_page_has() -> None:
    found = tasks()
    assert sorted(found) == list(range(1, 21))
    folders = (ROOT / "mcserver" / "web", ROOT / "clients" / "python" / "mcclient" / "cli")
    text = "".join(each.read_text("utf-8") for folder in folders for each in sorted(folder.rglob("*.py")))
    for number, clicks in found.items():
        assert 1 <= len(clicks) <= MOST_CLICKS, number
        for click in clicks:
            written = MADE.get(click)
            assert (written in text) if written else re.search(rf'["\']{re.escape(click)}["\']', text), click
