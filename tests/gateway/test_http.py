"""HTTP and JSON, and the OpenAPI description of it."""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import pytest

from mcserver.net.method_table import METHODS
from tests.gateway.conftest import GatewayProcess

Tokens = tuple[Path, dict[str, str]]


def ask(gateway: GatewayProcess, path: str, token: str, body: object = None) -> tuple[int, Any]:
    request = urllib.request.Request(
        gateway.url + path,
        None if body is None else json.dumps(body).encode(),
        {"Authorization": f"Bearer {token}", "Content-Type": "application/json"},
    )
    try:
        with urllib.request.urlopen(request, timeout=60.0) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, json.loads(error.read())


def test_a_program_is_opened_filled_closed_and_finished(gateway: GatewayProcess, tokens: Tokens) -> None:
    token = tokens[1]["operator"]
    for _ in range(100):
        # the gateway may have begun a moment before it knows of the machine
        listed = ask(gateway, "/v1/machines", token)
        if listed[1]:
            break
    assert listed == (200, ["cell"])
    assert ask(gateway, "/v1/machines/cell/info", token)[1]["machine"] == "cell"
    program = ask(gateway, "/v1/machines/cell/open", token, {"name": "by http"})[1]["program"]
    lines = {"program": program, "first": 1, "lines": ["G1010", "G01 X5 F6000", "G01 X0"]}
    assert ask(gateway, "/v1/machines/cell/submit", token, lines)[1]["accepted"] == 3
    assert ask(gateway, "/v1/machines/cell/close", token, {"program": program, "last": 3})[0] == 200
    for _ in range(1000):
        found = ask(gateway, "/v1/machines/cell/programs", token)[1]["programs"][0]
        if found["state"] == "finished":
            break
    assert (found["program"], found["state"], found["done"]) == (program, "finished", 3)


def test_a_text_is_checked_with_the_place_of_its_faults(gateway: GatewayProcess, tokens: Tokens) -> None:
    status, answer = ask(
        gateway, "/v1/machines/cell/check", tokens[1]["operator"], {"text": "G01 X1 F60\nG02 X9 R1"}
    )
    assert (status, answer["ok"]) == (200, False)
    assert answer["diagnostics"][0]["line"] == 2


@pytest.mark.parametrize(
    ("path", "role", "body", "status", "code"),
    [
        ("/v1/machines/cell/hold", "observer", {}, 403, "MC072"),
        ("/v1/machines/cell/status", "nobody", None, 401, "MC072"),
        ("/v1/machines/nothere/status", "observer", None, 404, "MC530"),
        ("/v1/machines/cell/hodl", "operator", {}, 404, "MC501"),
        ("/v1/machines/cell/hold", "operator", None, 405, "MC501"),
        ("/", "operator", None, 404, "MC501"),
        ("/v1/machines/a*b/status", "observer", None, 400, "MC500"),
        ("/v1/machines/cell/override", "operator", {"percent": 300}, 400, "MC511"),
        ("/v1/machines/cell/abort", "operator", {"program": "none-such"}, 404, "MC503"),
        ("/v1/machines/cell/open", "operator", {"axes": [40]}, 400, "MC507"),
        ("/v1/machines/cell/hold", "operator", {"progam": "a"}, 400, "MC500"),
        ("/v1/machines/cell/hold", "operator", {"request": 1}, 400, "MC500"),
        ("/v1/machines/cell/hold", "operator", ["a"], 400, "MC500"),
    ],
)
def test_a_refusal_has_a_status_and_a_code(
    gateway: GatewayProcess, tokens: Tokens, path: str, role: str, body: object, status: int, code: str
) -> None:
    answered, answer = ask(gateway, path, tokens[1].get(role, "x"), body)
    assert (answered, answer["code"]) == (status, code)


def test_every_method_is_a_route_that_openapi_describes(gateway: GatewayProcess, tokens: Tokens) -> None:
    described = ask(gateway, "/openapi.json", tokens[1]["observer"])[1]
    routes = {path.rpartition("/")[2]: each for path, each in described["paths"].items()}
    assert routes.keys() == {method.name for method in METHODS} | {"machines"}
    submit = routes["submit"]["post"]["requestBody"]["content"]["application/json"]["schema"]["$ref"]
    message = described["components"]["schemas"][submit.rpartition("/")[2]]
    assert message["required"] == ["program", "first", "lines"]
    assert "request" not in message["properties"]
    assert {name for name, each in routes.items() if "get" in each} >= {"info", "status", "programs"}
    assert not any("get" in routes[method.name] for method in METHODS if method.changes)


@pytest.mark.timeout(600)
def test_random_requests_by_the_description_never_break_the_gateway(
    gateway: GatewayProcess, tokens: Tokens
) -> None:
    schemathesis = pytest.importorskip("schemathesis", reason="schemathesis is not installed")
    from hypothesis import HealthCheck, Phase, given, settings

    described = ask(gateway, "/openapi.json", tokens[1]["observer"])[1]
    schema = schemathesis.openapi.from_dict(described)
    # an observer's token: nothing of what is made up here may move the machine
    headers = {"Authorization": f"Bearer {tokens[1]['observer']}"}
    limits = settings(
        max_examples=8,
        database=None,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    asked = 0
    for result in schema.get_all_operations():
        operation = result.ok()
        if operation.path.endswith(("estop", "simulate")):
            continue

        @limits
        @given(case=operation.as_strategy())
        def probe(case: Any) -> None:
            nonlocal asked
            asked += 1
            # a name made up is a machine that is not there, and says nothing of the method
            if "machine" in case.path_parameters:
                case.path_parameters["machine"] = "cell"
            answer = case.call(base_url=gateway.url, headers=headers)
            assert answer.status_code < 500, (case.path, answer.status_code, answer.text)

        probe()
    assert asked > 20
    assert gateway.process.poll() is None
