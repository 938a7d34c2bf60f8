// Made by `python -m mcserver.contract.sdk clients`: change the server's messages instead.
package org.mcserver.client;

import java.time.Duration;
import java.util.List;
import java.util.Map;
import java.util.Set;
import java.util.concurrent.CompletableFuture;

/** Every remote method of a machine (docs/wire/calls.md). */
public abstract class MachineCalls {
    MachineCalls() {}

    abstract <T extends Record> CompletableFuture<T> ask(
            String method, Map<String, Object> params, Class<T> reply);

    /** Calls that change nothing, or stop: they may be sent again under any circumstances. */
    static final Set<String> REPEATABLE = Set.of(
            "info", "status", "programs", "events", "continuation", "hold", "abort", "machine_file", "tables",
            "estop", "check", "simulate", "run_requests", "run_approvals", "run_preview", "recordings",
            "recording_read", "model", "model_mesh", "drives", "drives_scan", "drive_parameters", "drives_health",
            "drive_scope", "drive_tune", "sdo_read");

    /** How long a server may take for an answer. */
    static final Map<String, Duration> DEADLINES = Map.ofEntries(
            Map.entry("info", Duration.ofSeconds(5)),
            Map.entry("status", Duration.ofSeconds(5)),
            Map.entry("programs", Duration.ofSeconds(5)),
            Map.entry("events", Duration.ofSeconds(5)),
            Map.entry("open", Duration.ofSeconds(5)),
            Map.entry("continuation", Duration.ofSeconds(15)),
            Map.entry("continue_program", Duration.ofSeconds(15)),
            Map.entry("leave", Duration.ofSeconds(5)),
            Map.entry("submit", Duration.ofSeconds(5)),
            Map.entry("close", Duration.ofSeconds(5)),
            Map.entry("hold", Duration.ofSeconds(5)),
            Map.entry("resume", Duration.ofSeconds(5)),
            Map.entry("step", Duration.ofSeconds(5)),
            Map.entry("abort", Duration.ofSeconds(5)),
            Map.entry("override", Duration.ofSeconds(5)),
            Map.entry("jog", Duration.ofSeconds(5)),
            Map.entry("jog_tool", Duration.ofSeconds(5)),
            Map.entry("machine_file", Duration.ofSeconds(5)),
            Map.entry("write_machine_file", Duration.ofSeconds(5)),
            Map.entry("open_servo", Duration.ofSeconds(5)),
            Map.entry("servo_armed", Duration.ofSeconds(5)),
            Map.entry("home", Duration.ofSeconds(5)),
            Map.entry("reference", Duration.ofSeconds(5)),
            Map.entry("reset", Duration.ofSeconds(5)),
            Map.entry("tables", Duration.ofSeconds(5)),
            Map.entry("set_table_row", Duration.ofSeconds(5)),
            Map.entry("set_output", Duration.ofSeconds(5)),
            Map.entry("set_simulated_input", Duration.ofSeconds(5)),
            Map.entry("estop", Duration.ofSeconds(5)),
            Map.entry("check", Duration.ofSeconds(300)),
            Map.entry("simulate", Duration.ofSeconds(300)),
            Map.entry("put_text", Duration.ofSeconds(60)),
            Map.entry("request_run", Duration.ofSeconds(300)),
            Map.entry("run_requests", Duration.ofSeconds(5)),
            Map.entry("run_approvals", Duration.ofSeconds(5)),
            Map.entry("run_preview", Duration.ofSeconds(5)),
            Map.entry("arm", Duration.ofSeconds(5)),
            Map.entry("reject", Duration.ofSeconds(5)),
            Map.entry("withdraw", Duration.ofSeconds(5)),
            Map.entry("run_armed", Duration.ofSeconds(15)),
            Map.entry("record_start", Duration.ofSeconds(5)),
            Map.entry("record_stop", Duration.ofSeconds(90)),
            Map.entry("record_save", Duration.ofSeconds(90)),
            Map.entry("recordings", Duration.ofSeconds(5)),
            Map.entry("recording_read", Duration.ofSeconds(15)),
            Map.entry("model", Duration.ofSeconds(15)),
            Map.entry("model_mesh", Duration.ofSeconds(15)),
            Map.entry("drives", Duration.ofSeconds(5)),
            Map.entry("drives_scan", Duration.ofSeconds(15)),
            Map.entry("drive_parameters", Duration.ofSeconds(5)),
            Map.entry("drives_health", Duration.ofSeconds(15)),
            Map.entry("drive_scope", Duration.ofSeconds(90)),
            Map.entry("drive_tune", Duration.ofSeconds(90)),
            Map.entry("sdo_read", Duration.ofSeconds(15)),
            Map.entry("sdo_write", Duration.ofSeconds(15)));

