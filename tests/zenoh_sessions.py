"""Sessions of Zenoh by their settings, and where one listens."""

from __future__ import annotations

import json
from collections.abc import Mapping

import zenoh


def opened(settings: Mapping[str, object]) -> zenoh.Session:
    """Open a session with these settings; it looks for nobody by multicast."""
    config = zenoh.Config()
    for key, value in {"scouting/multicast/enabled": False, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def locator_of(session: zenoh.Session) -> str:
    """Where a session with ``adminspace/enabled`` listens."""
    for reply in session.get(f"@/{session.zid()}/*", timeout=2.0):
        if reply.ok is not None:
            found: list[str] = json.loads(reply.ok.payload.to_bytes())["locators"]
            return next(each for each in found if "127.0.0.1" in each)
    raise RuntimeError("the session does not say where it listens")
