"""The example dashboards and the alerts ask for what there is."""

from __future__ import annotations

import importlib
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import duckdb
import pytest
import yaml
from mcclient.types import AxesStatus, MachineStatus, ProgramStatus

from mcserver.web.fleet import Fleet, Seen
from mcserver.web.metrics import metrics_text
from tests.peers import python_peers
from tests.web.test_history import filled
from tests.wire_values import wire_value

DEPLOY = Path(__file__).parents[2] / "deploy"
DASHBOARD = DEPLOY / "grafana" / "machines.json"
HISTORY = DEPLOY / "grafana" / "history.json"
ALERTS = DEPLOY / "prometheus" / "alerts.yml"


def exported(tmp_path: Path) -> dict[str, set[str]]:
    """Labels of every metric of a machine that runs a program."""
    program = wire_value(
        ProgramStatus,
        program="p",
        state="running",
        client="c",
        name="n",
        axes=[0],
        start_line=1,
        line=1,
        accepted=2,
        done=1,
        credit=1,
        closed=True,
        override=100.0,
        progress=0.5,
        opened_at=0.0,
        eta_s=1.0,
    )
    axes = wire_value(AxesStatus, [0], [1.0], [1.0], [0.0], [0.0], ["moving"])
    status = wire_value(MachineStatus, 0.0, 0.0, "i", "ready", axes, [program], [])
    fleet = Fleet((), None, tmp_path)
    seen = fleet.machines["cell"] = Seen("cell")
    seen.status = status
    found: dict[str, set[str]] = {}
    for name, labels in re.findall(r"^(mc_\w+)\{(.*)\}", metrics_text(fleet).decode(), re.MULTILINE):
        found.setdefault(name, set()).update(re.findall(r'(\w+)="', labels))
    return found


Judge = Callable[[Any], list[str]]


@pytest.fixture
def schema(monkeypatch: pytest.MonkeyPatch) -> Judge:
    """What of a dashboard Grafana's own models of its schema do not know."""
    monkeypatch.setattr(sys, "path", [*sys.path, str(python_peers())])
    importlib.import_module("grafana_foundation_sdk.cog.plugins").register_default_plugins()
    model = importlib.import_module("grafana_foundation_sdk.models.dashboard").Dashboard
    encoder = importlib.import_module("grafana_foundation_sdk.cog.encoder").JSONEncoder

    def unknown(given: Any, read: Any, place: str) -> Iterator[str]:
        if isinstance(given, dict) and isinstance(read, dict):
            for name, value in given.items():
                yield from unknown(value, read.get(name), f"{place}.{name}")
        elif isinstance(given, list) and isinstance(read, list) and len(given) == len(read):
            for number, (one, other) in enumerate(zip(given, read, strict=True)):
                yield from unknown(one, other, f"{place}[{number}]")
        elif given != read:
            yield place

    def judge(dashboard: Any) -> list[str]:
        return list(unknown(dashboard, json.loads(encoder().encode(model.from_json(dashboard))), ""))

    return judge


@pytest.mark.parametrize("file", [DASHBOARD, HISTORY], ids=lambda file: file.name)
def test_grafana_s_own_schema_knows_all_of_a_dashboard(
    file: Path, schema: Callable[[Any], list[str]]
) -> None:
    dashboard = json.loads(file.read_text("utf-8"))
    assert schema(dashboard) == []
    panel = dashboard["panels"][4]
    panel["gridPosition"] = panel.pop("gridPos")
    assert schema(dashboard) == [".panels[4].gridPosition"]
    panel["gridPos"] = panel.pop("gridPosition")
    panel["fieldConfig"]["default"] = panel["fieldConfig"].pop("defaults")
    assert schema(dashboard) == [".panels[4].fieldConfig.default"]


@pytest.mark.parametrize("file", [DASHBOARD, HISTORY], ids=lambda file: file.name)
def test_no_panel_lies_over_another_or_beside_the_grid(file: Path) -> None:
    taken: set[tuple[int, int]] = set()
    for panel in json.loads(file.read_text("utf-8"))["panels"]:
        assert panel["type"] in ("stat", "table", "timeseries")
        place = panel["gridPos"]
        assert place["x"] + place["w"] <= 24
        cells = {
            (place["x"] + right, place["y"] + down)
            for right in range(place["w"])
            for down in range(place["h"])
        }
        assert not cells & taken, panel["title"]
        taken |= cells