    /** Describe the machine and the service. */
    public CompletableFuture<Messages.Info> askInfo() {
        return ask("info", Map.of(), Messages.Info.class);
    }

    /** Tell the state of the machine now. */
    public CompletableFuture<Messages.MachineStatus> status() {
        return ask("status", Map.of(), Messages.MachineStatus.class);
    }

    /** List the programs that the server knows: running, queued, ended and interrupted, the newest first. */
    public CompletableFuture<List<Messages.ProgramStatus>> programs(Messages.ProgramsRequest request) {
        return ask("programs", Wire.params(request), Messages.ProgramsReply.class).thenApply(Messages.ProgramsReply::programs);
    }

    /** Repeat events by number, the oldest first. */
    public CompletableFuture<Messages.EventsReply> pastEvents(Messages.EventsRequest request) {
        return ask("events", Wire.params(request), Messages.EventsReply.class);
    }

    /** Open a program, queued for its axes. */
    public CompletableFuture<Messages.OpenReply> openProgram(Messages.OpenRequest request) {
        return ask("open", Wire.params(request), Messages.OpenReply.class);
    }

    /**
     * Tell how a program would go on in its middle: what is certain, where the axes are and where it has them, and
     * the way between.
     */
    public CompletableFuture<Messages.Continuation> continuation(Messages.ContinuationRequest request) {
        return ask("continuation", Wire.params(request), Messages.Continuation.class);
    }

    /**
     * Go on with a program that has ended: energize what it had, bring the axes to where the line starts, and run
     * it to its end from the lines that the journal has.
     */
    public CompletableFuture<Messages.ContinueReply> openContinuation(Messages.ContinueRequest request) {
        return ask("continue_program", Wire.params(request), Messages.ContinueReply.class);
    }

    /** End this client's programs as their `on_disconnect` says, without their grace: it goes. */
    public CompletableFuture<List<String>> leave() {
        return ask("leave", Map.of(), Messages.Done.class).thenApply(Messages.Done::programs);
    }

    /** Send lines, and get the verdict on their words. */
    public CompletableFuture<Messages.SubmitReply> submitLines(Messages.SubmitRequest request) {
        return ask("submit", Wire.params(request), Messages.SubmitReply.class);
    }

    /** Say that no more lines will come. */
    public CompletableFuture<Messages.CloseReply> closeProgram(Messages.CloseRequest request) {
        return ask("close", Wire.params(request), Messages.CloseReply.class);
    }

    /** Hold the feed along the path, of one program or all. */
    public CompletableFuture<List<String>> hold(String program) {
        return ask("hold", Wire.params(new Messages.ProgramRequest(program)), Messages.Done.class).thenApply(Messages.Done::programs);
    }

    /** End a hold, M00 or M01, of one program or all. */
    public CompletableFuture<List<String>> resume(String program) {
        return ask("resume", Wire.params(new Messages.ProgramRequest(program)), Messages.Done.class).thenApply(Messages.Done::programs);
    }

    /** Start the next line of a program opened with `step`. */
    public CompletableFuture<List<String>> step(String program) {
        return ask("step", Wire.params(new Messages.StepRequest(program)), Messages.Done.class).thenApply(Messages.Done::programs);
    }

