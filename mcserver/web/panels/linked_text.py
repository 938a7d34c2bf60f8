"""A program's lines beside its path: the line that is chosen in one is marked in the other."""

from __future__ import annotations

from collections.abc import Sequence

from nicegui import ui

from mcserver.web.formatting import CONTEXT_LINES, program_excerpt
from mcserver.web.space import Space
from mcserver.web.translation import t

# the line of the row that a click was in
CLICKED_LINE = """(event) => {
  const row = event.target.closest("[data-line]");
  if (row) emit(Number(row.dataset.line));
}"""


class LinkedText:
    """The lines about the chosen one, a field for its number, and the picture in which it is marked.

    Args:
        lines: of the program. space: the picture, which has its path. first: line that is chosen at first.
    """

    def __init__(self, lines: Sequence[str], space: Space, first: int = 1) -> None:
        self._lines = lines
        self._space = space
        with ui.column().classes("mc-linked"):
            self._field = ui.number(t("Line"), value=first, min=1, max=len(lines), format="%d").classes(
                "w-32"
            )
            self._field.on_value_change(self.show)
            self._text = ui.html("", sanitize=False).classes("w-full")
        self._text.on("click", lambda event: self._field.set_value(event.args), js_handler=CLICKED_LINE)
        space.on("picked", lambda event: self._field.set_value(event.args))
        self.show()

    def show(self) -> None:
        """Mark the chosen line in both, again in a picture that has got its path anew."""
        line = min(max(int(self._field.value or 1), 1), len(self._lines))
        self._text.set_content(program_excerpt(self._lines, line, {}, 2 * CONTEXT_LINES))
        self._space.mark_line(line)
