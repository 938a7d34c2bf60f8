"""What all panels are made of: a card below its title, and what is scrolled in it."""

from __future__ import annotations

import html

from nicegui import ui


def card(title: str) -> ui.card:
    """Return a new card that has a title, to be filled."""
    made = ui.card().classes("mc-card")
    with made:
        heading(title)
    return made


def heading(title: str) -> None:
    """Add the title of a card where it is not alone in its row."""
    ui.html(f"<h2>{html.escape(title)}</h2>", sanitize=False)


def scrolled(label: str) -> ui.html:
    """Add a place for HTML that may be wider than the card, which keys can scroll."""
    made = ui.html("", sanitize=False).classes("w-full overflow-x-auto")
    made.props["aria-label"] = label
    return made.props("tabindex=0 role=region")
