"""The files of `clients/contract`: messages, frames, rows of samples, sequences of lines and of targets."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec

from mcserver.contract.sequences import sequences
from mcserver.contract.targets import target_sequences
from mcserver.contract.telemetry import telemetry
from mcserver.contract.vectors import defaults, garbage, later_words, refusals, vectors
from mcserver.gateway import frames
from mcserver.net.schemas import message_types

FRAMES_TO_THE_GATEWAY = (
    frames.Call,
    frames.Subscribe,
    frames.Unsubscribe,
    frames.Estop,
    frames.Machines,
    frames.Targets,
)
FRAMES_TO_THE_CLIENT = (frames.Hello, frames.Reply, frames.Message)


def contract() -> dict[str, str]:
    """File name below `clients/contract` → text."""
    files = {
        f"messages/{name}.json": _message(name, kind)
        for name, kind in message_types().items()
        # what all requests have in common is no message by itself
        if name != "Request"
    }
    for kind in (*FRAMES_TO_THE_GATEWAY, *FRAMES_TO_THE_CLIENT):
        sent = kind in FRAMES_TO_THE_GATEWAY
        files[f"frames/{kind.__name__}.json"] = _shown(_vectors(kind.__name__, kind, sent_by_clients=sent))
    files["garbage.json"] = _shown({"refused": garbage()})
    files["telemetry.json"] = _shown(telemetry())
    for folder, made in (("sequences", sequences()), ("targets", target_sequences())):
        files |= {f"{folder}/{each['name'].replace(' ', '-')}.json": _shown(each) for each in made}
    return files


def write(folder: Path) -> None:
    """Write all files and take away those of messages that are gone."""
    current = contract()
    for stale in folder.glob("*/*.json"):
        name = str(stale.relative_to(folder))
        if name not in current and not name.startswith("schemas/"):
            stale.unlink()
    for name, text in current.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, "utf-8")


def _message(name: str, kind: type[msgspec.Struct]) -> str:
    sent = name.endswith("Request") or name in ("StreamLines", "StreamTargets")
    return _shown({**_vectors(name, kind, sent_by_clients=sent), "schema": f"schemas/{name}.json"})


def _vectors(name: str, kind: type[msgspec.Struct], *, sent_by_clients: bool) -> dict[str, Any]:
    later = [] if sent_by_clients else later_words(kind)
    return {
        "name": name,
        "sent_by": "client" if sent_by_clients else "server",
        "array": kind.__struct_config__.array_like,
        "defaults": defaults(kind),
        "vectors": vectors(kind),
        **({"later_words": later} if later else {}),
        "refused": refusals(kind, sent_by_clients=sent_by_clients),
    }


def _shown(content: object) -> str:
    """JSON with one vector a line, so that a change shows as what it is."""
    lines = []
    assert isinstance(content, dict)
    for key, value in content.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            rows = ",\n".join(f"    {_line(each)}" for each in value)
            lines.append(f"  {_line(key)}: [\n{rows}\n  ]")
        else:
            lines.append(f"  {_line(key)}: {_line(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _line(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
