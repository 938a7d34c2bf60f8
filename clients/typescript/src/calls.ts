// Made by `python -m mcserver.contract.sdk clients`: change the server's messages instead.

import type {
  ArmRequest,
  BusHealth,
  BusScan,
  CheckReply,
  CheckRequest,
  CloseReply,
  CloseRequest,
  Continuation,
  ContinuationRequest,
  ContinueReply,
  ContinueRequest,
  Done,
  DriveInfo,
  DriveParameters,
  DriveScopeRequest,
  DriveTrace,
  DriveTuneRequest,
  DriveTuning,
  DrivesHealthReply,
  DrivesReply,
  DrivesScanReply,
  EstopRequest,
  EventsReply,
  EventsRequest,
  HomeReply,
  Info,
  JogReply,
  JogRequest,
  MachineFileReply,
  MachineStatus,
  ModelMeshRequest,
  ModelPart,
  ModelReply,
  OpenReply,
  OpenRequest,
  OverrideReply,
  OverrideRequest,
  ProgramStatus,
  ProgramsReply,
  ProgramsRequest,
  PutTextReply,
  PutTextRequest,
  RecordReply,
  RecordStartRequest,
  RecordingPart,
  RecordingReadRequest,
  RecordingsReply,
  RejectRequest,
  RunArmedReply,
  RunArmedRequest,
  RunPreviewReply,
  RunRequestReply,
  RunRequestRequest,
  RunRequestStatus,
  RunRequestsReply,
  SdoReadRequest,
  SdoReply,
  SdoWriteRequest,
  ServoReply,
  ServoRequest,
  SetInputRequest,
  SetOutputRequest,
  SetReply,
  SetTableRowRequest,
  SimulateReply,
  SimulateRequest,
  SubmitReply,
  SubmitRequest,
  Tables,
  ToolJogReply,
  ToolJogRequest,
  WriteMachineFileReply,
  WriteMachineFileRequest,
} from "./messages.js";

/** How long a server may take for an answer [s], and whether a call may be sent again under any
 * circumstances: it changes nothing, or stops. */
export const METHODS: Readonly<Record<string, { deadlineS: number; repeatable: boolean }>> = {
  info: { deadlineS: 5, repeatable: true },
  status: { deadlineS: 5, repeatable: true },
  programs: { deadlineS: 5, repeatable: true },
  events: { deadlineS: 5, repeatable: true },
  open: { deadlineS: 5, repeatable: false },
  continuation: { deadlineS: 15, repeatable: true },
  continue_program: { deadlineS: 15, repeatable: false },
  leave: { deadlineS: 5, repeatable: false },
  submit: { deadlineS: 5, repeatable: false },
  close: { deadlineS: 5, repeatable: false },
  hold: { deadlineS: 5, repeatable: true },
  resume: { deadlineS: 5, repeatable: false },
  step: { deadlineS: 5, repeatable: false },
  abort: { deadlineS: 5, repeatable: true },
  override: { deadlineS: 5, repeatable: false },
  jog: { deadlineS: 5, repeatable: false },
  jog_tool: { deadlineS: 5, repeatable: false },
  machine_file: { deadlineS: 5, repeatable: true },
  write_machine_file: { deadlineS: 5, repeatable: false },
  open_servo: { deadlineS: 5, repeatable: false },
  servo_armed: { deadlineS: 5, repeatable: false },
  home: { deadlineS: 5, repeatable: false },
  reference: { deadlineS: 5, repeatable: false },
  reset: { deadlineS: 5, repeatable: false },
  tables: { deadlineS: 5, repeatable: true },
  set_table_row: { deadlineS: 5, repeatable: false },
  set_output: { deadlineS: 5, repeatable: false },
  set_simulated_input: { deadlineS: 5, repeatable: false },
  estop: { deadlineS: 5, repeatable: true },
  check: { deadlineS: 300, repeatable: true },
  simulate: { deadlineS: 300, repeatable: true },
  put_text: { deadlineS: 60, repeatable: false },
  request_run: { deadlineS: 300, repeatable: false },
  run_requests: { deadlineS: 5, repeatable: true },
  run_approvals: { deadlineS: 5, repeatable: true },
  run_preview: { deadlineS: 5, repeatable: true },
  arm: { deadlineS: 5, repeatable: false },
  reject: { deadlineS: 5, repeatable: false },
  withdraw: { deadlineS: 5, repeatable: false },
  run_armed: { deadlineS: 15, repeatable: false },
  record_start: { deadlineS: 5, repeatable: false },
  record_stop: { deadlineS: 90, repeatable: false },
  record_save: { deadlineS: 90, repeatable: false },
  recordings: { deadlineS: 5, repeatable: true },
  recording_read: { deadlineS: 15, repeatable: true },
  model: { deadlineS: 15, repeatable: true },
  model_mesh: { deadlineS: 15, repeatable: true },
  drives: { deadlineS: 5, repeatable: true },
  drives_scan: { deadlineS: 15, repeatable: true },
  drive_parameters: { deadlineS: 5, repeatable: true },
  drives_health: { deadlineS: 15, repeatable: true },
  drive_scope: { deadlineS: 90, repeatable: true },
  drive_tune: { deadlineS: 90, repeatable: true },
  sdo_read: { deadlineS: 15, repeatable: true },
  sdo_write: { deadlineS: 15, repeatable: false },
};

