"""Lists whose options come and go."""

from __future__ import annotations

from nicegui import Client, ui
from nicegui.events import GenericEventArguments

from mcserver.web.choice import Choice


def chosen(made: Choice, label: str, place: int) -> object:
    """Return the value after an option was chosen that the browser has at that place."""
    args = {"label": label, "value": place}
    return made._event_args_to_value(GenericEventArguments(sender=made, client=made.client, args=args))


def test_an_option_is_chosen_by_its_label_also_where_the_list_has_changed_on_the_way() -> None:
    with Client(ui.page("/choice")):
        programs = Choice(["b.gcode", "c.gcode"])
        programs.set_options(["a.gcode", "b.gcode", "c.gcode"])
        assert chosen(programs, "b.gcode", 0) == "b.gcode"
        groups = Choice({"": "all groups", "hall": "hall"}, value="")
        groups.set_options({"": "all groups", "cell": "cell", "hall": "hall"})
        assert chosen(groups, "hall", 1) == "hall"


def test_an_option_that_is_gone_chooses_nothing() -> None:
    with Client(ui.page("/choice")):
        programs = Choice(["a.gcode", "b.gcode"], value="b.gcode")
        programs.set_options(["b.gcode"])
        assert chosen(programs, "a.gcode", 0) == "b.gcode"