    /** Stop along the path, then drop the rest of the program, of one or all. */
    public CompletableFuture<List<String>> abort(String program) {
        return ask("abort", Wire.params(new Messages.ProgramRequest(program)), Messages.Done.class).thenApply(Messages.Done::programs);
    }

    /** Set the feed override of one program, or of all and those to come. */
    public CompletableFuture<Messages.OverrideReply> override(Messages.OverrideRequest request) {
        return ask("override", Wire.params(request), Messages.OverrideReply.class);
    }

    /** Move one axis by hand. */
    public CompletableFuture<String> jog(Messages.JogRequest request) {
        return ask("jog", Wire.params(request), Messages.JogReply.class).thenApply(Messages.JogReply::program);
    }

    /** Move a tool by hand while it is held: straight on, or turning, until a joint ends its way. */
    public CompletableFuture<Messages.ToolJogReply> jogTool(Messages.ToolJogRequest request) {
        return ask("jog_tool", Wire.params(request), Messages.ToolJogReply.class);
    }

    /** The machine file that the server was started with. */
    public CompletableFuture<Messages.MachineFileReply> machineFile() {
        return ask("machine_file", Map.of(), Messages.MachineFileReply.class);
    }

    /**
     * Check another text of the machine file and, where it has no error, write it at rest. The old one is kept
     * beside it; the server goes by the new one when it is restarted.
     */
    public CompletableFuture<Messages.WriteMachineFileReply> writeMachineFile(Messages.WriteMachineFileRequest request) {
        return ask("write_machine_file", Wire.params(request), Messages.WriteMachineFileReply.class);
    }

    /**
     * Let axes follow targets that this client streams. They are energized and leased until `close`, or until no
     * targets come in time.
     */
    public CompletableFuture<Messages.ServoReply> openServo(Messages.ServoRequest request) {
        return ask("open_servo", Wire.params(request), Messages.ServoReply.class);
    }

    /**
     * Let axes follow targets, as `open_servo`, inside of what an operator has approved for a while: `arm` with
     * `standing_s` and `servo`.
     */
    public CompletableFuture<Messages.ServoReply> servoArmed(Messages.ServoRequest request) {
        return ask("servo_armed", Wire.params(request), Messages.ServoReply.class);
    }

    /**
     * Let axes find their references. It goes on after the reply: the events `axis.homing`, `axis.homed` and
     * `program.ended` say how.
     */
    public CompletableFuture<Messages.HomeReply> home(List<Long> axes) {
        return ask("home", Wire.params(new Messages.HomeRequest(axes)), Messages.HomeReply.class);
    }

    /** Say where axes are; nothing moves. */
    public CompletableFuture<List<String>> reference(Map<String, Double> positions) {
        return ask("reference", Wire.params(new Messages.ReferenceRequest(positions)), Messages.Done.class).thenApply(Messages.Done::programs);
    }

    /** Clear a latched fault or emergency stop. Axes stay without energy until captured (G1010). */
    public CompletableFuture<List<String>> reset(List<Long> axes) {
        return ask("reset", Wire.params(new Messages.ResetRequest(axes)), Messages.Done.class).thenApply(Messages.Done::programs);
    }

    /**
     * Tell the work offsets and tools that programs start with, and who changed them. They are changed by
     * programs: G10 L2, L20 and L1.
     */
    public CompletableFuture<Messages.Tables> tables() {
        return ask("tables", Map.of(), Messages.Tables.class);
    }

    /** Name a work offset or a tool, or say how long a tool may cut and has cut. */
    public CompletableFuture<List<String>> setTableRow(Messages.SetTableRowRequest request) {
        return ask("set_table_row", Wire.params(request), Messages.Done.class).thenApply(Messages.Done::programs);
    }

