"""Rows that stay as long as what they are of: a click on one that is built anew meanwhile is lost."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from typing import Generic, TypeVar

from nicegui import ui

K = TypeVar("K", bound=Hashable)


class KeptRows(Generic[K]):
    """A row for each key, in their order.

    Args:
        build: builds the row of a key; returns the label of what changes in it.

    Attributes:
        element: that the rows are in.
    """

    def __init__(self, build: Callable[[K], ui.label]) -> None:
        self._build = build
        self._rows: dict[K, tuple[ui.element, ui.label]] = {}
        self.element = ui.element("div").classes("w-full")

    def show(self, texts: Mapping[K, str]) -> None:
        """Show these rows and no others, each with its text."""
        for key in self._rows.keys() - texts.keys():
            self._rows.pop(key)[0].delete()
        for place, (key, text) in enumerate(texts.items()):
            if key not in self._rows:
                with self.element, ui.element("div").classes("w-full") as row:
                    self._rows[key] = row, self._build(key)
            row, label = self._rows[key]
            if self.element.default_slot.children[place] is not row:
                row.move(self.element, place)
            label.set_text(text)