/** Every remote method of a machine (docs/wire/calls.md). */
export abstract class MachineCalls {
  /** Any remote method by its name. */
  abstract call<T>(method: string, params?: object): Promise<T>;

  /** Describe the machine and the service. */
  askInfo(): Promise<Info> {
    return this.call("info");
  }

  /** Tell the state of the machine now. */
  status(): Promise<MachineStatus> {
    return this.call("status");
  }

  /** List the programs that the server knows: running, queued, ended and interrupted, the newest first. */
  async programs(request: ProgramsRequest = {}): Promise<ProgramStatus[]> {
    return (await this.call<ProgramsReply>("programs", request)).programs;
  }

  /** Repeat events by number, the oldest first. */
  pastEvents(request: EventsRequest = {}): Promise<EventsReply> {
    return this.call("events", request);
  }

  /** Open a program, queued for its axes. */
  openProgram(request: OpenRequest = {}): Promise<OpenReply> {
    return this.call("open", request);
  }

  /**
   * Tell how a program would go on in its middle: what is certain, where the axes are and where it has them, and
   * the way between.
   */
  continuation(request: ContinuationRequest = {}): Promise<Continuation> {
    return this.call("continuation", request);
  }

  /**
   * Go on with a program that has ended: energize what it had, bring the axes to where the line starts, and run
   * it to its end from the lines that the journal has.
   */
  openContinuation(request: ContinueRequest): Promise<ContinueReply> {
    return this.call("continue_program", request);
  }

  /** End this client's programs as their `on_disconnect` says, without their grace: it goes. */
  async leave(): Promise<string[]> {
    return (await this.call<Done>("leave")).programs;
  }

  /** Send lines, and get the verdict on their words. */
  submitLines(request: SubmitRequest): Promise<SubmitReply> {
    return this.call("submit", request);
  }

  /** Say that no more lines will come. */
  closeProgram(request: CloseRequest): Promise<CloseReply> {
    return this.call("close", request);
  }

  /** Hold the feed along the path, of one program or all. */
  async hold(program?: string | null): Promise<string[]> {
    return (await this.call<Done>("hold", { program })).programs;
  }

  /** End a hold, M00 or M01, of one program or all. */
  async resume(program?: string | null): Promise<string[]> {
    return (await this.call<Done>("resume", { program })).programs;
  }

  /** Start the next line of a program opened with `step`. */
  async step(program: string): Promise<string[]> {
    return (await this.call<Done>("step", { program })).programs;
  }

  /** Stop along the path, then drop the rest of the program, of one or all. */
  async abort(program?: string | null): Promise<string[]> {
    return (await this.call<Done>("abort", { program })).programs;
  }

