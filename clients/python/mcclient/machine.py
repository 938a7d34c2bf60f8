"""A machine: the client's entrance."""

from __future__ import annotations

import asyncio
import os
import secrets
from collections.abc import AsyncIterator, Generator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, TypeVar

from mcclient import discovery
from mcclient.calls import DEADLINE_S, Caller
from mcclient.errors import MotionError, ProtocolError, RequestRefused
from mcclient.estop import emergency_stop, send_until_confirmed
from mcclient.events import open_events
from mcclient.feed import Feed, Queue
from mcclient.keys import PROTOCOL_VERSION, Keys
from mcclient.presence import Presence
from mcclient.program import Program
from mcclient.reports import Report, is_end, reports_of
from mcclient.stream import LineStream
from mcclient.telemetry import InfoHolder, Samples, open_samples, open_states
from mcclient.transport import Link
from mcclient.types import (
    CheckResult,
    Event,
    EventPage,
    Info,
    MachineStatus,
    OnDisconnect,
    OpenedProgram,
    ProgramStatus,
)
from mcclient.wire import decode, from_wire, unpack

T = TypeVar("T")

CONNECT_S = 3.0
PATIENCE_S = 10.0
LONG_JOB_S = 120.0
EVENTS_A_PAGE = 1000
