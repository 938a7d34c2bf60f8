// Made by `python -m mcserver.contract.sdk clients`: change the server's messages instead.
#![allow(clippy::missing_errors_doc)]

use std::collections::BTreeMap;

use crate::calls::Nothing;
use crate::error::Result;
use crate::machine::Machine;
use crate::messages::{
    ArmRequest, BusHealth, BusScan, CheckReply, CheckRequest, CloseReply, CloseRequest, Continuation,
    ContinuationRequest, ContinueReply, ContinueRequest, Done, DriveInfo, DriveParameters,
    DriveParametersRequest, DriveScopeRequest, DriveTrace, DriveTuneRequest, DriveTuning, DrivesHealthReply,
    DrivesHealthRequest, DrivesReply, DrivesScanReply, DrivesScanRequest, EstopRequest, EventsReply,
    EventsRequest, HomeReply, HomeRequest, Info, JogReply, JogRequest, MachineFileReply, MachineStatus,
    ModelMeshRequest, ModelPart, ModelReply, OpenReply, OpenRequest, OverrideReply, OverrideRequest,
    ProgramRequest, ProgramStatus, ProgramsReply, ProgramsRequest, PutTextReply, PutTextRequest, RecordReply,
    RecordSaveRequest, RecordStartRequest, RecordStopRequest, RecordingPart, RecordingReadRequest,
    RecordingsReply, ReferenceRequest, RejectRequest, ResetRequest, RunArmedReply, RunArmedRequest,
    RunPreviewReply, RunPreviewRequest, RunRequestReply, RunRequestRequest, RunRequestStatus,
    RunRequestsReply, SdoReadRequest, SdoReply, SdoWriteRequest, ServoReply, ServoRequest, SetInputRequest,
    SetOutputRequest, SetReply, SetTableRowRequest, SimulateReply, SimulateRequest, StepRequest, SubmitReply,
    SubmitRequest, Tables, ToolJogReply, ToolJogRequest, WithdrawRequest, WriteMachineFileReply,
    WriteMachineFileRequest,
};

/// Every remote method of a machine (docs/wire/calls.md); each fails as [`Machine::refresh_info`].
impl Machine {
    /// Describe the machine and the service.
    pub async fn ask_info(&self) -> Result<Info> {
        self.ask_within("info", &Nothing {}, 5).await
    }

    /// Tell the state of the machine now.
    pub async fn status(&self) -> Result<MachineStatus> {
        self.ask_within("status", &Nothing {}, 5).await
    }

    /// List the programs that the server knows: running, queued, ended and interrupted, the newest first.
    pub async fn programs(&self, request: &ProgramsRequest) -> Result<Vec<ProgramStatus>> {
        let reply: ProgramsReply = self.ask_within("programs", request, 5).await?;
        Ok(reply.programs)
    }

    /// Repeat events by number, the oldest first.
    pub async fn past_events(&self, request: &EventsRequest) -> Result<EventsReply> {
        self.ask_within("events", request, 5).await
    }

    /// Open a program, queued for its axes.
    pub async fn open_program(&self, request: &OpenRequest) -> Result<OpenReply> {
        self.declare_token().await?;
        self.ask_within("open", request, 5).await
    }

    /// Tell how a program would go on in its middle: what is certain, where the axes are and where it has
    /// them, and the way between.
    pub async fn continuation(&self, request: &ContinuationRequest) -> Result<Continuation> {
        self.ask_within("continuation", request, 15).await
    }

    /// Go on with a program that has ended: energize what it had, bring the axes to where the line starts,
    /// and run it to its end from the lines that the journal has.
    pub async fn open_continuation(&self, request: &ContinueRequest) -> Result<ContinueReply> {
        self.declare_token().await?;
        self.ask_within("continue_program", request, 15).await
    }

    /// End this client's programs as their `on_disconnect` says, without their grace: it goes.
    pub async fn leave(&self) -> Result<Vec<String>> {
        let reply: Done = self.ask_within("leave", &Nothing {}, 5).await?;
        Ok(reply.programs)
    }

