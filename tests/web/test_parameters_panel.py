"""The card of a drive's parameters, without a browser."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any, cast

import pytest
from nicegui import Client, ui

from mcserver.canopen.desk import Reading
from mcserver.canopen.parameters import Parameter
from mcserver.web.panels.desk_drive import DeskDrive
from mcserver.web.panels.desk_parameters import ParametersPanel


@pytest.mark.parametrize(("typed", "shown"), [("", "7"), ("12", "12")])
async def test_a_reading_that_comes_late_does_not_take_the_place_of_what_was_typed(
    typed: str, shown: str
) -> None:
    answer: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
    drive = SimpleNamespace(parameters=[], on_change=lambda _act: None, read=lambda _work: answer)
    parameter = Parameter(0x6065, 0, "Following error window", "u32", "rw", None, None)
    with Client(ui.page("/drives")) as client:
        panel = ParametersPanel(cast("DeskDrive", drive))
        reading = asyncio.ensure_future(panel._take(parameter))
        await asyncio.sleep(0)
        (field,) = (
            each
            for each in client.elements.values()
            if isinstance(each, ui.input) and each.props["label"] == "Value"
        )
        field.set_value(typed)
        answer.set_result(Reading(parameter, "u32", 7, b"\x07\x00\x00\x00"))
        await reading
        assert field.value == shown
