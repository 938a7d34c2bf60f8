"""What is logged of faults that nobody has caught."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from pathlib import Path

import pytest

from mcserver.doors.listening import (
    MOST_LINES,
    PERIOD_S,
    Address,
    FewLines,
    Protection,
    WithoutTracebacks,
    require_usable,
)
from mcserver.errors import ConfigurationError, ServiceError
from tests.clock import Clock


def unprotected() -> None:
    Protection("MC074", "it", "tokens", "give some").require(Address("0.0.0.0", 0), has_secrets=False)


@pytest.mark.parametrize(
    ("raise_it", "said"),
    [
        (lambda: json.loads("{"), "what a client sent could not be understood: JSONDecodeError: Exp"),
        (unprotected, "a task failed"),
    ],
)
def test_a_fault_of_a_library_over_what_was_sent_is_one_line(
    raise_it: Callable[[], object], said: str
) -> None:
    with pytest.raises((ValueError, ConfigurationError)) as found:
        raise_it()
    # without this test's own frames
    trace = found.value.__traceback__
    while trace is not None and trace.tb_frame.f_globals["__name__"] == __name__:
        trace = trace.tb_next
    error = found.value.with_traceback(trace)
    record = logging.LogRecord(
        "asyncio", logging.ERROR, "", 0, "a task failed", None, (type(error), error, trace)
    )
    assert WithoutTracebacks().filter(record)
    assert record.getMessage().startswith(said)
    assert (record.exc_info is None) == (raise_it is not unprotected)


def test_lines_about_what_clients_send_are_bounded_and_counted() -> None:
    clock = Clock(0.0)
    few = FewLines(clock)

    def logged(name: str) -> str | None:
        record = logging.LogRecord(name, logging.WARNING, "", 0, "%d%% of it", (50,), None)
        return record.getMessage() if few.filter(record) else None

    for name in ("uvicorn.error", "mcserver.doors.limits"):
        said = [logged(name) for _ in range(MOST_LINES + 7)]
        assert said == ["50% of it"] * MOST_LINES + [None] * 7
    assert {logged("mcserver.web.users") for _ in range(MOST_LINES + 1)} == {"50% of it"}
    clock.now = PERIOD_S
    assert logged("uvicorn.error") == "50% of it (7 lines before it left out)"
    assert logged("uvicorn.error") == "50% of it"


def test_a_fault_of_the_own_code_is_logged_however_much_garbage_comes() -> None:
    few = FewLines(Clock(0.0))
    with pytest.raises(ConfigurationError) as found:
        unprotected()
    fault = (found.type, found.value, found.value.__traceback__)
    logged = [
        few.filter(logging.LogRecord("asyncio", logging.ERROR, "", 0, "a task failed", None, trace))
        for trace in [*[None] * (MOST_LINES + 1), fault]
    ]
    assert logged == [*[True] * MOST_LINES, False, True]


def test_a_certificate_that_cannot_be_shown_is_named(tmp_path: Path) -> None:
    missing, broken = tmp_path / "missing.pem", tmp_path / "broken.pem"
    broken.write_text("nothing")
    for file in (missing, broken):
        with pytest.raises(ServiceError, match=file.name) as found:
            require_usable(file, file)
        assert found.value.code == "MC065"
