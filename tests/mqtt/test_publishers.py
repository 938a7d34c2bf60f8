"""What a broker is sent: plain topics, and births, data and deaths of Sparkplug."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import pytest

from mcserver.cli.app import run_command_line
from mcserver.mqtt.payload import BOOLEAN, Metric, decoded, encoded
from mcserver.mqtt.publishers import REBIRTH, Message, PlainTopics, SparkplugNode

WALL = 1_800_000_000.25
VALUES = {"state": "ready", "faults": 0, "axes/X/position": 1.5}


def node() -> SparkplugNode:
    made = SparkplugNode("site", "cell", lambda: WALL)
    made.will()
    return made


def shown(messages: Iterable[Message]) -> list[tuple[str, int, dict[Any, Any]]]:
    """Topic, number, and metrics by name or alias."""
    found = []
    for each in messages:
        payload = decoded(each.payload)
        metrics = {}
        for metric in payload.metrics:
            ((_, value),) = [each for each in metric.ListFields() if each[0].name.endswith("_value")]
            metrics[metric.name or metric.alias] = value
        found.append((each.topic, payload.seq, metrics))
    return found


def test_plain_topics_hold_the_whole_state_for_who_comes_later() -> None:
    topics = PlainTopics("mc")
    online, *_ = topics.begin({})
    assert (online.topic, online.payload, online.retain) == ("mc/status", b"online", True)
    there, state = topics.appeared("cell-1", VALUES)
    assert (there.topic, there.payload) == ("mc/cell-1/availability", b"online")
    assert json.loads(state.payload) == {"state": "ready", "faults": 0, "axes": {"X": {"position": 1.5}}}
    (changed,) = topics.changed("cell-1", {"faults": 1})
    assert json.loads(changed.payload)["faults"] == 1
    assert json.loads(changed.payload)["state"] == "ready"
    assert topics.will() == topics.end()
    assert topics.will().payload == b"offline"


def test_births_name_every_metric_and_data_has_their_aliases() -> None:
    sparkplug = node()
    birth, device = shown(sparkplug.begin({"cell-1": VALUES}))
    assert birth == ("spBv1.0/site/NBIRTH/cell", 0, {"bdSeq": 0, REBIRTH: False})
    assert device == ("spBv1.0/site/DBIRTH/cell/cell-1", 1, VALUES)
    ((topic, seq, metrics),) = shown(sparkplug.changed("cell-1", {"axes/X/position": 2.0, "faults": 3}))
    assert (topic, seq, metrics) == ("spBv1.0/site/DDATA/cell/cell-1", 2, {3: 2.0, 2: 3})
    assert shown(sparkplug.gone("cell-1")) == [("spBv1.0/site/DDEATH/cell/cell-1", 3, {})]


def test_numbers_go_round_and_begin_anew_with_a_birth() -> None:
    sparkplug = node()
    list(sparkplug.begin({"cell-1": VALUES}))
    seqs = [shown(sparkplug.changed("cell-1", {"faults": step}))[0][1] for step in range(256)]
    assert seqs[253:] == [255, 0, 1]
    assert shown(sparkplug.begin({}))[0][1] == 0


def test_a_death_belongs_to_its_birth() -> None:
    sparkplug = SparkplugNode("site", "cell", lambda: WALL)
    for expected in (0, 1):
        death = sparkplug.will()
        ((topic, _, metrics),) = shown([death])
        assert (topic, metrics) == ("spBv1.0/site/NDEATH/cell", {"bdSeq": expected})
        assert not decoded(death.payload).HasField("seq")
        assert shown(sparkplug.begin({}))[0][2]["bdSeq"] == expected


def test_what_changed_without_a_broker_comes_as_historical_behind_the_births() -> None:
    sparkplug = node()
    list(sparkplug.begin({"cell-1": VALUES}))
    sparkplug.missed("cell-1", {"faults": 7})
    sparkplug.missed("gone", {"faults": 9})
    sparkplug.will()
    *_, last = sparkplug.begin({"cell-1": VALUES})
    (metric,) = decoded(last.payload).metrics
    assert (metric.long_value, metric.is_historical) == (7, True)
    assert len(list(sparkplug.begin({"cell-1": VALUES}))) == 2


def test_a_metric_that_the_birth_did_not_name_makes_a_new_birth() -> None:
    sparkplug = node()
    list(sparkplug.begin({"cell-1": VALUES}))
    ((topic, _, metrics),) = shown(sparkplug.changed("cell-1", {"axes/Y/position": 0.5}))
    assert topic.startswith("spBv1.0/site/DBIRTH/")
    assert metrics == {"axes/Y/position": 0.5}


def test_only_a_rebirth_is_obeyed() -> None:
    def command(name: str, value: bool) -> bytes:
        return encoded([Metric(name, 0, BOOLEAN, value, WALL)], wall=WALL, seq=None)

    sparkplug = node()
    assert sparkplug.asks_for_rebirth(command(REBIRTH, True))
    others = (command(REBIRTH, False), command("Node Control/Reboot", True))
    for payload in (*others, b"", b"\xff" * 40, bytes(1000)):
        assert not sparkplug.asks_for_rebirth(payload)


def test_negative_integers_are_twos_complement() -> None:
    ((_, _, metrics),) = shown(node().changed("m", {"offset": -2}))
    assert metrics == {"offset": 2**64 - 2}


@pytest.mark.parametrize("name", ["a+b", "a#", "a/b"])
def test_no_name_of_a_machine_is_a_wildcard(name: str) -> None:
    ((topic, _, _),) = shown(node().gone(name))
    assert topic.endswith(("/a_b", "/a_"))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["mqtts://broker", "--authority", "missing.pem"], "missing.pem cannot be read: No such file"),
        (["mqtts://broker", "--authority", __file__], "test_publishers.py cannot be read"),
        (["mqtt://broker", "--authority", "authority.pem"], "reached without TLS"),
        (["http://broker"], "address cannot be read"),
    ],
)
def test_a_broker_that_cannot_be_meant_is_refused(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, arguments: list[str], said: str
) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    assert run_command_line(["mqtt", *arguments]) == 3
    narration = capsys.readouterr().err
    assert "MC079" in narration
    assert said in narration
