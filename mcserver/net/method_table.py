"""The remote methods of a machine: the one table that servers, doors, pages and SDKs are made from.

The server binds a handler to each (`mcserver.net.method_binding`). The router's access rules, the gateway and
the operator's page ask here who may call it. The pages of docs, the schemas and the SDKs are written from it.
A further method is a row here, its messages in a file beside this one, and its handler.
"""

from __future__ import annotations

import msgspec

from mcserver.canopen import views
from mcserver.net import arming_messages as arming
from mcserver.net import drive_messages as drive
from mcserver.net import info_messages as machine
from mcserver.net import machine_file_messages as machine_file
from mcserver.net import messages as wire
from mcserver.net import model_messages as model
from mcserver.net import recording_messages as recording
from mcserver.net import recovery_messages as recovery
from mcserver.net import servo_messages as servo
from mcserver.net import table_messages as tables
from mcserver.net import text_messages as text
from mcserver.net.roles import ASKERS, CONFIGURERS, EVERYBODY, MOVERS, Role, Roles
from mcserver.recorder import folder
from mcserver.service import reports

# how long a caller waits for the answer [s]: at once, from a drive or disk, of a whole program
PROMPT_S, SLOW_S, WHOLE_FILE_S, WHOLE_PROGRAM_S = 5.0, 15.0, 90.0, 300.0


class Method(msgspec.Struct, frozen=True):
    """One remote method.

    Attributes:
        name: last chunk of its key. request, reply: its messages.
        roles: who may call it.
        doc: what it does, as an order; its first sentence stands in tables.
        changes: whether it changes anything: then it is idempotent by request number, and takes no wildcard.
        deadline_s: how long a caller waits for the answer.
        held: what it begins ends when the client's liveliness token goes: the token is declared before.
    """

    name: str
    request: type[wire.Request]
    reply: type[msgspec.Struct]
    roles: Roles
    doc: str
    changes: bool = False
    deadline_s: float = PROMPT_S
    held: bool = False

    @property
    def summary(self) -> str:
        """Return the first sentence of ``doc``, without its full stop."""
        return self.doc.partition(". ")[0].removesuffix(".")