    /// Send lines, and get the verdict on their words.
    pub async fn submit_lines(&self, request: &SubmitRequest) -> Result<SubmitReply> {
        self.ask_within("submit", request, 5).await
    }

    /// Say that no more lines will come.
    pub async fn close_program(&self, request: &CloseRequest) -> Result<CloseReply> {
        self.ask_within("close", request, 5).await
    }

    /// Hold the feed along the path, of one program or all.
    pub async fn hold(&self, program: Option<&str>) -> Result<Vec<String>> {
        let reply: Done = self.ask_within("hold", &ProgramRequest { program: program.map(str::to_owned) }, 5).await?;
        Ok(reply.programs)
    }

    /// End a hold, M00 or M01, of one program or all.
    pub async fn resume(&self, program: Option<&str>) -> Result<Vec<String>> {
        let reply: Done = self.ask_within("resume", &ProgramRequest { program: program.map(str::to_owned) }, 5).await?;
        Ok(reply.programs)
    }

    /// Start the next line of a program opened with `step`.
    pub async fn step(&self, program: &str) -> Result<Vec<String>> {
        let reply: Done = self.ask_within("step", &StepRequest { program: program.to_owned() }, 5).await?;
        Ok(reply.programs)
    }

    /// Stop along the path, then drop the rest of the program, of one or all.
    pub async fn abort(&self, program: Option<&str>) -> Result<Vec<String>> {
        let reply: Done = self.ask_within("abort", &ProgramRequest { program: program.map(str::to_owned) }, 5).await?;
        Ok(reply.programs)
    }

    /// Set the feed override of one program, or of all and those to come.
    pub async fn set_override(&self, request: &OverrideRequest) -> Result<OverrideReply> {
        self.ask_within("override", request, 5).await
    }

    /// Move one axis by hand.
    pub async fn jog(&self, request: &JogRequest) -> Result<String> {
        self.declare_token().await?;
        let reply: JogReply = self.ask_within("jog", request, 5).await?;
        Ok(reply.program)
    }

    /// Move a tool by hand while it is held: straight on, or turning, until a joint ends its way.
    pub async fn jog_tool(&self, request: &ToolJogRequest) -> Result<ToolJogReply> {
        self.declare_token().await?;
        self.ask_within("jog_tool", request, 5).await
    }

    /// The machine file that the server was started with.
    pub async fn machine_file(&self) -> Result<MachineFileReply> {
        self.ask_within("machine_file", &Nothing {}, 5).await
    }

    /// Check another text of the machine file and, where it has no error, write it at rest. The old one is
    /// kept beside it; the server goes by the new one when it is restarted.
    pub async fn write_machine_file(&self, request: &WriteMachineFileRequest) -> Result<WriteMachineFileReply> {
        self.ask_within("write_machine_file", request, 5).await
    }

    /// Let axes follow targets that this client streams. They are energized and leased until `close`, or
    /// until no targets come in time.
    pub async fn open_servo(&self, request: &ServoRequest) -> Result<ServoReply> {
        self.declare_token().await?;
        self.ask_within("open_servo", request, 5).await
    }

    /// Let axes follow targets, as `open_servo`, inside of what an operator has approved for a while: `arm`
    /// with `standing_s` and `servo`.
    pub async fn servo_armed(&self, request: &ServoRequest) -> Result<ServoReply> {
        self.declare_token().await?;
        self.ask_within("servo_armed", request, 5).await
    }

    /// Let axes find their references. It goes on after the reply: the events `axis.homing`, `axis.homed` and
    /// `program.ended` say how.
    pub async fn home(&self, axes: Option<&[u64]>) -> Result<HomeReply> {
        self.declare_token().await?;
        self.ask_within("home", &HomeRequest { axes: axes.map(<[_]>::to_vec) }, 5).await
    }

    /// Say where axes are; nothing moves.
    pub async fn reference(&self, positions: &BTreeMap<String, f64>) -> Result<Vec<String>> {
        let reply: Done = self.ask_within("reference", &ReferenceRequest { positions: positions.clone() }, 5).await?;
        Ok(reply.programs)
    }

