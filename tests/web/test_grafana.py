"""The example dashboards and the alerts ask for what there is."""

from __future__ import annotations

import json
import re
from pathlib import Path

import duckdb
import yaml
from mcclient.types import AxesStatus, MachineStatus, ProgramStatus

from mcserver.web.fleet import Fleet, Seen
from mcserver.web.metrics import metrics_text
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