def test_every_metric_and_label_of_the_dashboard_exists(tmp_path: Path) -> None:
    known = exported(tmp_path)
    dashboard = json.loads(DASHBOARD.read_text("utf-8"))
    expressions = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    assert len(expressions) == 11
    for expression in expressions:
        (name, matchers), *others = re.findall(r"(mc_\w+)(?:\{([^}]*)\})?", expression)
        assert others == []
        assert name in known, expression
        assert set(re.findall(r"(\w+)=~?\"", matchers)) <= known[name], expression
    query = dashboard["templating"]["list"][1]["query"]["query"]
    (asked,) = re.findall(r"mc_\w+", query)
    assert asked in known


def test_every_metric_that_is_exported_is_on_the_dashboard(tmp_path: Path) -> None:
    text = DASHBOARD.read_text("utf-8")
    assert [name for name in exported(tmp_path) if name not in text] == []


def test_every_metric_and_label_of_the_alerts_exists(tmp_path: Path) -> None:
    known = exported(tmp_path)
    (group,) = yaml.safe_load(ALERTS.read_text("utf-8"))["groups"]
    assert len({rule["alert"] for rule in group["rules"]}) == len(group["rules"]) == 10
    for rule in group["rules"]:
        used = re.findall(r"(mc_\w+)(?:\{([^}]*)\})?", rule["expr"])
        assert used
        for name, matchers in used:
            assert set(re.findall(r'(\w+)=~?"', matchers)) <= known[name], rule
        named = re.findall(r"\$labels\.(\w+)", rule["annotations"]["summary"])
        assert set(named) <= {"machine"}
        assert rule["annotations"]["remedy"]


def test_each_alert_fires_for_what_it_is_meant_for_alone() -> None:
    promtool = shutil.which("promtool")
    if promtool is None:
        pytest.skip("promtool (Debian: prometheus) is not installed")
    rules = Path(__file__).with_name("alerts_test.yml")
    judged = subprocess.run([promtool, "test", "rules", str(rules)], capture_output=True, text=True)
    assert judged.returncode == 0, judged.stdout


def asked_of(query: str, folder: Path) -> str:
    """The SQL that Grafana sends, for a day of one machine."""
    values = {
        "history:raw": str(folder),
        "machine:sqlstring": "'cell-1','cell-2'",
        "__from:date:iso": "2026-03-14T06:00:00.000Z",
        "__to:date:iso": "2026-03-15T06:00:00.000Z",
        "__interval_ms:raw": "60000",
    }
    return re.sub(r"\$\{([^}]+)\}", lambda found: values[found[1]], query)


def test_every_question_of_the_dashboard_of_the_history_has_an_answer(tmp_path: Path) -> None:
    filled(tmp_path)
    # a collector that starts anew reads an event again
    filled(tmp_path)
    dashboard = json.loads(HISTORY.read_text("utf-8"))
    (machines,) = (each["query"] for each in dashboard["templating"]["list"] if each["name"] == "machine")
    assert duckdb.sql(asked_of(machines, tmp_path)).fetchall() == [("cell-1",)]
    answers = {}
    for panel in dashboard["panels"]:
        (target,) = panel["targets"]
        answer = duckdb.sql(asked_of(target["rawSql"], tmp_path))
        answers[panel["title"]] = rows = answer.fetchall()
        assert rows, panel["title"]
        if panel["type"] == "timeseries":
            # a time, what tells the curves apart, a number
            assert target["format"] == 0
            assert [str(kind) for kind in answer.types[:2]] == ["TIMESTAMP", "VARCHAR"]
            assert [row[0] for row in rows] == sorted(row[0] for row in rows)
            assert len(answer.columns) == 3
        else:
            assert target["format"] == 1
    assert answers["Faults by code"][0][:3] == ("MC407", 1, 1)
    assert [row[1] for row in answers["Positions [mm, deg]"]] == ["cell-1 0", "cell-1 3"]


def test_a_question_of_the_dashboard_opens_no_file_of_another_day(tmp_path: Path) -> None:
    filled(tmp_path)
    broken = tmp_path / "states" / "day=2026-03-16" / "broken.parquet"
    broken.parent.mkdir()
    broken.write_bytes(b"PAR1 nothing")
    for panel in json.loads(HISTORY.read_text("utf-8"))["panels"]:
        duckdb.sql(asked_of(panel["targets"][0]["rawSql"], tmp_path)).fetchall()