    /** Set an output by hand. */
    public CompletableFuture<Messages.SetReply> setOutput(Messages.SetOutputRequest request) {
        return ask("set_output", Wire.params(request), Messages.SetReply.class);
    }

    /** Set a simulated input. */
    public CompletableFuture<Messages.SetReply> setSimulatedInput(Messages.SetInputRequest request) {
        return ask("set_simulated_input", Wire.params(request), Messages.SetReply.class);
    }

    /** Stop everything at once: emergency stop. No safety function; the key `estop` is the faster way. */
    public CompletableFuture<List<String>> callEstop(Messages.EstopRequest request) {
        return ask("estop", Wire.params(request), Messages.Done.class).thenApply(Messages.Done::programs);
    }

    /** Find every fault of a program's text; nothing runs. */
    public CompletableFuture<Messages.CheckReply> check(Messages.CheckRequest request) {
        return ask("check", Wire.params(request), Messages.CheckReply.class);
    }

    /** Run a program's text on a virtual clock: its times, travels and faults. */
    public CompletableFuture<Messages.SimulateReply> simulate(Messages.SimulateRequest request) {
        return ask("simulate", Wire.params(request), Messages.SimulateReply.class);
    }

    /** Hand a long text over by parts. */
    public CompletableFuture<Messages.PutTextReply> putTextPart(Messages.PutTextRequest request) {
        return ask("put_text", Wire.params(request), Messages.PutTextReply.class);
    }

    /**
     * Ask for a run that an operator has to arm. The text is checked and simulated from where the axes stand, and
     * nothing moves.
     */
    public CompletableFuture<Messages.RunRequestReply> requestRun(Messages.RunRequestRequest request) {
        return ask("request_run", Wire.params(request), Messages.RunRequestReply.class);
    }

    /** List what waits for an operator, is armed, or was started lately. */
    public CompletableFuture<List<Messages.RunRequestStatus>> runRequests() {
        return ask("run_requests", Map.of(), Messages.RunRequestsReply.class).thenApply(Messages.RunRequestsReply::requests);
    }

    /** List the runs whose envelope was approved for a while. */
    public CompletableFuture<List<Messages.RunRequestStatus>> runApprovals() {
        return ask("run_approvals", Map.of(), Messages.RunRequestsReply.class).thenApply(Messages.RunRequestsReply::requests);
    }

    /**
     * Show what an operator looks at before arming: the text and its simulated path.
     * @param sha256 of the text, or at least its first 8 digits.
     */
    public CompletableFuture<Messages.RunPreviewReply> runPreview(String sha256) {
        return ask("run_preview", Wire.params(new Messages.RunPreviewRequest(sha256)), Messages.RunPreviewReply.class);
    }

    /** Allow a requested run to be started once. */
    public CompletableFuture<Messages.RunRequestStatus> arm(Messages.ArmRequest request) {
        return ask("arm", Wire.params(request), Messages.RunRequestStatus.class);
    }

    /** Say no to a requested run, and why. */
    public CompletableFuture<Messages.RunRequestStatus> reject(Messages.RejectRequest request) {
        return ask("reject", Wire.params(request), Messages.RunRequestStatus.class);
    }

    /**
     * Take a requested run back; only the user who asked may.
     * @param sha256 of the text, or at least its first 8 digits.
     */
    public CompletableFuture<List<Messages.RunRequestStatus>> withdraw(String sha256) {
        return ask("withdraw", Wire.params(new Messages.WithdrawRequest(sha256)), Messages.RunRequestsReply.class).thenApply(Messages.RunRequestsReply::requests);
    }

    /** Start a program that is armed. */
    public CompletableFuture<Messages.RunArmedReply> runArmed(Messages.RunArmedRequest request) {
        return ask("run_armed", Wire.params(request), Messages.RunArmedReply.class);
    }

    /** Record every cycle into a file on the server from now on. */
    public CompletableFuture<String> recordStart(Messages.RecordStartRequest request) {
        return ask("record_start", Wire.params(request), Messages.RecordReply.class).thenApply(Messages.RecordReply::name);
    }

