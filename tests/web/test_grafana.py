"""The example dashboard and the alerts name metrics that there are."""

from __future__ import annotations

import json
import re
from pathlib import Path

import yaml
from mcclient.types import AxesStatus, MachineStatus, ProgramStatus

from mcserver.web.fleet import Fleet, Seen
from mcserver.web.metrics import metrics_text
from tests.wire_values import wire_value

DEPLOY = Path(__file__).parents[2] / "deploy"
DASHBOARD = DEPLOY / "grafana" / "machines.json"
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
