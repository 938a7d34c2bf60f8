"""Client of the open motion server.

```python
async with Machine.connect() as machine:
    async with machine.program() as program:
        await program.send("G01 X10 F600")
```

`mcclient.sync` has the same without ``async``; docs/sdk.md is the guide; `mcclient.errors` draws the error
tree.
"""

from mcclient.discovery import list_machines
from mcclient.errors import (
    ConfigurationError,
    MotionError,
    NoAnswerInTime,
    NobodyAnswers,
    ProgramAborted,
    ProgramClosed,
    ProgramError,
    ProgramFaulted,
    ProgramInterrupted,
    ProgramRejected,
    ProtocolError,
    RequestRefused,
    SeveralMachines,
)
from mcclient.estop import emergency_stop
from mcclient.feed import Feed
from mcclient.machine import Machine
from mcclient.program import Line, Program, ProgramResult
from mcclient.reports import Report
from mcclient.servo import Servo
from mcclient.telemetry import Samples
from mcclient.types import (
    AxisInfo,
    BusScan,
    CheckReply,
    Continuation,
    Diagnostic,
    DriveInfo,
    Edit,
    Event,
    Fault,
    Info,
    InputInfo,
    InputStatus,
    LineReport,
    MachineStatus,
    MonitoredValue,
    OutputInfo,
    OutputStatus,
    ProgramStatus,
    ScannedNode,
    SdoReply,
    ServoStatus,
    ToolInfo,
)

__all__ = [
    "AxisInfo",
    "BusScan",
    "CheckReply",
    "ConfigurationError",
    "Continuation",
    "Diagnostic",
    "DriveInfo",
    "Edit",
    "Event",
    "Fault",
    "Feed",
    "Info",
    "InputInfo",
    "InputStatus",
    "Line",
    "LineReport",
    "Machine",
    "MachineStatus",
    "MonitoredValue",
    "MotionError",
    "NoAnswerInTime",
    "NobodyAnswers",
    "OutputInfo",
    "OutputStatus",
    "Program",
    "ProgramAborted",
    "ProgramClosed",
    "ProgramError",
    "ProgramFaulted",
    "ProgramInterrupted",
    "ProgramRejected",
    "ProgramResult",
    "ProgramStatus",
    "ProtocolError",
    "Report",
    "RequestRefused",
    "Samples",
    "ScannedNode",
    "SdoReply",
    "Servo",
    "ServoStatus",
    "SeveralMachines",
    "ToolInfo",
    "emergency_stop",
    "list_machines",
]
