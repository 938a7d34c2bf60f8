"""A page that is closed while one of its handlers waits for something."""

from __future__ import annotations

import pytest
from nicegui import Client, ui
from nicegui.logging import log

from mcserver.web.resuming import forget_closed_pages, resume_after_cuts


def answer_late(*, closed: bool) -> None:
    """Answer as a handler does, and fail as one whose page is gone."""
    client = Client(ui.page("/closed"))
    forget_closed_pages()
    resume_after_cuts(client)
    with client:
        if closed:
            client.delete()
        ui.notify("done")
        try:
            raise RuntimeError("The parent element this slot belongs to has been deleted.")
        except RuntimeError:
            # as the framework does
            log.exception("a handler has failed")


async def test_it_leaves_nothing_in_the_log(caplog: pytest.LogCaptureFixture) -> None:
    answer_late(closed=True)
    assert caplog.records == []


async def test_of_a_page_that_is_open_an_error_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    answer_late(closed=False)
    assert [each.message for each in caplog.records] == ["a handler has failed"]
