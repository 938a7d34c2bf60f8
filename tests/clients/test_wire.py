"""What cannot be sent is refused with a code, before anything is sent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from mcclient.errors import RequestRefused
from mcclient.wire import encode


def nested() -> list[Any]:
    value: list[Any] = []
    for _ in range(10_000):
        value = [value]
    return value


@pytest.mark.parametrize("value", [lambda: {"axis": 2**70}, lambda: "\ud800", nested, object])
def test_a_value_without_a_form_in_message_pack_has_a_code(value: Callable[[], object]) -> None:
    with pytest.raises(RequestRefused, match="MC500"):
        encode(value())
