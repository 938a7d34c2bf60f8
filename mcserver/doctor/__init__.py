"""What this computer lacks for running motion, each finding with its fix.

Probes read facts and judge nothing; judges are pure functions from facts to findings.
"""

from __future__ import annotations

import sys

from mcserver.doctor.can import judge_can, probe_can
from mcserver.doctor.finding import Finding, State, missing, worst
from mcserver.doctor.machine import judge_buses, probe_buses
from mcserver.doctor.python import judge_python, probe_python
from mcserver.doctor.realtime import judge_realtime, probe_realtime
from mcserver.doctor.service import judge_service, probe_service
from mcserver.errors import NEEDS_LINUX
from mcserver.machine.machine_file import Machine
from mcserver.service.service_options import state_folder

__all__ = ["Finding", "State", "examine", "worst"]


def examine(machine: Machine | None = None) -> list[Finding]:
    """Look at this computer, and at the buses of a machine, and give every finding, good ones too."""
    python = judge_python(probe_python())
    if sys.platform != "linux":
        return [*python, missing("realtime", "system", sys.platform, NEEDS_LINUX)]
    can = probe_can()
    return [
        *python,
        *judge_realtime(probe_realtime()),
        *judge_can(can),
        *([] if machine is None else judge_buses(machine, probe_buses(machine), can)),
        *judge_service(probe_service(state_folder())),
    ]