    /// Clear a latched fault or emergency stop. Axes stay without energy until captured (G1010).
    pub async fn reset(&self, axes: Option<&[u64]>) -> Result<Vec<String>> {
        let reply: Done = self.ask_within("reset", &ResetRequest { axes: axes.map(<[_]>::to_vec) }, 5).await?;
        Ok(reply.programs)
    }

    /// Tell the work offsets and tools that programs start with, and who changed them. They are changed by
    /// programs: G10 L2, L20 and L1.
    pub async fn tables(&self) -> Result<Tables> {
        self.ask_within("tables", &Nothing {}, 5).await
    }

    /// Name a work offset or a tool, or say how long a tool may cut and has cut.
    pub async fn set_table_row(&self, request: &SetTableRowRequest) -> Result<Vec<String>> {
        let reply: Done = self.ask_within("set_table_row", request, 5).await?;
        Ok(reply.programs)
    }

    /// Set an output by hand.
    pub async fn set_output(&self, request: &SetOutputRequest) -> Result<SetReply> {
        self.ask_within("set_output", request, 5).await
    }

    /// Set a simulated input.
    pub async fn set_simulated_input(&self, request: &SetInputRequest) -> Result<SetReply> {
        self.ask_within("set_simulated_input", request, 5).await
    }

    /// Stop everything at once: emergency stop. No safety function; the key `estop` is the faster way.
    pub async fn call_estop(&self, request: &EstopRequest) -> Result<Vec<String>> {
        let reply: Done = self.ask_within("estop", request, 5).await?;
        Ok(reply.programs)
    }

    /// Find every fault of a program's text; nothing runs.
    pub async fn check(&self, request: &CheckRequest) -> Result<CheckReply> {
        self.ask_within("check", request, 300).await
    }

    /// Run a program's text on a virtual clock: its times, travels and faults.
    pub async fn simulate(&self, request: &SimulateRequest) -> Result<SimulateReply> {
        self.ask_within("simulate", request, 300).await
    }

    /// Hand a long text over by parts.
    pub async fn put_text_part(&self, request: &PutTextRequest) -> Result<PutTextReply> {
        self.ask_within("put_text", request, 60).await
    }

    /// Ask for a run that an operator has to arm. The text is checked and simulated from where the axes
    /// stand, and nothing moves.
    pub async fn request_run(&self, request: &RunRequestRequest) -> Result<RunRequestReply> {
        self.declare_token().await?;
        self.ask_within("request_run", request, 300).await
    }

    /// List what waits for an operator, is armed, or was started lately.
    pub async fn run_requests(&self) -> Result<Vec<RunRequestStatus>> {
        let reply: RunRequestsReply = self.ask_within("run_requests", &Nothing {}, 5).await?;
        Ok(reply.requests)
    }

    /// List the runs whose envelope was approved for a while.
    pub async fn run_approvals(&self) -> Result<Vec<RunRequestStatus>> {
        let reply: RunRequestsReply = self.ask_within("run_approvals", &Nothing {}, 5).await?;
        Ok(reply.requests)
    }

    /// Show what an operator looks at before arming: the text and its simulated path.
    pub async fn run_preview(&self, sha256: &str) -> Result<RunPreviewReply> {
        self.ask_within("run_preview", &RunPreviewRequest { sha256: sha256.to_owned() }, 5).await
    }

    /// Allow a requested run to be started once.
    pub async fn arm(&self, request: &ArmRequest) -> Result<RunRequestStatus> {
        self.ask_within("arm", request, 5).await
    }

    /// Say no to a requested run, and why.
    pub async fn reject(&self, request: &RejectRequest) -> Result<RunRequestStatus> {
        self.ask_within("reject", request, 5).await
    }

    /// Take a requested run back; only the user who asked may.
    pub async fn withdraw(&self, sha256: &str) -> Result<Vec<RunRequestStatus>> {
        let reply: RunRequestsReply = self.ask_within("withdraw", &WithdrawRequest { sha256: sha256.to_owned() }, 5).await?;
        Ok(reply.requests)
    }

