"""A list of what comes and goes: programs, folders, groups, machines."""

from __future__ import annotations

from typing import Any

from nicegui import events, ui


class Choice(ui.select):
    """A list to choose from, where the option is the one whose label was chosen in the browser.

    NiceGUI's own goes by its place, which is another option's where the list has changed on the way.
    """

    def _event_args_to_value(self, e: events.GenericEventArguments) -> Any:
        if not isinstance(e.args, dict):
            return super()._event_args_to_value(e)
        label = e.args["label"]
        # one that is gone chooses nothing
        return self._values[self._labels.index(label)] if label in self._labels else self.value