METHODS: tuple[Method, ...] = (
    Method("info", wire.InfoRequest, machine.Info, EVERYBODY, "Describe the machine and the service."),
    Method(
        "status",
        wire.StatusRequest,
        reports.MachineStatus,
        EVERYBODY,
        "Tell the state of the machine now.",
    ),
    Method(
        "programs",
        wire.ProgramsRequest,
        wire.ProgramsReply,
        EVERYBODY,
        "List the programs that the server knows: running, queued, ended and interrupted, the newest first.",
    ),
    Method(
        "events",
        wire.EventsRequest,
        wire.EventsReply,
        EVERYBODY,
        "Repeat events by number, the oldest first.",
    ),
    Method(
        "open",
        wire.OpenRequest,
        wire.OpenReply,
        MOVERS,
        "Open a program, queued for its axes.",
        changes=True,
        held=True,
    ),
    Method(
        "continuation",
        recovery.ContinuationRequest,
        recovery.Continuation,
        EVERYBODY,
        "Tell how a program would go on in its middle: what is certain, where the axes are and where it has "
        "them, and the way between.",
        deadline_s=SLOW_S,
    ),
    Method(
        "continue_program",
        recovery.ContinueRequest,
        recovery.ContinueReply,
        MOVERS,
        "Go on with a program that has ended: energize what it had, bring the axes to where the line starts, "
        "and run it to its end from the lines that the journal has.",
        changes=True,
        held=True,
        deadline_s=SLOW_S,
    ),
    Method(
        "leave",
        wire.LeaveRequest,
        wire.Done,
        ASKERS,
        "End this client's programs as their ``on_disconnect`` says, without their grace: it goes.",
        changes=True,
    ),
    Method(
        "submit",
        wire.SubmitRequest,
        wire.SubmitReply,
        MOVERS,
        "Send lines, and get the verdict on their words.",
        changes=True,
    ),
    Method(
        "close",
        wire.CloseRequest,
        wire.CloseReply,
        ASKERS,
        "Say that no more lines will come.",
        changes=True,
    ),
    Method(
        "hold",
        wire.ProgramRequest,
        wire.Done,
        ASKERS,
        "Hold the feed along the path, of one program or all.",
        changes=True,
    ),
    Method(
        "resume",
        wire.ProgramRequest,
        wire.Done,
        MOVERS,
        "End a hold, M00 or M01, of one program or all.",
        changes=True,
    ),
    Method(
        "step",
        wire.StepRequest,
        wire.Done,
        MOVERS,
        "Start the next line of a program opened with ``step``.",
        changes=True,
    ),
    Method(
        "abort",
        wire.ProgramRequest,
        wire.Done,
        ASKERS,
        "Stop along the path, then drop the rest of the program, of one or all.",
        changes=True,
    ),
    Method(
        "override",
        wire.OverrideRequest,
        wire.OverrideReply,
        MOVERS,
        "Set the feed override of one program, or of all and those to come.",
        changes=True,
    ),
    Method("jog", wire.JogRequest, wire.JogReply, MOVERS, "Move one axis by hand.", changes=True, held=True),
    Method(
        "jog_tool",
        wire.ToolJogRequest,
        wire.ToolJogReply,
        MOVERS,
        "Move a tool by hand while it is held: straight on, or turning, until a joint ends its way.",
        changes=True,
        held=True,
    ),
    Method(
        "machine_file",
        machine_file.MachineFileRequest,
        machine_file.MachineFileReply,
        CONFIGURERS,
        "The machine file that the server was started with.",
    ),
    Method(
        "write_machine_file",
        machine_file.WriteMachineFileRequest,
        machine_file.WriteMachineFileReply,
        CONFIGURERS,
        "Check another text of the machine file and, where it has no error, write it at rest. The old one is "
        "kept beside it; the server goes by the new one when it is restarted.",
        changes=True,
    ),
    Method(
        "open_servo",
        servo.ServoRequest,
        servo.ServoReply,
        MOVERS,
        "Let axes follow targets that this client streams. They are energized and leased until ``close``, "
        "or until no targets come in time.",
        changes=True,
        held=True,
    ),
    Method(
        "servo_armed",
        servo.ServoRequest,
        servo.ServoReply,
        ASKERS,
        "Let axes follow targets, as ``open_servo``, inside of what an operator has approved for a while: "
        "``arm`` with ``standing_s`` and ``servo``.",
        changes=True,
        held=True,
    ),
    Method(
        "home",
        wire.HomeRequest,
        wire.HomeReply,
        MOVERS,
        "Let axes find their references. It goes on after the reply: the events "
        "``axis.homing``, ``axis.homed`` and ``program.ended`` say how.",
        changes=True,
        held=True,
    ),
    Method(
        "reference",
        wire.ReferenceRequest,
        wire.Done,
        MOVERS,
        "Say where axes are; nothing moves.",
        changes=True,
    ),
    Method(
        "reset",
        wire.ResetRequest,
        wire.Done,
        MOVERS,
        "Clear a latched fault or emergency stop. Axes stay without energy until captured (G1010).",
        changes=True,
    ),
    Method(
        "tables",
        tables.TablesRequest,
        tables.Tables,
        EVERYBODY,
        "Tell the work offsets and tools that programs start with, and who changed them. They are changed by "
        "programs: G10 L2, L20 and L1.",
    ),
    Method(
        "set_table_row",
        tables.SetTableRowRequest,
        wire.Done,
        MOVERS,
        "Name a work offset or a tool, or say how long a tool may cut and has cut.",
        changes=True,
    ),
    Method(
        "set_output", wire.SetOutputRequest, wire.SetReply, MOVERS, "Set an output by hand.", changes=True
    ),
    Method(
        "set_simulated_input",
        wire.SetInputRequest,
        wire.SetReply,
        MOVERS,
        "Set a simulated input.",
        changes=True,
    ),
    Method(
        "estop",
        wire.EstopRequest,
        wire.Done,
        EVERYBODY,
        "Stop everything at once: emergency stop. No safety function; the key ``estop`` is the faster way.",
        changes=True,
    ),
    Method(
        "check",
        wire.CheckRequest,
        wire.CheckReply,
        ASKERS,
        "Find every fault of a program's text; nothing runs.",
        deadline_s=WHOLE_PROGRAM_S,
    ),
    Method(
        "simulate",
        wire.SimulateRequest,
        text.SimulateReply,
        ASKERS,
        "Run a program's text on a virtual clock: its times, travels and faults.",
        deadline_s=WHOLE_PROGRAM_S,
    ),
    Method(
        "put_text",
        text.PutTextRequest,
        text.PutTextReply,
        ASKERS,
        "Hand a long text over by parts.",
        changes=True,
        deadline_s=60.0,
    ),
    Method(
        "request_run",
        arming.RunRequestRequest,
        arming.RunRequestReply,
        ASKERS,
        "Ask for a run that an operator has to arm. The text is checked and simulated from "
        "where the axes stand, and nothing moves.",
        changes=True,
        held=True,
        deadline_s=WHOLE_PROGRAM_S,
    ),
    Method(
        "run_requests",
        arming.RunRequestsRequest,
        arming.RunRequestsReply,
        EVERYBODY,
        "List what waits for an operator, is armed, or was started lately.",
    ),
    Method(
        "run_approvals",
        arming.RunApprovalsRequest,
        arming.RunRequestsReply,
        EVERYBODY,
        "List the runs whose envelope was approved for a while.",
    ),
    Method(
        "run_preview",
        arming.RunPreviewRequest,
        arming.RunPreviewReply,
        EVERYBODY,
        "Show what an operator looks at before arming: the text and its simulated path.",
    ),
    Method(
        "arm",
        arming.ArmRequest,
        arming.RunRequestStatus,
        MOVERS,
        "Allow a requested run to be started once.",
        changes=True,
    ),
    Method(
        "reject",
        arming.RejectRequest,
        arming.RunRequestStatus,
        MOVERS,
        "Say no to a requested run, and why.",
        changes=True,
    ),
    Method(
        "withdraw",
        arming.WithdrawRequest,
        arming.RunRequestsReply,
        ASKERS,
        "Take a requested run back; only the user who asked may.",
        changes=True,
    ),
    Method(
        "run_armed",
        arming.RunArmedRequest,
        arming.RunArmedReply,
        ASKERS,
        "Start a program that is armed.",
        changes=True,
        held=True,
        deadline_s=SLOW_S,
    ),
    Method(
        "record_start",
        recording.RecordStartRequest,
        recording.RecordReply,
        MOVERS,
        "Record every cycle into a file on the server from now on.",
        changes=True,
    ),
    Method(
        "record_stop",
        recording.RecordStopRequest,
        recording.RecordReply,
        MOVERS,
        "End a recording; answered once the file is whole.",
        changes=True,
        deadline_s=WHOLE_FILE_S,
    ),
    Method(
        "record_save",
        recording.RecordSaveRequest,
        recording.RecordReply,
        MOVERS,
        "Write out the black box, the last minutes.",
        changes=True,
        deadline_s=WHOLE_FILE_S,
    ),
    Method(
        "recordings",
        recording.RecordingsRequest,
        recording.RecordingsReply,
        EVERYBODY,
        "List the recordings on the server's disk.",
    ),
    Method(
        "recording_read",
        recording.RecordingReadRequest,
        folder.RecordingPart,
        EVERYBODY,
        "Read part of a recording's file.",
        deadline_s=SLOW_S,
    ),
    Method(
        "model",
        model.ModelRequest,
        model.ModelReply,
        EVERYBODY,
        "Tell what the machine looks like: its URDF.",
        deadline_s=SLOW_S,
    ),
    Method(
        "model_mesh",
        model.ModelMeshRequest,
        model.ModelPart,
        EVERYBODY,
        "Read part of a mesh's file.",
        deadline_s=SLOW_S,
    ),
    Method(
        "drives", drive.DrivesRequest, drive.DrivesReply, EVERYBODY, "List every drive on a bus, by axis."
    ),
    Method(
        "drives_scan",
        drive.DrivesScanRequest,
        drive.DrivesScanReply,
        CONFIGURERS,
        "Ask who is on a bus, or on all: every node number of CAN, the slaves of EtherCAT. "
        "Nothing is configured.",
        deadline_s=SLOW_S,
    ),
    Method(
        "drive_parameters",
        drive.DriveParametersRequest,
        views.DriveParameters,
        ASKERS,
        "List the objects of a drive's dictionary by the names of its EDS, with types, access and limits. "
        "The drive is not asked.",
    ),
    Method(
        "drives_health",
        drive.DrivesHealthRequest,
        drive.DrivesHealthReply,
        CONFIGURERS,
        "Listen on the buses for some seconds and count load, lost and late frames. Nothing is sent.",
        deadline_s=SLOW_S,
    ),
    Method(
        "drive_scope",
        drive.DriveScopeRequest,
        views.DriveTrace,
        CONFIGURERS,
        "Record every mapped object of an axis in each cycle, around a trigger. Nothing is sent.",
        deadline_s=WHOLE_FILE_S,
    ),
    Method(
        "drive_tune",
        drive.DriveTuneRequest,
        views.DriveTuning,
        CONFIGURERS,
        "Judge the gains of an axis in mode cst or csv by the motion of a program. Nothing is sent.",
        deadline_s=WHOLE_FILE_S,
    ),
    Method(
        "sdo_read",
        drive.SdoReadRequest,
        views.SdoReply,
        ASKERS,
        "Read an object of a drive's dictionary.",
        deadline_s=SLOW_S,
    ),
    Method(
        "sdo_write",
        drive.SdoWriteRequest,
        views.SdoReply,
        CONFIGURERS,
        "Write an object of a drive's dictionary, unless that would fight the cycle.",
        changes=True,
        deadline_s=SLOW_S,
    ),
)
BY_NAME = {method.name: method for method in METHODS}


def method_names(role: Role) -> tuple[str, ...]:
    """Return what a role may call, in the order of the table."""
    return tuple(method.name for method in METHODS if role in method.roles)
