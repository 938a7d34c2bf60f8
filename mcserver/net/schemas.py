"""Publish every message as JSON Schema: ``python -m mcserver.net.schemas docs/schemas``.

MessagePack's types map to JSON's, except for ``bin``, which a schema can only call a base64 string.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import msgspec

from mcserver.canopen import views
from mcserver.net import (
    arming_messages,
    drive_messages,
    info_messages,
    machine_file_messages,
    messages,
    model_messages,
    recording_messages,
    recovery_messages,
    servo_messages,
    table_messages,
    text_messages,
)
from mcserver.net.keys import VERSION_CHUNK
from mcserver.recorder import folder
from mcserver.service import reports

_ID = f"mc/{VERSION_CHUNK}"


MODULES = (
    messages,
    info_messages,
    drive_messages,
    arming_messages,
    recording_messages,
    recovery_messages,
    servo_messages,
    table_messages,
    model_messages,
    text_messages,
    machine_file_messages,
    reports,
    views,
    folder,
)


def message_types() -> dict[str, type[msgspec.Struct]]:
    """Return every message by name."""
    named: dict[str, object] = {}
    for module in MODULES:
        named |= vars(module)
    return {
        name: value
        for name, value in sorted(named.items())
        if isinstance(value, type) and issubclass(value, msgspec.Struct) and value is not msgspec.Struct
    }


def schemas() -> dict[str, str]:
    """Return the schemas as file name → text, one per message; referenced ones are in its ``$defs``."""
    files = {}
    for name, message in message_types().items():
        (top,), definitions = msgspec.json.schema_components([message], ref_template="#/$defs/{name}")
        body: dict[str, Any] = dict(definitions.pop(name, top))
        schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": f"{_ID}/{name}", **body}
        if definitions:
            schema["$defs"] = dict(sorted(definitions.items()))
        files[f"{name}.json"] = json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
    return files


def write(folder: Path) -> None:
    """Write all schemas into ``folder``, and remove those of messages that no longer exist."""
    folder.mkdir(parents=True, exist_ok=True)
    current = schemas()
    for stale in folder.glob("*.json"):
        if stale.name not in current:
            stale.unlink()
    for name, text in current.items():
        (folder / name).write_text(text, "utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