    /** End a recording; answered once the file is whole. */
    public CompletableFuture<String> recordStop(String name) {
        return ask("record_stop", Wire.params(new Messages.RecordStopRequest(name)), Messages.RecordReply.class).thenApply(Messages.RecordReply::name);
    }

    /** Write out the black box, the last minutes. */
    public CompletableFuture<String> recordSave(String reason) {
        return ask("record_save", Wire.params(new Messages.RecordSaveRequest(reason)), Messages.RecordReply.class).thenApply(Messages.RecordReply::name);
    }

    /** List the recordings on the server's disk. */
    public CompletableFuture<Messages.RecordingsReply> recordings() {
        return ask("recordings", Map.of(), Messages.RecordingsReply.class);
    }

    /** Read part of a recording's file. */
    public CompletableFuture<Messages.RecordingPart> recordingRead(Messages.RecordingReadRequest request) {
        return ask("recording_read", Wire.params(request), Messages.RecordingPart.class);
    }

    /** Tell what the machine looks like: its URDF. */
    public CompletableFuture<Messages.ModelReply> model() {
        return ask("model", Map.of(), Messages.ModelReply.class);
    }

    /** Read part of a mesh's file. */
    public CompletableFuture<Messages.ModelPart> modelMesh(Messages.ModelMeshRequest request) {
        return ask("model_mesh", Wire.params(request), Messages.ModelPart.class);
    }

    /** List every drive on a bus, by axis. */
    public CompletableFuture<List<Messages.DriveInfo>> drives() {
        return ask("drives", Map.of(), Messages.DrivesReply.class).thenApply(Messages.DrivesReply::drives);
    }

    /** Ask who is on a bus, or on all: every node number of CAN, the slaves of EtherCAT. Nothing is configured. */
    public CompletableFuture<List<Messages.BusScan>> drivesScan(String bus) {
        return ask("drives_scan", Wire.params(new Messages.DrivesScanRequest(bus)), Messages.DrivesScanReply.class).thenApply(Messages.DrivesScanReply::buses);
    }

    /**
     * List the objects of a drive's dictionary by the names of its EDS, with types, access and limits. The drive
     * is not asked.
     */
    public CompletableFuture<Messages.DriveParameters> driveParameters(long axis) {
        return ask("drive_parameters", Wire.params(new Messages.DriveParametersRequest(axis)), Messages.DriveParameters.class);
    }

    /** Listen on the buses for some seconds and count load, lost and late frames. Nothing is sent. */
    public CompletableFuture<List<Messages.BusHealth>> drivesHealth(double seconds) {
        return ask("drives_health", Wire.params(new Messages.DrivesHealthRequest(seconds)), Messages.DrivesHealthReply.class).thenApply(Messages.DrivesHealthReply::buses);
    }

    /** Record every mapped object of an axis in each cycle, around a trigger. Nothing is sent. */
    public CompletableFuture<Messages.DriveTrace> driveScope(Messages.DriveScopeRequest request) {
        return ask("drive_scope", Wire.params(request), Messages.DriveTrace.class);
    }

    /** Judge the gains of an axis in mode cst or csv by the motion of a program. Nothing is sent. */
    public CompletableFuture<Messages.DriveTuning> driveTune(Messages.DriveTuneRequest request) {
        return ask("drive_tune", Wire.params(request), Messages.DriveTuning.class);
    }

    /** Read an object of a drive's dictionary. */
    public CompletableFuture<Messages.SdoReply> sdoRead(Messages.SdoReadRequest request) {
        return ask("sdo_read", Wire.params(request), Messages.SdoReply.class);
    }

    /** Write an object of a drive's dictionary, unless that would fight the cycle. */
    public CompletableFuture<Messages.SdoReply> sdoWrite(Messages.SdoWriteRequest request) {
        return ask("sdo_write", Wire.params(request), Messages.SdoReply.class);
    }
}