  /** Set the feed override of one program, or of all and those to come. */
  override(request: OverrideRequest): Promise<OverrideReply> {
    return this.call("override", request);
  }

  /** Move one axis by hand. */
  async jog(request: JogRequest): Promise<string> {
    return (await this.call<JogReply>("jog", request)).program;
  }

  /** Move a tool by hand while it is held: straight on, or turning, until a joint ends its way. */
  jogTool(request: ToolJogRequest): Promise<ToolJogReply> {
    return this.call("jog_tool", request);
  }

  /** The machine file that the server was started with. */
  machineFile(): Promise<MachineFileReply> {
    return this.call("machine_file");
  }

  /**
   * Check another text of the machine file and, where it has no error, write it at rest. The old one is kept
   * beside it; the server goes by the new one when it is restarted.
   */
  writeMachineFile(request: WriteMachineFileRequest): Promise<WriteMachineFileReply> {
    return this.call("write_machine_file", request);
  }

  /**
   * Let axes follow targets that this client streams. They are energized and leased until `close`, or until no
   * targets come in time.
   */
  openServo(request: ServoRequest = {}): Promise<ServoReply> {
    return this.call("open_servo", request);
  }

  /**
   * Let axes follow targets, as `open_servo`, inside of what an operator has approved for a while: `arm` with
   * `standing_s` and `servo`.
   */
  servoArmed(request: ServoRequest = {}): Promise<ServoReply> {
    return this.call("servo_armed", request);
  }

  /**
   * Let axes find their references. It goes on after the reply: the events `axis.homing`, `axis.homed` and
   * `program.ended` say how.
   */
  home(axes?: number[] | null): Promise<HomeReply> {
    return this.call("home", { axes });
  }

  /** Say where axes are; nothing moves. */
  async reference(positions: Record<string, number>): Promise<string[]> {
    return (await this.call<Done>("reference", { positions })).programs;
  }

  /** Clear a latched fault or emergency stop. Axes stay without energy until captured (G1010). */
  async reset(axes?: number[] | null): Promise<string[]> {
    return (await this.call<Done>("reset", { axes })).programs;
  }

  /**
   * Tell the work offsets and tools that programs start with, and who changed them. They are changed by programs:
   * G10 L2, L20 and L1.
   */
  tables(): Promise<Tables> {
    return this.call("tables");
  }

  /** Name a work offset or a tool, or say how long a tool may cut and has cut. */
  async setTableRow(request: SetTableRowRequest): Promise<string[]> {
    return (await this.call<Done>("set_table_row", request)).programs;
  }

  /** Set an output by hand. */
  setOutput(request: SetOutputRequest): Promise<SetReply> {
    return this.call("set_output", request);
  }

  /** Set a simulated input. */
  setSimulatedInput(request: SetInputRequest): Promise<SetReply> {
    return this.call("set_simulated_input", request);
  }

  /** Stop everything at once: emergency stop. No safety function; the key `estop` is the faster way. */
  async callEstop(request: EstopRequest = {}): Promise<string[]> {
    return (await this.call<Done>("estop", request)).programs;
  }

  /** Find every fault of a program's text; nothing runs. */
  check(request: CheckRequest = {}): Promise<CheckReply> {
    return this.call("check", request);
  }

  /** Run a program's text on a virtual clock: its times, travels and faults. */
  simulate(request: SimulateRequest): Promise<SimulateReply> {
    return this.call("simulate", request);
  }

  /** Hand a long text over by parts. */
  putTextPart(request: PutTextRequest): Promise<PutTextReply> {
    return this.call("put_text", request);
  }

  /**
   * Ask for a run that an operator has to arm. The text is checked and simulated from where the axes stand, and
   * nothing moves.
   */
  requestRun(request: RunRequestRequest): Promise<RunRequestReply> {
    return this.call("request_run", request);
  }

  /** List what waits for an operator, is armed, or was started lately. */
  async runRequests(): Promise<RunRequestStatus[]> {
    return (await this.call<RunRequestsReply>("run_requests")).requests;
  }

