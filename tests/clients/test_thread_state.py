"""The SDK's network threads keep their Python thread state from callback to callback."""

from __future__ import annotations

import subprocess
import sys

from mcclient import thread_state
from mcclient.thread_state import ThreadStates

# in a process of its own, since Zenoh's threads and what they keep are those of the process
COUNTING = """
import json, threading, time
import zenoh
from mcclient.thread_state import ThreadStates

def session(**settings):
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("adminspace/enabled", "true")
    for key, value in settings.items():
        config.insert_json5(key.replace("_", "/"), value)
    return zenoh.open(config)

here = session(listen_endpoints='["tcp/127.0.0.1:0"]')
(reply,) = here.get(f"@/{here.zid()}/peer")
(locator,) = [each for each in json.loads(reply.ok.payload.to_bytes())["locators"] if "127.0.0.1" in each]
there = session(connect_endpoints=json.dumps([locator]), listen_endpoints="[]")

def fresh(keep):
    left = threading.local()
    calls, found = [], []
    def callback(sample):
        keep()
        if not hasattr(left, "here"):
            found.append(sample)
        left.here = True
        calls.append(sample)
    with here.declare_subscriber("k", zenoh.handlers.Callback(callback, indirect=False)):
        until = time.monotonic() + 60.0
        while len(calls) < 60 and time.monotonic() < until:
            there.put("k", b"", express=True)
            time.sleep(0.001)
    print(len(calls) >= 60, len(found) == len(calls), len(found) < 30)

fresh(lambda: None)
fresh(ThreadStates().keep)
there.close()
here.close()
"""


def test_a_network_thread_is_known_again_in_the_next_callback() -> None:
    done = subprocess.run(
        [sys.executable, "-c", COUNTING], capture_output=True, text=True, timeout=120.0, check=True
    )
    # without it each callback finds its thread anew, the reason for all this
    assert done.stdout.splitlines() == ["True True False", "True False True"]


def test_no_more_states_are_kept_than_the_bound() -> None:
    states = ThreadStates()
    states._count = thread_state.KEPT_STATES
    states.keep()
    states.keep()
    assert states._count == thread_state.KEPT_STATES