    /// Start a program that is armed.
    pub async fn run_armed(&self, request: &RunArmedRequest) -> Result<RunArmedReply> {
        self.declare_token().await?;
        self.ask_within("run_armed", request, 15).await
    }

    /// Record every cycle into a file on the server from now on.
    pub async fn record_start(&self, request: &RecordStartRequest) -> Result<String> {
        let reply: RecordReply = self.ask_within("record_start", request, 5).await?;
        Ok(reply.name)
    }

    /// End a recording; answered once the file is whole.
    pub async fn record_stop(&self, name: &str) -> Result<String> {
        let reply: RecordReply = self.ask_within("record_stop", &RecordStopRequest { name: name.to_owned() }, 90).await?;
        Ok(reply.name)
    }

    /// Write out the black box, the last minutes.
    pub async fn record_save(&self, reason: &str) -> Result<String> {
        let reply: RecordReply = self.ask_within("record_save", &RecordSaveRequest { reason: reason.to_owned() }, 90).await?;
        Ok(reply.name)
    }

    /// List the recordings on the server's disk.
    pub async fn recordings(&self) -> Result<RecordingsReply> {
        self.ask_within("recordings", &Nothing {}, 5).await
    }

    /// Read part of a recording's file.
    pub async fn recording_read(&self, request: &RecordingReadRequest) -> Result<RecordingPart> {
        self.ask_within("recording_read", request, 15).await
    }

    /// Tell what the machine looks like: its URDF.
    pub async fn model(&self) -> Result<ModelReply> {
        self.ask_within("model", &Nothing {}, 15).await
    }

    /// Read part of a mesh's file.
    pub async fn model_mesh(&self, request: &ModelMeshRequest) -> Result<ModelPart> {
        self.ask_within("model_mesh", request, 15).await
    }

    /// List every drive on a bus, by axis.
    pub async fn drives(&self) -> Result<Vec<DriveInfo>> {
        let reply: DrivesReply = self.ask_within("drives", &Nothing {}, 5).await?;
        Ok(reply.drives)
    }

    /// Ask who is on a bus, or on all: every node number of CAN, the slaves of EtherCAT. Nothing is
    /// configured.
    pub async fn drives_scan(&self, bus: &str) -> Result<Vec<BusScan>> {
        let reply: DrivesScanReply = self.ask_within("drives_scan", &DrivesScanRequest { bus: bus.to_owned() }, 15).await?;
        Ok(reply.buses)
    }

    /// List the objects of a drive's dictionary by the names of its EDS, with types, access and limits. The
    /// drive is not asked.
    pub async fn drive_parameters(&self, axis: u64) -> Result<DriveParameters> {
        self.ask_within("drive_parameters", &DriveParametersRequest { axis }, 5).await
    }

    /// Listen on the buses for some seconds and count load, lost and late frames. Nothing is sent.
    pub async fn drives_health(&self, seconds: f64) -> Result<Vec<BusHealth>> {
        let reply: DrivesHealthReply = self.ask_within("drives_health", &DrivesHealthRequest { seconds }, 15).await?;
        Ok(reply.buses)
    }

    /// Record every mapped object of an axis in each cycle, around a trigger. Nothing is sent.
    pub async fn drive_scope(&self, request: &DriveScopeRequest) -> Result<DriveTrace> {
        self.ask_within("drive_scope", request, 90).await
    }

    /// Judge the gains of an axis in mode cst or csv by the motion of a program. Nothing is sent.
    pub async fn drive_tune(&self, request: &DriveTuneRequest) -> Result<DriveTuning> {
        self.ask_within("drive_tune", request, 90).await
    }

    /// Read an object of a drive's dictionary.
    pub async fn sdo_read(&self, request: &SdoReadRequest) -> Result<SdoReply> {
        self.ask_within("sdo_read", request, 15).await
    }

    /// Write an object of a drive's dictionary, unless that would fight the cycle.
    pub async fn sdo_write(&self, request: &SdoWriteRequest) -> Result<SdoReply> {
        self.ask_within("sdo_write", request, 15).await
    }
}