  /** List the runs whose envelope was approved for a while. */
  async runApprovals(): Promise<RunRequestStatus[]> {
    return (await this.call<RunRequestsReply>("run_approvals")).requests;
  }

  /** Show what an operator looks at before arming: the text and its simulated path. */
  runPreview(sha256: string): Promise<RunPreviewReply> {
    return this.call("run_preview", { sha256 });
  }

  /** Allow a requested run to be started once. */
  arm(request: ArmRequest): Promise<RunRequestStatus> {
    return this.call("arm", request);
  }

  /** Say no to a requested run, and why. */
  reject(request: RejectRequest): Promise<RunRequestStatus> {
    return this.call("reject", request);
  }

  /** Take a requested run back; only the user who asked may. */
  async withdraw(sha256: string): Promise<RunRequestStatus[]> {
    return (await this.call<RunRequestsReply>("withdraw", { sha256 })).requests;
  }

  /** Start a program that is armed. */
  runArmed(request: RunArmedRequest): Promise<RunArmedReply> {
    return this.call("run_armed", request);
  }

  /** Record every cycle into a file on the server from now on. */
  async recordStart(request: RecordStartRequest = {}): Promise<string> {
    return (await this.call<RecordReply>("record_start", request)).name;
  }

  /** End a recording; answered once the file is whole. */
  async recordStop(name?: string): Promise<string> {
    return (await this.call<RecordReply>("record_stop", { name })).name;
  }

  /** Write out the black box, the last minutes. */
  async recordSave(reason?: string): Promise<string> {
    return (await this.call<RecordReply>("record_save", { reason })).name;
  }

  /** List the recordings on the server's disk. */
  recordings(): Promise<RecordingsReply> {
    return this.call("recordings");
  }

  /** Read part of a recording's file. */
  recordingRead(request: RecordingReadRequest): Promise<RecordingPart> {
    return this.call("recording_read", request);
  }

  /** Tell what the machine looks like: its URDF. */
  model(): Promise<ModelReply> {
    return this.call("model");
  }

  /** Read part of a mesh's file. */
  modelMesh(request: ModelMeshRequest): Promise<ModelPart> {
    return this.call("model_mesh", request);
  }

  /** List every drive on a bus, by axis. */
  async drives(): Promise<DriveInfo[]> {
    return (await this.call<DrivesReply>("drives")).drives;
  }

  /** Ask who is on a bus, or on all: every node number of CAN, the slaves of EtherCAT. Nothing is configured. */
  async drivesScan(bus?: string): Promise<BusScan[]> {
    return (await this.call<DrivesScanReply>("drives_scan", { bus })).buses;
  }

  /**
   * List the objects of a drive's dictionary by the names of its EDS, with types, access and limits. The drive is
   * not asked.
   */
  driveParameters(axis: number): Promise<DriveParameters> {
    return this.call("drive_parameters", { axis });
  }

  /** Listen on the buses for some seconds and count load, lost and late frames. Nothing is sent. */
  async drivesHealth(seconds?: number): Promise<BusHealth[]> {
    return (await this.call<DrivesHealthReply>("drives_health", { seconds })).buses;
  }

  /** Record every mapped object of an axis in each cycle, around a trigger. Nothing is sent. */
  driveScope(request: DriveScopeRequest): Promise<DriveTrace> {
    return this.call("drive_scope", request);
  }

  /** Judge the gains of an axis in mode cst or csv by the motion of a program. Nothing is sent. */
  driveTune(request: DriveTuneRequest): Promise<DriveTuning> {
    return this.call("drive_tune", request);
  }

  /** Read an object of a drive's dictionary. */
  sdoRead(request: SdoReadRequest): Promise<SdoReply> {
    return this.call("sdo_read", request);
  }

  /** Write an object of a drive's dictionary, unless that would fight the cycle. */
  sdoWrite(request: SdoWriteRequest): Promise<SdoReply> {
    return this.call("sdo_write", request);
  }
}
