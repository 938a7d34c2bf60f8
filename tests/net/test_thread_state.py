"""Network threads keep their Python thread state, a bounded number of them."""

from __future__ import annotations

import _thread
import subprocess
import sys
import threading

import pytest

from mcserver.net import thread_state
from mcserver.net.thread_state import ThreadStates

LIMIT_S = 30.0
# in a process of its own, since Zenoh's threads and what they keep are those of the process
COUNTING = """
import threading, time
import zenoh
from mcserver.net import thread_state
from mcserver.net.thread_state import ThreadStates

class Fresh:
    # how often a callback found nothing that the one before had left in the same thread
    def __init__(self):
        self.left = threading.local()
        self.calls = self.fresh = 0
    def __call__(self, sample):
        self.fresh += not hasattr(self.left, "here")
        self.left.here = True
        self.calls += 1

def session(**settings):
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("adminspace/enabled", "true")
    for key, value in settings.items():
        config.insert_json5(key.replace("_", "/"), value)
    return zenoh.open(config)

here = session(listen_endpoints='["tcp/127.0.0.1:0"]')
(reply,) = here.get(f"@/{here.zid()}/peer")
import json
(locator,) = [each for each in json.loads(reply.ok.payload.to_bytes())["locators"] if "127.0.0.1" in each]
there = session(connect_endpoints=json.dumps([locator]), listen_endpoints="[]")

def fresh(wrap):
    seen = Fresh()
    with here.declare_subscriber("k", zenoh.handlers.Callback(wrap(seen), indirect=False)):
        until = time.monotonic() + 30.0
        while seen.calls < 60 and time.monotonic() < until:
            there.put("k", b"", express=True)
            time.sleep(0.001)
    print(seen.calls >= 60, seen.fresh == seen.calls, seen.fresh < 30)

fresh(lambda each: each)
thread_state.KEPT_STATES, kept = 0, thread_state.KEPT_STATES
fresh(ThreadStates().keeping)
thread_state.KEPT_STATES = kept
fresh(ThreadStates().keeping)
there.close()
here.close()
"""


def test_network_threads_keep_their_state_from_callback_to_callback_within_a_bound() -> None:
    done = subprocess.run(
        [sys.executable, "-c", COUNTING], capture_output=True, text=True, timeout=120.0, check=True
    )
    # without it each callback finds its thread anew, the reason for all this; so do those beyond the bound
    assert done.stdout.splitlines() == ["True True False", "True True False", "True False True"]


def test_where_python_has_no_such_states_callbacks_come_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr(thread_state.ctypes, "pythonapi")
    got: list[int] = []
    ended = threading.Event()
    callback = ThreadStates().keeping(got.append)

    def run() -> None:
        callback(1)
        ended.set()

    _thread.start_new_thread(run, ())
    assert ended.wait(LIMIT_S)
    assert got == [1]
