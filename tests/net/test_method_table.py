"""The table of methods: each has one handler, messages of its own kind and roles that make sense."""

from __future__ import annotations

from typing import Any
from unittest.mock import MagicMock

import msgspec
import pytest

from mcserver.net.method_binding import bound_handlers
from mcserver.net.method_table import METHODS, Method, method_names
from mcserver.net.methods import machine_methods
from mcserver.net.roles import Role
from mcserver.net.schemas import message_types
from mcserver.net.text_messages import AxisTravel, SimulateReply
from mcserver.service.reports import LineReport, WireDiagnostic
from mcserver.simulation.simulation import simulate
from tests.service.fakes import three_axes


class Looking:
    def status(self, client: str, request: Any) -> None: ...


class LookingToo(Looking):
    pass


class Waving:
    def wave(self, client: str, request: Any) -> None: ...


STATUS = tuple(method for method in METHODS if method.name == "status")


async def test_a_server_has_a_handler_for_every_method_and_for_nothing_else() -> None:
    service = MagicMock(machine=three_axes())
    bound = machine_methods(service, MagicMock(), MagicMock(), MagicMock())
    assert list(bound) == [method.name for method in METHODS]


@pytest.mark.parametrize("handlers", [(), (Looking(), LookingToo()), (Looking(), Waving())])
def test_a_method_without_a_handler_one_with_two_and_a_handler_without_a_method_are_refused(
    handlers: tuple[object, ...],
) -> None:
    with pytest.raises(TypeError):
        bound_handlers(handlers, STATUS)
    assert list(bound_handlers((Looking(),), STATUS)) == ["status"]


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_a_method_is_published_with_its_messages_and_told_in_a_sentence(method: Method) -> None:
    published = message_types().values()
    assert method.request in published
    assert method.reply in published
    assert method.doc[0].isupper()
    assert method.doc.endswith(".")


def test_everybody_may_look_and_stop_and_nobody_moves_but_who_is_there_for_it() -> None:
    assert {"status", "events", "info", "estop"} <= set(method_names(Role.OBSERVER))
    changing = {method.name for method in METHODS if method.changes}
    assert changing & set(method_names(Role.OBSERVER)) == {"estop"}
    # a request of these that comes twice acts once
    assert {"abort", "close", "hold"} <= changing
    moving = {
        "reject",
        "open",
        "submit",
        "jog",
        "home",
        "resume",
        "step",
        "override",
        "reset",
        "arm",
        "set_table_row",
        "set_output",
    }
    assert moving <= changing
    assert not moving & set(method_names(Role.AGENT))
    assert moving < set(method_names(Role.OPERATOR)) < set(method_names(Role.ENGINEER))


def test_names_are_told_once() -> None:
    names = [method.name for method in METHODS]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("program", ["G1010\nG01 X5 F600\nG04 P0.1\n", "G01 X1\nG02"])
def test_a_simulation_s_report_is_the_reply_that_is_published(program: str) -> None:
    report = simulate(program, three_axes(), path_points=8).report
    reply = msgspec.convert(report, SimulateReply, strict=True)
    assert set(report) <= set(reply.__struct_fields__)
    for told, kind in (
        (report["lines"], LineReport),
        (report["axes"].values(), AxisTravel),
        (report["diagnostics"], WireDiagnostic),
    ):
        assert {name for each in told for name in each} <= set(kind.__struct_fields__)
