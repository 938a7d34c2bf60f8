// Made by `python -m mcserver.contract.sdk clients`: change the server's messages instead.
package org.mcserver.client;

import java.lang.annotation.ElementType;
import java.lang.annotation.Retention;
import java.lang.annotation.RetentionPolicy;
import java.lang.annotation.Target;
import java.util.List;
import java.util.Locale;
import java.util.Map;

/**
 * The messages of the key space, as plain values (docs/keyspace.md): positions in mm or deg, velocities
 * in mm/s or deg/s, torques in N·m, times in seconds since the executor's start, percentages in %. What may
 * be left out and has no value is null, and {@code withX} gives the same request with another X. An
 * {@code Object} is a Boolean, a Long, a Double or a String.
 */
public final class Messages {
    private Messages() {}

    /** It may be left out: then it is 0, false or empty (boxed, a record or "null": null), or this. */
    @Retention(RetentionPolicy.RUNTIME)
    @Target(ElementType.RECORD_COMPONENT)
    @interface Sparse {
        String value() default "";
    }

    /** The field is there, and may be nil. */
    @Retention(RetentionPolicy.RUNTIME)
    @Target(ElementType.RECORD_COMPONENT)
    @interface Nil {}

    /** A text of a few known values, UNKNOWN for those of a later version. */
    public interface Word {
        /** The constant. */
        String name();

        /** As the wire has it. */
        default String word() {
            return name().equals("UNKNOWN") ? "" : name().toLowerCase(Locale.ROOT);
        }
    }

    /** A word of the wire. */
    public enum AxisKind implements Word {
        LINEAR, ROTARY, UNKNOWN
    }

    /** A word of the wire. */
    public enum AxisState implements Word {
        OFF, STARTING, STANDSTILL, MOVING, SPEED, TORQUE, STOPPING, RELEASED, FAULT, UNKNOWN
    }

    /** A word of the wire. */
    public enum AxisUnit implements Word {
        MM, DEG, UNKNOWN
    }

    /** A word of the wire. */
    public enum BedMeshState implements Word {
        OFF, FILE, PROBED, UNKNOWN
    }

    /** A word of the wire. */
    public enum ChannelKind implements Word {
        DIGITAL, ANALOG, UNKNOWN
    }

    /** A word of the wire. */
    public enum DrivePhase implements Word {
        BOOTING, OPERATIONAL, LOST, RESTARTING, FAILED, CLOSED, UNKNOWN
    }

    /** A word of the wire. */
    public enum EventKind implements Word {
        SERVER_STARTED("server.started"),
        SERVER_STOPPING("server.stopping"),
        PROGRAM_OPENED("program.opened"),
        PROGRAM_STARTED("program.started"),
        PROGRAM_HELD("program.held"),
        PROGRAM_RESUMED("program.resumed"),
        PROGRAM_PAUSED("program.paused"),
        PROGRAM_MESSAGE("program.message"),
        PROGRAM_CLOSED("program.closed"),
        INPUT_READ("input.read"),
        PROGRAM_ENDED("program.ended"),
        LINES_STARTED("lines.started"),
        LINES_ENDED("lines.ended"),
        LINE_REJECTED("line.rejected"),
        FAULT("fault"),
        WARNING("warning"),
        ESTOP("estop"),
        RESET("reset"),
        OVERRIDE("override"),
        COMMAND("command"),
        CLIENT_GONE("client.gone"),
        RECORDING("recording"),
        AXIS_HOMING("axis.homing"),
        AXIS_HOMED("axis.homed"),
        AXIS_UNHOMED("axis.unhomed"),
        PROBE("probe"),
        DRIVE_EMERGENCY("drive.emergency"),
        DRIVE_LOST("drive.lost"),
        DRIVE_BACK("drive.back"),
        DRIVE_REBOOTED("drive.rebooted"),
        DRIVE_STARTED("drive.started"),
        DRIVE_FAILED("drive.failed"),
        BUS_FOREIGN_MASTER("bus.foreign_master"),
        BUS_LOST("bus.lost"),
        BUS_BACK("bus.back"),
        /** A word of a later version. */
        UNKNOWN("");

        private final String word;

        EventKind(String word) {
            this.word = word;
        }

        @Override
        public String word() {
            return word;
        }
    }

    /** A word of the wire. */
    public enum Fieldbus implements Word {
        CAN, ETHERCAT, UNKNOWN
    }

    /** A word of the wire. */
    public enum ToolFrame implements Word {
        BASE, TOOL, UNKNOWN
    }

    /** A word of the wire. */
    public enum LoopMode implements Word {
        CST, CSV, UNKNOWN
    }

    /** A word of the wire. */
    public enum MachineState implements Word {
        READY, FAULT, ESTOP, UNKNOWN
    }

    /** A word of the wire. */
    public enum OnDisconnect implements Word {
        FINISH, STOP, UNKNOWN
    }

    /** A word of the wire. */
    public enum Outputs implements Word {
        SET, LEAVE, UNKNOWN
    }

    /** A word of the wire. */
    public enum ProgramState implements Word {
        QUEUED, RUNNING, HELD, PAUSED, ENDING, FINISHED, ABORTED, REJECTED, FAULTED, INTERRUPTED, UNKNOWN
    }

    /** A word of the wire. */
    public enum Quantity implements Word {
        END, POSITION, TRAVEL, SPEED, DURATION, CLEARANCE, UNKNOWN
    }

    /** A word of the wire. */
    public enum RecordingKind implements Word {
        RECORDING, BLACKBOX, UNKNOWN
    }

    /** A word of the wire. */
    public enum RecordingState implements Word {
        WRITING, DONE, UNFINISHED, UNKNOWN
    }

    /** A word of the wire. */
    public enum RunRole implements Word {
        AGENT, OPERATOR, UNKNOWN
    }

    /** A word of the wire. */
    public enum RunState implements Word {
        WAITING, ARMED, STARTED, REJECTED, UNKNOWN
    }

    /** A word of the wire. */
    public enum SdoType implements Word {
        BOOL, I8, I16, I24, I32, I64, U8, U16, U24, U32, U64, F32, F64, STR, UTF16, BYTES, UNKNOWN
    }

    /** A word of the wire. */
    public enum Severity implements Word {
        ERROR, WARNING, UNKNOWN
    }

    /** A word of the wire. */
    public enum ToolDirection implements Word {
        X("X"),
        Y("Y"),
        Z("Z"),
        A("A"),
        B("B"),
        C("C"),
        /** A word of a later version. */
        UNKNOWN("");

        private final String word;

        ToolDirection(String word) {
            this.word = word;
        }

        @Override
        public String word() {
            return word;
        }
    }

    /**
     * Payload of `ack/{program}`: cumulative, so a lost one does not matter.
     * @param accepted lines through this number are accepted and journaled.
     * @param done this line and every one before it have ended: their setpoints have been passed, and after an
     *     exact stop the axes are in position. Between exact stops an axis may lag by its following error, at most
     *     `max_following_error`: a stricter condition would make each line a stop.
     * @param credit how many lines after `accepted` fit now.
     * @param state the program's.
     * @param rejected number of the line that was found faulty; it is the next one expected. 0: none.
     * @param diagnostics what is wrong with it.
     * @param fault what stopped the program.
     * @param expected the line number expected, set if the acknowledged message left a gap.
     * @param rejections how many lines of the program have been rejected so far. An acknowledgement with a smaller
     *     count than an earlier one is older: its numbers are of lines that were discarded.
     * @param reason why it was aborted: by whom, or a code; empty in programs of an earlier start of the server.
     */
    public record Ack(
            String program, long accepted, long done, long credit, ProgramState state, @Sparse long rejected, @Sparse
            List<Diagnostic> diagnostics, @Sparse Fault fault, @Sparse long expected, @Sparse long rejections, @Sparse
            String reason) {}

    /** A number that a button asks for, in the units of its text; `first` is shown first. */
    public record ArgumentInfo(String name, double low, double high, double first, String unit) {}

    /**
     * Arms a text once.
     * @param sha256 of the text, or at least its first 8 digits.
     * @param seconds how long it may be started.
     * @param override the greatest feed override [%].
     * @param number of the request that was reviewed: one that was repeated since is not armed; null: any.
     * @param standingS for this time every other run that the same client requests, and that stays inside the
     *     envelope of this run, is armed at its request; 0: only this run, once.
     * @param servo for the same time it may also stream targets, inside the extents, speeds and duration of this
     *     run (`servo_armed`); no simulation shows these beforehand.
     */
    public record ArmRequest(
            String sha256, double seconds, double override, Long number, double standingS, boolean servo) {
        /** All that may be left out as the server has it. */
        public ArmRequest(String sha256) {
            this(sha256, 60.0, 100.0, null, 0.0, false);
        }

        public ArmRequest withSeconds(double seconds) {
            return new ArmRequest(sha256, seconds, override, number, standingS, servo);
        }

        public ArmRequest withOverride(double override) {
            return new ArmRequest(sha256, seconds, override, number, standingS, servo);
        }

        public ArmRequest withNumber(Long number) {
            return new ArmRequest(sha256, seconds, override, number, standingS, servo);
        }

        public ArmRequest withStandingS(double standingS) {
            return new ArmRequest(sha256, seconds, override, number, standingS, servo);
        }

        public ArmRequest withServo(boolean servo) {
            return new ArmRequest(sha256, seconds, override, number, standingS, servo);
        }
    }

    /**
     * One bound of a run.
     * @param what `end`: where a coordinate ends; `position`: where it is at any time; `travel`: how far its
     *     greatest place is from its least; `speed`: of an axis, or of a tool's tip (`T3`); `duration` [s];
     *     `clearance`: the least between bodies [mm].
     * @param of the coordinate: `X`, `7`, `T3.X`; a speed's axis or tool; empty for duration and clearance.
     * @param least bounds, which belong to it [mm or deg, per second]; null: none to this side.
     * @param most bounds, which belong to it [mm or deg, per second]; null: none to this side.
     */
    public record Assertion(Quantity what, @Sparse String of, @Sparse Double least, @Sparse Double most) {}

    /**
     * All axes, column-wise: every list has one entry for each of `index`.
     * @param homed whether the axis knows its position; axes without `[axis.homing]` always do.
     * @param skew how much the second drive of a gantry pair is further than its leader [mm, deg]; 0 for other
     *     axes. Empty on a machine without pairs.
     * @param silent whether the axis's drive does not answer: its position, velocity and torque are old. Empty
     *     while all answer.
     */
    public record AxesStatus(
            List<Long> index, List<Double> position, List<Double> setpoint, List<Double> velocity, List<Double> torque,
            List<AxisState> state, @Sparse List<Boolean> homed, @Sparse List<Double> skew, @Sparse List<Boolean> silent) {}

    /**
     * How an axis moves otherwise; the other program's minus this one's [mm or deg].
     * @param most greatest difference of two setpoints of the same cycle; the shorter run rests at its end.
     * @param timeS when, and the lines that run then.
     * @param line when, and the lines that run then.
     * @param otherLine when, and the lines that run then.
     * @param min differences of the least, greatest and last setpoint.
     * @param max differences of the least, greatest and last setpoint.
     * @param end differences of the least, greatest and last setpoint.
     */
    public record AxisDifference(
            long axis, String unit, double most, double timeS, long line, long otherLine, double min, double max, double
            end) {}

    /**
     * One axis; limits in mm or deg and seconds, null where not limited. `homing`: how it finds its reference;
     * null: its encoder's reading is its position. `letter`: an additional letter by which programs of the
     * machine's profile name it, such as `E`; empty: none. `spindle`: M3, M4, M5 and S turn it.
     */
    public record AxisInfo(
            long index, AxisKind type, AxisUnit unit, double maxVelocity, double maxAcceleration, String drive, @Sparse
            Double maxJerk, @Sparse Double minPosition, @Sparse Double maxPosition, @Sparse double inPosition,
            @Sparse("null") String homing, @Sparse String letter, @Sparse boolean spindle) {}

    /**
     * An axis of a program that is to start at a line.
     * @param now present position [mm, deg].
     * @param there position in the program before the line [mm, deg]; null: unknown.
     * @param energized the axis is energized in the program there.
     * @param away the two positions differ by more than the axis's in-position tolerance, or `there` is unknown.
     */
    public record AxisStart(long axis, String unit, double now, @Nil Double there, boolean energized, boolean away) {}

    /** Where an axis ends, and its least and greatest setpoint [mm or deg]. */
    public record AxisTravel(double position, double min, double max, String unit) {}

    /**
     * Frames that were counted while a bus was listened to.
     * @param durationS how long the bus was listened to [s].
     * @param frames number of all frames.
     * @param load share of the bit rate that they took [1], each counted with the most stuff bits that it can
     *     have.
     * @param syncs number of SYNCs.
     * @param longestSyncGapS longest time between two of them, by this computer's clock [s].
     * @param strangers number of frames by COB-ID, of COB-IDs that belong to no node of the machine file.
     */
    public record BusCounts(
            double durationS, long frames, double load, @Sparse long syncs, @Sparse double longestSyncGapS, @Sparse
            List<NodeHealth> nodes, @Sparse Map<String, Long> strangers) {}

    /**
     * Result of listening to a bus beside its master.
     * @param counts numbers of frames; on EtherCAT a node is a position on the line.
     * @param master the sign by which a master was noticed; empty: none was.
     * @param errorFrames number of errors and malformed packets at this computer's interface, on EtherCAT of
     *     frames with a wrong working counter.
     * @param followingErrors greatest following error by axis, between setpoint and encoder on the bus [mm, deg].
     */
    public record BusHealth(
            String bus, BusCounts counts, @Sparse String master, @Sparse long errorFrames, @Sparse Map<String, Double>
            followingErrors) {}

    /**
     * The nodes that answer on a bus.
     * @param machineFile text of a machine file with these drives, to start from.
     * @param fieldbus kind of the bus.
     */
    public record BusScan(
            String bus, String address, List<ScannedNode> nodes, String machineFile, @Sparse("can") Fieldbus fieldbus) {}

    /**
     * A program of the machine file, or a probing cycle, that people start from a page.
     * @param text lines of G-code; `{name}` is the place of an argument.
     * @param role the lowest role that may press it, `operator` or `engineer`.
     * @param confirm what must be confirmed before it runs; empty: nothing.
     * @param group the heading under which pages show it.
     */
    public record ButtonInfo(
            String name, String text, String role, String confirm, List<ArgumentInfo> arguments, String group) {}

    /** As `mcserver check --json`. */
    public record CheckReply(boolean ok, List<Diagnostic> diagnostics) {}

    /**
     * Every fault of a program's text; nothing runs.
     * @param text the whole text; or sha256: of one that was uploaded by `put_text`.
     * @param positions start the axes there [mm, deg].
     * @param blockDelete as of `OpenRequest`.
     * @param optionalStop as of `OpenRequest`.
     */
    public record CheckRequest(
            String text, Map<String, Double> positions, String sha256, Boolean blockDelete, Boolean optionalStop) {
        /** All that may be left out as the server has it. */
        public CheckRequest() {
            this(null, null, null, null, null);
        }

        public CheckRequest withText(String text) {
            return new CheckRequest(text, positions, sha256, blockDelete, optionalStop);
        }

        public CheckRequest withPositions(Map<String, Double> positions) {
            return new CheckRequest(text, positions, sha256, blockDelete, optionalStop);
        }

        public CheckRequest withSha256(String sha256) {
            return new CheckRequest(text, positions, sha256, blockDelete, optionalStop);
        }

        public CheckRequest withBlockDelete(Boolean blockDelete) {
            return new CheckRequest(text, positions, sha256, blockDelete, optionalStop);
        }

        public CheckRequest withOptionalStop(Boolean optionalStop) {
            return new CheckRequest(text, positions, sha256, blockDelete, optionalStop);
        }
    }

    /**
     * The least distances of a run's bodies.
     * @param leastMm null if all stayed apart by more than the margin plus 50 mm.
     * @param pairs that came nearer, the nearest first, 20 at most.
     * @param assumedOn zones that an input switches, which count as on.
     */
    public record ClearanceReport(
            double marginMm, @Nil Double leastMm, List<PairClearance> pairs, @Sparse List<String> assumedOn) {}

    /** `accepted`: the last line that will run. */
    public record CloseReply(String program, long accepted, long done, ProgramState state) {}

    /**
     * No more lines will come; the accepted lines run to their end. `last`: the last line that was sent; the
     * program is only closed if it has been accepted.
     */
    public record CloseRequest(String program, Long last) {
        /** All that may be left out as the server has it. */
        public CloseRequest(String program) {
            this(program, null);
        }

        public CloseRequest withLast(Long last) {
            return new CloseRequest(program, last);
        }
    }

    /**
     * How a program would continue.
     * @param program its id, empty for a text.
     * @param name as it ended; lines through `done` are certain.
     * @param state as it ended; lines through `done` are certain.
     * @param done as it ended; lines through `done` are certain.
     * @param accepted as it ended; lines through `done` are certain.
     * @param whole its text is known to its end, so nothing must be sent.
     * @param sha256 of its whole text.
     * @param line the first that would run.
     * @param first of the text around that line.
     * @param lines of the text around that line.
     * @param modal codes in force there.
     * @param energize axes that are energized first.
     * @param axes where each is, and where the program has it there.
     * @param way the moves that bring them there, in order.
     * @param switched what the program had switched differently from now.
     * @param needs what prevents it; one that has `confirm` is met by that field of the request.
     * @param blockDelete the settings that it continues with.
     * @param optionalStop the settings that it continues with.
     */
    public record Continuation(
            String program, String name, @Nil ProgramState state, long done, long accepted, boolean whole, @Nil String
            sha256, long line, long first, List<String> lines, List<String> modal, List<Long> energize, List<AxisStart>
            axes, List<WayStep> way, List<Switched> switched, List<Need> needs, boolean blockDelete, boolean
            optionalStop) {}

    /**
     * What a start in the middle of a program would do; nothing moves.
     * @param program one that has ended; if others have continued it, the last of these is meant.
     * @param line the first that would run; null: the one after the last that is done.
     * @param before lines 1 … line - 1 of a text, instead of `program`.
     * @param axes of it; null: all of the machine.
     * @param blockDelete of the text, as in `OpenRequest`; a program keeps its settings.
     * @param optionalStop of the text, as in `OpenRequest`; a program keeps its settings.
     */
    public record ContinuationRequest(
            String program, Long line, List<String> before, List<Long> axes, Boolean blockDelete, Boolean optionalStop) {
        /** All that may be left out as the server has it. */
        public ContinuationRequest() {
            this(null, null, List.of(), null, null, null);
        }

        public ContinuationRequest withProgram(String program) {
            return new ContinuationRequest(program, line, before, axes, blockDelete, optionalStop);
        }

        public ContinuationRequest withLine(Long line) {
            return new ContinuationRequest(program, line, before, axes, blockDelete, optionalStop);
        }

        public ContinuationRequest withBefore(List<String> before) {
            return new ContinuationRequest(program, line, before, axes, blockDelete, optionalStop);
        }

        public ContinuationRequest withAxes(List<Long> axes) {
            return new ContinuationRequest(program, line, before, axes, blockDelete, optionalStop);
        }

        public ContinuationRequest withBlockDelete(Boolean blockDelete) {
            return new ContinuationRequest(program, line, before, axes, blockDelete, optionalStop);
        }

        public ContinuationRequest withOptionalStop(Boolean optionalStop) {
            return new ContinuationRequest(program, line, before, axes, blockDelete, optionalStop);
        }
    }

    /**
     * The program that continues, like `OpenReply`.
     * @param line the first that runs.
     * @param resumeOf the program that it continues.
     * @param whole the server has all of its lines; otherwise the client sends those from `expected` on.
     */
    public record ContinueReply(
            String program, ProgramState state, List<Long> axes, long expected, long credit, String instance, long line,
            String resumeOf, boolean whole) {}

    /**
     * Continues a program that has ended.
     * @param program as in `ContinuationRequest`.
     * @param line as in `ContinuationRequest`.
     * @param way axes may move as `continuation` shows, if the machine file names no safe way.
     * @param outputs set what the program had switched, or leave it as it is; null: not specified.
     * @param onDisconnect as in `OpenRequest`.
     * @param graceS as in `OpenRequest`.
     * @param hold begin held.
     */
    public record ContinueRequest(
            String program, Long line, boolean way, Outputs outputs, OnDisconnect onDisconnect, double graceS, boolean
            hold) {
        /** All that may be left out as the server has it. */
        public ContinueRequest(String program) {
            this(program, null, false, null, OnDisconnect.STOP, 10.0, false);
        }

        public ContinueRequest withLine(Long line) {
            return new ContinueRequest(program, line, way, outputs, onDisconnect, graceS, hold);
        }

        public ContinueRequest withWay(boolean way) {
            return new ContinueRequest(program, line, way, outputs, onDisconnect, graceS, hold);
        }

        public ContinueRequest withOutputs(Outputs outputs) {
            return new ContinueRequest(program, line, way, outputs, onDisconnect, graceS, hold);
        }

        public ContinueRequest withOnDisconnect(OnDisconnect onDisconnect) {
            return new ContinueRequest(program, line, way, outputs, onDisconnect, graceS, hold);
        }

        public ContinueRequest withGraceS(double graceS) {
            return new ContinueRequest(program, line, way, outputs, onDisconnect, graceS, hold);
        }

        public ContinueRequest withHold(boolean hold) {
            return new ContinueRequest(program, line, way, outputs, onDisconnect, graceS, hold);
        }
    }

    /**
     * How another program moves.
     * @param same every setpoint is the same to the bit.
     * @param durationS the other one's minus this one's.
     * @param axes those whose setpoints differ.
     * @param tips all.
     */
    public record Difference(boolean same, double durationS, List<AxisDifference> axes, List<TipDifference> tips) {}

    /**
     * How slow the disk under the journal is.
     * @param since Unix time from which on it is slow [s].
     * @param commitS how long messages have waited for the journal's commit [s].
     * @param syncS how long the current sync has taken [s]; a power cut loses what was committed in that time.
     * @param worstS the longest of these since then [s].
     */
    public record DiskStatus(double since, double commitS, double syncS, double worstS) {}

    /** Reply of methods that return no data: the programs concerned. */
    public record Done(List<String> programs) {}

    /**
     * A drive on a bus and its state.
     * @param node node number; on EtherCAT the position on the line.
     * @param state state of the drive in the server's supervision.
     * @param nmt NMT state in the last heartbeat, on EtherCAT the AL state; empty: no heartbeat has come yet.
     * @param heartbeatAgeS time since the last sign of life [s]; null: none has come yet.
     * @param statusword 6041h; of a drive that streams telemetry its fault bits.
     * @param status the same in words.
     * @param deviceType objects 1000h, 1018h:01 and 1018h:02.
     * @param vendorId objects 1000h, 1018h:01 and 1018h:02.
     * @param productCode objects 1000h, 1018h:01 and 1018h:02.
     * @param emergency the last emergency message in words, on EtherCAT the error code 603Fh.
     * @param emergencyCode its error code.
     * @param emergencyAgeS time since it came [s].
     * @param bootUps number of the drive's starts since the server started.
     * @param message why the last configuration failed.
     * @param monitor newest values of its telemetry, and of objects that `monitor` in the machine file names.
     * @param fieldbus kind of the bus.
     */
    public record DriveInfo(
            long axis, String kind, String bus, long node, DrivePhase state, @Sparse String nmt, @Sparse Double
            heartbeatAgeS, @Sparse Long statusword, @Sparse String status, @Sparse Long deviceType, @Sparse Long
            vendorId, @Sparse Long productCode, @Sparse String emergency, @Sparse Long emergencyCode, @Sparse Double
            emergencyAgeS, @Sparse long bootUps, @Sparse String message, @Sparse List<MonitoredValue> monitor,
            @Sparse("can") Fieldbus fieldbus) {}

    /**
     * The objects of a drive, of one axis of its node.
     * @param node node number; on EtherCAT the position on the line.
     * @param nodeAxis number of the axis among those of its node, from 0.
     * @param edsSha256 digest of the drive's EDS; empty: it has none, and the objects are those of the standard.
     * @param unreadable entries of the EDS that cannot be read, each with the reason.
     * @param fieldbus kind of the bus.
     */
    public record DriveParameters(
            long axis, String bus, long node, long nodeAxis, String edsSha256, List<ParameterInfo> parameters,
            List<String> unreadable, @Sparse("can") Fieldbus fieldbus) {}

    /** The objects of an axis's drive. */
    public record DriveParametersRequest(long axis) {}

    /**
     * Every mapped object of an axis's drive in each cycle.
     * @param seconds time kept.
     * @param trigger such as `following error &gt; 0.05`; empty: at once.
     * @param level fires also if the level is already met.
     * @param beforeS kept before the trigger; null: a quarter.
     * @param timeoutS how long the trigger may take.
     */
    public record DriveScopeRequest(
            long axis, double seconds, String trigger, boolean level, Double beforeS, double timeoutS) {
        /** All that may be left out as the server has it. */
        public DriveScopeRequest(long axis) {
            this(axis, 2.0, "", false, null, 10.0);
        }

        public DriveScopeRequest withSeconds(double seconds) {
            return new DriveScopeRequest(axis, seconds, trigger, level, beforeS, timeoutS);
        }

        public DriveScopeRequest withTrigger(String trigger) {
            return new DriveScopeRequest(axis, seconds, trigger, level, beforeS, timeoutS);
        }

        public DriveScopeRequest withLevel(boolean level) {
            return new DriveScopeRequest(axis, seconds, trigger, level, beforeS, timeoutS);
        }

        public DriveScopeRequest withBeforeS(Double beforeS) {
            return new DriveScopeRequest(axis, seconds, trigger, level, beforeS, timeoutS);
        }

        public DriveScopeRequest withTimeoutS(double timeoutS) {
            return new DriveScopeRequest(axis, seconds, trigger, level, beforeS, timeoutS);
        }
    }

    /**
     * Recording of every mapped object of an axis in each cycle, around a trigger.
     * @param cycles number of cycles.
     * @param cycleS length of a cycle [s].
     * @param beginS time of the first cycle; the trigger is at time 0 [s].
     * @param triggerUnix Unix time of time 0 [s].
     * @param missing number of SYNCs that are missing in the recording.
     */
    public record DriveTrace(
            long axis, long cycles, double cycleS, double beginS, double triggerUnix, long missing, List<ScopeSignal>
            signals) {}

    /** The gains of an axis in mode cst or csv, by the motion of a program; `seconds`: time observed. */
    public record DriveTuneRequest(long axis, double seconds) {
        /** All that may be left out as the server has it. */
        public DriveTuneRequest(long axis) {
            this(axis, 20.0);
        }

        public DriveTuneRequest withSeconds(double seconds) {
            return new DriveTuneRequest(axis, seconds);
        }
    }

    /**
     * Result of measuring an axis in mode cst or csv while it moves, and proposed gains of its loop.
     * @param measured in mode cst inertia [kg·m²], friction [N·m], viscous [N·m·s/rad], load [N·m], explained and
     *     uncertainty [1]; in mode csv scale [1], lag and uncertainty [s].
     * @param said the same in words.
     * @param loops the loop with the gains of the machine file, then with the proposed ones.
     * @param changes lines to change in the machine file; empty: its gains fit.
     * @param remedy how to apply the changes.
     * @param frequencyHz open-loop response with the gains of the machine file, as measured; empty: not known.
     * @param gainDb open-loop response with the gains of the machine file, as measured; empty: not known.
     * @param phaseDeg open-loop response with the gains of the machine file, as measured; empty: not known.
     */
    public record DriveTuning(
            long axis, LoopMode mode, Map<String, Double> measured, String said, List<TunedLoop> loops, List<String>
            changes, String remedy, List<Double> frequencyHz, List<Double> gainDb, List<Double> phaseDeg) {}

    /** By bus. */
    public record DrivesHealthReply(List<BusHealth> buses) {}

    /** Health of the buses; `seconds`: how long to listen to them, all together. */
    public record DrivesHealthRequest(double seconds) {
        /** All that may be left out as the server has it. */
        public DrivesHealthRequest() {
            this(5.0);
        }
    }

    /** By axis; empty if no drive is on a bus. */
    public record DrivesReply(List<DriveInfo> drives) {}

    /** Every drive on a bus. */
    public record DrivesRequest() {}

    /** By bus; each with a machine file to start from. */
    public record DrivesScanReply(List<BusScan> buses) {}

    /** Scans a bus: every node number of CAN, every drive of EtherCAT; `bus` empty: all buses. */
    public record DrivesScanRequest(String bus) {
        /** All that may be left out as the server has it. */
        public DrivesScanRequest() {
            this("");
        }
    }

    /**
     * A certain remedy: characters of the diagnostic's line and what replaces them.
     * @param column code points from 1, end exclusive.
     * @param endColumn code points from 1, end exclusive.
     * @param text the replacement.
     */
    public record Edit(long column, long endColumn, String text) {}

    /**
     * Payload of every `reply_err`.
     * @param details what the code's entry in docs/wire/errors.md lists, such as `expected`.
     * @param diagnostics faults of G-code, if the error concerns lines.
     */
    public record ErrorReply(
            String code, String message, @Sparse String hint, @Sparse Map<String, Object> details, @Sparse
            List<Diagnostic> diagnostics) {}

    /**
     * Emergency stop by rpc, and payload of the key `estop` (where it may be empty).
     * @param reason for people.
     * @param client on the key `estop`, who stops, by its own account; a call has it in its key.
     */
    public record EstopRequest(String reason, String client) {
        /** All that may be left out as the server has it. */
        public EstopRequest() {
            this("", "");
        }

        public EstopRequest withReason(String reason) {
            return new EstopRequest(reason, client);
        }

        public EstopRequest withClient(String client) {
            return new EstopRequest(reason, client);
        }
    }

    /**
     * Payload of `event`; `seq` has no gap within one `instance`. Times `t` of two instances cannot be compared.
     * @param t executor time [s].
     * @param kind determines which of the others are set (docs/wire/events.md).
     * @param line the last line started for `lines.started`; the line of a fault.
     * @param lines for `lines.ended`.
     * @param reason why a program ended, an emergency stop's reason, a warning's code, a drive's or bus's code.
     * @param axis of a drive's event, or of homing.
     * @param probe for `probe`.
     * @param wall Unix time of `t`, by the clock as it went then [s].
     */
    public record Event(
            long seq, double t, String instance, EventKind kind, @Sparse("null") String program, @Sparse("null") String
            client, @Sparse ProgramState state, @Sparse long line, @Sparse List<LineReport> lines, @Sparse Fault fault,
            @Sparse List<Diagnostic> diagnostics, @Sparse String reason, @Sparse String message, @Sparse Double percent,
            @Sparse Long axis, @Sparse ProbeStatus probe, @Sparse double wall) {}

    /** `oldest` is the first number that the server still holds; `newest` the last one published. */
    public record EventsReply(String instance, long oldest, long newest, List<Event> events) {}

    /** Events that the server still holds, from number `since` on, oldest first. */
    public record EventsRequest(long since, long limit) {
        /** All that may be left out as the server has it. */
        public EventsRequest() {
            this(0, 500);
        }

        public EventsRequest withSince(long since) {
            return new EventsRequest(since, limit);
        }

        public EventsRequest withLimit(long limit) {
            return new EventsRequest(since, limit);
        }
    }

    /**
     * Least and greatest setpoint of an axis [mm or deg], and its greatest speed [mm/s or deg/s].
     * @param turns the axis turns continuously at a speed (G1030): its positions are not bounded.
     */
    public record Extent(
            long axis, double low, double high, String unit, @Sparse double speed, @Sparse boolean turns) {}

    /** What stopped motion: a stable code, and the axis and line if they apply. */
    public record Fault(
            String code, String message, @Sparse String hint, @Sparse Long axis, @Sparse long line, @Sparse("null")
            String program, @Sparse double t) {}

    /** The program that homes, for `abort`, and its axes in the order of their homing. */
    public record HomeReply(String program, List<Long> axes) {}

    /** Finds the references of axes, those with the lowest order first; null: of all that have a method. */
    public record HomeRequest(List<Long> axes) {
        /** All that may be left out as the server has it. */
        public HomeRequest() {
            this(null);
        }
    }

    /**
     * Reply of `info`.
     * @param protocol versions of this key space that the server speaks.
     * @param instance one start of the server; a different one means that earlier programs were interrupted.
     * @param epoch Unix time of executor time 0, by the clock as it goes now [s].
     * @param buttons programs of the machine file that operators start, with places for numbers.
     * @param group by which people find the machine.
     * @param tags by which people find the machine.
     * @param camera address of a still picture or of MJPEG; empty: none.
     * @param ordersFrom instruments that may command, such as `opcua`; others only show the machine.
     */
    public record Info(
            String machine, String server, List<Long> protocol, String instance, double epoch, double cycleS,
            List<AxisInfo> axes, List<ToolInfo> tools, TelemetryInfo telemetry, LimitsInfo limits, List<String> methods,
            @Sparse List<InputInfo> inputs, @Sparse List<OutputInfo> outputs, @Sparse List<ButtonInfo> buttons, @Sparse
            String group, @Sparse List<String> tags, @Sparse String camera, @Sparse List<String> ordersFrom) {}

    /** What the machine and its service are: an `Info`. */
    public record InfoRequest() {}

    /**
     * One input.
     * @param number within its kind, as M66 names it.
     * @param source of a real input; empty: it is simulated.
     * @param hold it can hold the programs, or stop the machine.
     * @param stop it can hold the programs, or stop the machine.
     */
    public record InputInfo(
            String name, long number, ChannelKind kind, @Sparse String unit, @Sparse String source, @Sparse boolean
            hold, @Sparse boolean stop) {}

    /** An input: its value (digital: 0, 1), and whether it holds the programs or stops the machine now. */
    public record InputStatus(String name, double value, @Sparse boolean holds, @Sparse boolean stops) {}

    /** The jog's program id: for `abort`, and for keeping it alive. */
    public record JogReply(String program) {}

    /**
     * Moves one axis by hand.
     * @param distance from where it is, signed [mm, deg]; null: until stopped or the limit, by the sign of
     *     `velocity`.
     * @param velocity [mm/s, deg/s]; null: a tenth of the axis's limit.
     * @param holdS dead-man timeout: the axis stops unless the same jog is requested again within it; null: no
     *     timeout. A jog without distance always has one (default 0.5 s).
     * @param program id of the running jog that this request keeps alive.
     * @param by the person, if a client serves several: steps of one person follow each other, those of another
     *     person are refused (MC512) while the axis moves.
     */
    public record JogRequest(long axis, Double distance, Double velocity, Double holdS, String program, String by) {
        /** All that may be left out as the server has it. */
        public JogRequest(long axis) {
            this(axis, null, null, null, null, "");
        }

        public JogRequest withDistance(Double distance) {
            return new JogRequest(axis, distance, velocity, holdS, program, by);
        }

        public JogRequest withVelocity(Double velocity) {
            return new JogRequest(axis, distance, velocity, holdS, program, by);
        }

        public JogRequest withHoldS(Double holdS) {
            return new JogRequest(axis, distance, velocity, holdS, program, by);
        }

        public JogRequest withProgram(String program) {
            return new JogRequest(axis, distance, velocity, holdS, program, by);
        }

        public JogRequest withBy(String by) {
            return new JogRequest(axis, distance, velocity, holdS, program, by);
        }
    }

    /**
     * An assertion as the run keeps to it.
     * @param what of the assertion.
     * @param of of the assertion.
     * @param least of the assertion.
     * @param most of the assertion.
     * @param holds whether the run keeps to it.
     * @param value the extreme that counts; null: bodies stay farther apart than is reported.
     * @param timeS when and in which line it has this value, or leaves the bounds of a position or speed.
     * @param line when and in which line it has this value, or leaves the bounds of a position or speed.
     */
    public record Judged(
            Quantity what, String of, @Nil Double least, @Nil Double most, boolean holds, @Nil Double value, double
            timeS, long line) {}

    /** The client leaves: its open programs end now as their `on_disconnect` says, without a grace time. */
    public record LeaveRequest() {}

    /** Bounds of the service. */
    public record LimitsInfo(
            long maxLineLength, long maxLinesAMessage, long queueLines, long programsAtOnce, long openPrograms, long
            rememberedAnswers, double rememberedAnswerS) {}

    /**
     * Time of one line that has ended.
     * @param startS executor time [s].
     * @param endS executor time [s].
     * @param requestedS null if the line requests no time.
     * @param stretchedBy actual / requested; null without a requested time.
     * @param boundBy the limit that stretched it, such as `axis 2 acceleration`.
     */
    public record LineReport(
            long line, double startS, double endS, @Sparse Double requestedS, @Sparse Double stretchedBy,
            @Sparse("null") String boundBy) {}

    /**
     * @param name of the file, without its folder.
     * @param text as it is on the disk now.
     * @param sha256 of that text.
     * @param inForce the server runs with this text; otherwise it has changed since the start.
     */
    public record MachineFileReply(String name, String text, String sha256, boolean inForce) {}

    /** The machine file that the server was started with. */
    public record MachineFileRequest() {}

    /**
     * Payload of `tele/state` and reply of `status`.
     * @param t executor time [s].
     * @param wall Unix time of `t` [s].
     * @param override machine-wide feed override [%].
     * @param lateCycles cycles that began too late, since the start.
     * @param inputs those of the machine file, in the order of `info`.
     * @param outputs those of the machine file, in the order of `info`.
     * @param workOffsets systems that were set, with which the next program starts (G54 is in force then).
     * @param disk how slow the disk under the journal is; null: it keeps up.
     * @param mounted tools that have bodies and are known to be mounted.
     * @param bedMesh mesh in force where G29 probes one: none, that of the machine file, or the probed one; null:
     *     G29 does not probe.
     */
    public record MachineStatus(
            double t, double wall, String instance, MachineState state, AxesStatus axes, List<ProgramStatus> programs,
            List<Fault> faults, @Sparse("100") double override, @Sparse long lateCycles, @Sparse List<ToolPose> tools,
            @Sparse List<InputStatus> inputs, @Sparse List<OutputStatus> outputs, @Sparse ProbeStatus probe, @Sparse
            List<WorkOffset> workOffsets, @Sparse DiskStatus disk, @Sparse List<MountedTool> mounted, @Sparse
            BedMeshState bedMesh) {}

    /** A mesh that the URDF names: `name` as written there; `size` in bytes, 0: it is not available. */
    public record MeshInfo(String name, long size) {}

    /**
     * A body or zone of `[clearance]`.
     * @param shape `box` (of a zone too), `cylinder`, `capsule`, `sphere`, `mesh` or `cutter`.
     * @param sizeMm edges of a box, radius and length of a round shape.
     * @param atMm in the frame of its carrier, Rz(C)·Ry(B)·Rx(A).
     * @param turnedDeg in the frame of its carrier, Rz(C)·Ry(B)·Rx(A).
     * @param mesh its index in `ModelReply.meshes`; the file is in mm.
     * @param link of the URDF that carries it.
     * @param carriedBy axes that carry it instead
     * @param directions of these, 0 to 2 for X to Z.
     * @param opposite in their negative direction. Neither: it is fixed.
     * @param tool with which it is mounted; null: it is always there.
     * @param zone `keep_out`, `keep_in` or `slow`; empty: a body.
     * @param input name of the input that switches it on; empty: it is always on.
     * @param high the input's level then.
     */
    public record ModelBody(
            String name, String shape, List<Double> sizeMm, List<Double> atMm, List<Double> turnedDeg, @Sparse Long
            mesh, @Sparse String link, @Sparse List<Long> carriedBy, @Sparse List<Long> directions, @Sparse boolean
            opposite, @Sparse Long tool, @Sparse String zone, @Sparse String input, @Sparse boolean high) {}

    /** Part of a mesh's file: `mesh` counts from 0 in `ModelReply.meshes`. */
    public record ModelMeshRequest(long mesh, long offset, long size) {
        /** All that may be left out as the server has it. */
        public ModelMeshRequest(long mesh) {
            this(mesh, 0, 1048576);
        }

        public ModelMeshRequest withOffset(long offset) {
            return new ModelMeshRequest(mesh, offset, size);
        }

        public ModelMeshRequest withSize(long size) {
            return new ModelMeshRequest(mesh, offset, size);
        }
    }

    /** `data` from `offset` on; `size` of the whole file. */
    public record ModelPart(long offset, long size, byte[] data) {}

    /**
     * A robot's URDF, and the bodies and zones of a machine.
     * @param urdf its text; empty: the machine has none.
     * @param digest of the text and the meshes.
     * @param joints the joint that each axis moves, by axis number.
     * @param meshes of the visuals, followed by those of bodies, in the order of `ModelMeshRequest.mesh`.
     */
    public record ModelReply(
            String urdf, String digest, Map<String, String> joints, List<MeshInfo> meshes, @Sparse List<ModelBody>
            bodies) {}

    /** What the machine looks like: a `ModelReply`. */
    public record ModelRequest() {}

    /**
     * A value of a drive: of an object that `monitor` in the machine file names, or of its own telemetry.
     * @param value the newest one; null: none has come yet.
     * @param index the object; index 0: it is telemetry.
     * @param subindex the object; index 0: it is telemetry.
     */
    public record MonitoredValue(String name, @Nil Object value, @Sparse long index, @Sparse long subindex) {}

    /**
     * A tool that has a body and is mounted, according to a program.
     * @param spindle it is the cutter in the spindle, with `length` and `diameter` of the tool table [mm];
     *     otherwise both are 0.
     */
    public record MountedTool(long number, boolean spindle, double length, double diameter) {}

    /**
     * What has to be resolved before a program starts at a line: code, message and remedy.
     * @param confirm field of the request that confirms it, `way` or `outputs`; empty: it cannot be confirmed.
     */
    public record Need(String code, String message, String hint, @Sparse String confirm) {}

    /**
     * Frames of a node that were counted while a bus was listened to.
     * @param axes numbers of the machine's axes that the node has.
     * @param state NMT state in the last heartbeat; empty: none came.
     * @param heartbeats number of heartbeats.
     * @param longestGapS longest time between two of them, by this computer's clock [s].
     * @param readings number of TPDOs that the node sends at SYNC.
     * @param late number of those that came after the next SYNC.
     * @param lost number of those that never came.
     * @param bootUps number of its boot-up messages.
     * @param emergencies its last emergency messages in words.
     */
    public record NodeHealth(
            long node, List<Long> axes, @Sparse String state, @Sparse long heartbeats, @Sparse double longestGapS,
            @Sparse long readings, @Sparse long late, @Sparse long lost, @Sparse long bootUps, @Sparse List<String>
            emergencies) {}

    /** The program's id; `expected` is the next line number, `credit` how many lines fit now. */
    public record OpenReply(
            String program, ProgramState state, List<Long> axes, long expected, long credit, String instance) {}

    /**
     * Opens a program.
     * @param name for people: a file's name.
     * @param axes the axes to lease; null: all of the machine.
     * @param onDisconnect what happens when the client's liveliness token disappears, or it calls `leave`.
     * @param graceS how long the token may be absent before that; a client that returns in this time continues.
     * @param startLine number of the first line that will run.
     * @param before lines 1 … start_line - 1. They do not run; the axes move to where these lines end, energized,
     *     in the modal state that they leave.
     * @param resumeOf id of an earlier program; its journaled lines before `start_line` serve as `before`.
     * @param step single-line mode: a line starts only on a `step` call.
     * @param hold begin held; `resume` starts it.
     * @param sha256 of the whole text; its times, from `simulate` or `put_text`, are used for the program.
     * @param atPause run now, also on axes of a program that is at a pause, such as to set zero with a new tool;
     *     refused (MC512) if it would have to wait. Without it a program waits for the other's end.
     * @param way of a start in the middle, as in `ContinueRequest`.
     * @param outputs of a start in the middle, as in `ContinueRequest`.
     * @param blockDelete lines that begin with `/` are skipped, until the program ends; null: they are executed as
     *     if it were not there, but `resume_of` keeps its setting (D-98).
     * @param optionalStop whether M01 pauses; null: it does, but `resume_of` keeps its setting.
     */
    public record OpenRequest(
            String name, List<Long> axes, OnDisconnect onDisconnect, double graceS, long startLine, List<String> before,
            String resumeOf, boolean step, boolean hold, String sha256, boolean atPause, boolean way, Outputs outputs,
            Boolean blockDelete, Boolean optionalStop) {
        /** All that may be left out as the server has it. */
        public OpenRequest() {
            this("", null, OnDisconnect.STOP, 10.0, 1, List.of(), null, false, false, null, false, false, null, null, null);
        }

        public OpenRequest withName(String name) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }

        public OpenRequest withAxes(List<Long> axes) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }

        public OpenRequest withOnDisconnect(OnDisconnect onDisconnect) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }

        public OpenRequest withGraceS(double graceS) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }

        public OpenRequest withStartLine(long startLine) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }

        public OpenRequest withBefore(List<String> before) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }

        public OpenRequest withResumeOf(String resumeOf) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }

        public OpenRequest withStep(boolean step) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }

        public OpenRequest withHold(boolean hold) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }

        public OpenRequest withSha256(String sha256) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }

        public OpenRequest withAtPause(boolean atPause) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }

        public OpenRequest withWay(boolean way) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }

        public OpenRequest withOutputs(Outputs outputs) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }

        public OpenRequest withBlockDelete(Boolean blockDelete) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }

        public OpenRequest withOptionalStop(Boolean optionalStop) {
            return new OpenRequest(name, axes, onDisconnect, graceS, startLine, before, resumeOf, step, hold, sha256, atPause, way, outputs, blockDelete, optionalStop);
        }
    }

    /**
     * One output.
     * @param number within its kind, as M62 to M68 name it.
     * @param target of a real output; empty: it is simulated.
     * @param min least and greatest value.
     * @param max least and greatest value.
     * @param safe its value once its setter is lost; null: it stays.
     */
    public record OutputInfo(
            String name, long number, ChannelKind kind, @Sparse String unit, @Sparse String target, @Sparse double min,
            @Sparse("1") double max, @Sparse Double safe) {}

    /** An output: its value (digital: 0, 1), and who set it last: a program's id, `operator` or nobody (empty). */
    public record OutputStatus(String name, double value, @Sparse String setBy) {}

    /** The override now in force [%]. */
    public record OverrideReply(double percent, List<String> programs) {}

    /** Feed override of one program or of all, including future ones; 100 is as programmed. */
    public record OverrideRequest(double percent, String program) {
        /** All that may be left out as the server has it. */
        public OverrideRequest(double percent) {
            this(percent, null);
        }

        public OverrideRequest withProgram(String program) {
            return new OverrideRequest(percent, program);
        }
    }

    /** How near two `bodies` came to each other, when, and in which line. */
    public record PairClearance(List<String> bodies, double leastMm, double timeS, long line) {}

    /**
     * An object of a drive, as its EDS describes it.
     * @param name name in the EDS; a member's follows that of its record: `Gear ratio.Motor revolutions`.
     * @param type data type.
     * @param access ro, wo, rw, rwr, rww or const.
     * @param low limits in the EDS; null: the limits of the type.
     * @param high limits in the EDS; null: the limits of the type.
     */
    public record ParameterInfo(
            long index, long subindex, String name, SdoType type, String access, @Sparse Long low, @Sparse Long high) {}

    /**
     * The last probing move that has ended (G38.2 to G38.5).
     * @param tripped the probe changed.
     * @param positions where the axes were then, else where the move ended, by number [mm, deg]: machine
     *     positions, independent of the program's offsets.
     * @param t executor time [s].
     */
    public record ProbeStatus(String program, long line, boolean tripped, Map<String, Double> positions, double t) {}

    /** hold, resume, abort: one program, or every one (null). */
    public record ProgramRequest(String program) {
        /** All that may be left out as the server has it. */
        public ProgramRequest() {
            this(null);
        }
    }

    /**
     * One program.
     * @param line the line being run, at a pause the one that asks for it; 0: none yet.
     * @param progress share of its time that has passed, 0 … 1; if `duration_s` is unknown, of its lines.
     * @param openedAt Unix time [s].
     * @param etaS until its end at its override [s]; if `duration_s` is unknown, until the end of what is planned.
     * @param endedAt Unix time [s].
     * @param durationS of the whole program at 100 %, as its text was simulated [s]; null: not simulated.
     * @param notice its last message to the operator; while it is paused, what to do before it is resumed.
     * @param simulated share of its lines that the simulation has reached; below 1 `duration_s` is an estimate
     *     from the lines so far.
     * @param pauses how many of its remaining lines wait for an operator, as far as simulated; `eta_s` excludes
     *     these waits.
     * @param waitsFor the input that M66, or a code of `[dialect.waits]`, waits for, the inputs that hold it
     *     (docs/io.md), or the program that must leave first (docs/clearance.md); empty: none.
     * @param rejections as in `Ack`; 0 in programs of an earlier start of the server.
     * @param servo of a program in servo mode; null: it is not in servo mode.
     * @param reason as in `Ack`.
     * @param blockDelete as in `OpenRequest`; null: a program of an earlier start of the server (`continuation`
     *     reports them).
     * @param optionalStop as in `OpenRequest`; null: a program of an earlier start of the server (`continuation`
     *     reports them).
     */
    public record ProgramStatus(
            String program, ProgramState state, String client, String name, List<Long> axes, long startLine, long line,
            long accepted, long done, long credit, boolean closed, double override, double progress, double openedAt,
            @Sparse Double etaS, @Sparse Fault fault, @Sparse long rejected, @Sparse List<Diagnostic> diagnostics,
            @Sparse("null") String resumeOf, @Sparse Double endedAt, @Sparse Double durationS, @Sparse String notice,
            @Sparse("1") double simulated, @Sparse long pauses, @Sparse String waitsFor, @Sparse long rejections,
            @Sparse ServoStatus servo, @Sparse String reason, @Sparse Boolean blockDelete, @Sparse Boolean optionalStop) {}

    /** Newest first. */
    public record ProgramsReply(List<ProgramStatus> programs) {}

    /**
     * The programs that the server knows, the newest first.
     * @param program only this one.
     * @param ended those that have ended too.
     */
    public record ProgramsRequest(String program, boolean ended, long limit) {
        /** All that may be left out as the server has it. */
        public ProgramsRequest() {
            this(null, true, 100);
        }

        public ProgramsRequest withProgram(String program) {
            return new ProgramsRequest(program, ended, limit);
        }

        public ProgramsRequest withEnded(boolean ended) {
            return new ProgramsRequest(program, ended, limit);
        }

        public ProgramsRequest withLimit(long limit) {
            return new ProgramsRequest(program, ended, limit);
        }
    }

    /**
     * How much of the text has arrived: the next part begins at `received`.
     * @param received of the text [bytes].
     * @param lines in this part of it.
     * @param complete all of it has arrived.
     */
    public record PutTextReply(long received, long lines, boolean complete) {}

    /**
     * The next part of a program's text, for `check`, and for the times of programs that run it.
     * @param sha256 of the whole text in UTF-8.
     * @param size of the whole text [bytes].
     * @param offset where the part begins [bytes].
     * @param part its bytes; characters may be split.
     */
    public record PutTextRequest(String sha256, long size, long offset, byte[] part) {}

    /** The recording's name. */
    public record RecordReply(String name) {}

    /** Saves the black box, the last minutes. `reason` is in the file and in its name. */
    public record RecordSaveRequest(String reason) {
        /** All that may be left out as the server has it. */
        public RecordSaveRequest() {
            this("asked");
        }
    }

    /**
     * Records every cycle into a file on the server from now on.
     * @param name of the recording; empty: the time.
     * @param maxS when it ends by itself; null: only when it is stopped.
     */
    public record RecordStartRequest(String name, Double maxS) {
        /** All that may be left out as the server has it. */
        public RecordStartRequest() {
            this("", null);
        }

        public RecordStartRequest withName(String name) {
            return new RecordStartRequest(name, maxS);
        }

        public RecordStartRequest withMaxS(Double maxS) {
            return new RecordStartRequest(name, maxS);
        }
    }

    /** Ends a recording; without a name the only one. The reply comes once the file is complete. */
    public record RecordStopRequest(String name) {
        /** All that may be left out as the server has it. */
        public RecordStopRequest() {
            this("");
        }
    }

    /**
     * The recorder.
     * @param heldS of the black box in memory.
     * @param heldBytes of the black box in memory.
     * @param missedCycles since the start; the recorder came too late for them.
     * @param writing names of the recordings under way.
     */
    public record RecorderStatus(double heldS, long heldBytes, long missedCycles, List<String> writing) {}

    /**
     * A recording on the server's disk.
     * @param name without a suffix.
     * @param kind `blackbox` was written by itself or by `record_save`.
     * @param state `unfinished` was left by a recorder that was killed, and is repaired at the next start.
     * @param size bytes.
     * @param modifiedAt Unix time [s].
     */
    public record RecordingInfo(String name, RecordingKind kind, RecordingState state, long size, double modifiedAt) {}

    /** Bytes of a recording from `offset` on; `size` is the whole file's. */
    public record RecordingPart(String name, long offset, long size, byte[] data) {}

    /** Part of a recording's file, for a download in parts; answered with a `RecordingPart`. */
    public record RecordingReadRequest(String name, long offset, long size) {
        /** All that may be left out as the server has it. */
        public RecordingReadRequest(String name) {
            this(name, 0, 1048576);
        }

        public RecordingReadRequest withOffset(long offset) {
            return new RecordingReadRequest(name, offset, size);
        }

        public RecordingReadRequest withSize(long size) {
            return new RecordingReadRequest(name, offset, size);
        }
    }

    /** The newest first; `recorder` null: it is not running. `folder`: on the server's disk. */
    public record RecordingsReply(List<RecordingInfo> recordings, @Nil RecorderStatus recorder, String folder) {}

    /** Lists the recordings. */
    public record RecordingsRequest() {}

    /** Sets the positions of axes, by number as text [mm, deg]; nothing moves. */
    public record ReferenceRequest(Map<String, Double> positions) {}

    /**
     * Rejects a run; its client is shown the reason. An approval for a while that was given with it ends.
     * @param sha256 of the text, or at least its first 8 digits.
     * @param number as in `ArmRequest`.
     */
    public record RejectRequest(String sha256, String reason, Long number) {
        /** All that may be left out as the server has it. */
        public RejectRequest(String sha256) {
            this(sha256, "", null);
        }

        public RejectRequest withReason(String reason) {
            return new RejectRequest(sha256, reason, number);
        }

        public RejectRequest withNumber(Long number) {
            return new RejectRequest(sha256, reason, number);
        }
    }

    /** Clears a latched fault or emergency stop; axes stay de-energized until captured (G1010). */
    public record ResetRequest(List<Long> axes) {
        /** All that may be left out as the server has it. */
        public ResetRequest() {
            this(null);
        }
    }

    /** Runs whose envelope was approved for a while (`standing_s`), each with its `remaining_s`. */
    public record RunApprovalsRequest() {}

    /** The program that was started. */
    public record RunArmedReply(String program, double override) {}

    /**
     * Starts an armed program; the text is exactly that of the request.
     * @param graceS as in `OpenRequest`.
     */
    public record RunArmedRequest(String text, double graceS) {
        /** All that may be left out as the server has it. */
        public RunArmedRequest(String text) {
            this(text, 10.0);
        }

        public RunArmedRequest withGraceS(double graceS) {
            return new RunArmedRequest(text, graceS);
        }
    }

    /**
     * Simulated path of a request, sampled at equal intervals, for a picture.
     * @param timeS n moments after the start of the run [s].
     * @param positions for each axis of the request n setpoints [mm or deg].
     * @param tools paths of the tools that these axes move.
     */
    public record RunPath(List<Double> timeS, List<List<Double>> positions, List<ToolPath> tools) {}

    /**
     * A request with its text and the path of its simulation.
     * @param certifiable what `mcserver certify` signs of it, as JSON: the initial state of its simulation, and a
     *     digest of its setpoints.
     * @param warnings of its check and simulation, the first ones
     * @param unshownWarnings how many more there were.
     */
    public record RunPreviewReply(
            RunRequestStatus run, String text, RunPath path, String certifiable, @Sparse List<Diagnostic> warnings,
            @Sparse long unshownWarnings) {}

    /**
     * What an operator reviews before arming: the text and its simulated path.
     * @param sha256 of the text, or at least its first 8 digits.
     */
    public record RunPreviewRequest(String sha256) {}

    /** `ok` false: the text has faults, and nothing waits. `run`: what an operator is shown. */
    public record RunRequestReply(boolean ok, List<Diagnostic> diagnostics, @Sparse RunRequestStatus run) {}

    /**
     * Requests a run of a text. It is checked and simulated, and moves nothing.
     * @param text the program.
     * @param name for people.
     * @param axes the only axes that it may move; null: those named in the text.
     * @param certificate a file of `mcserver certify` for exactly this run, which arms it; null: a person must.
     * @param blockDelete as in `OpenRequest`, and part of what is approved; a certificate has its own.
     * @param optionalStop as in `OpenRequest`, and part of what is approved; a certificate has its own.
     */
    public record RunRequestRequest(
            String text, String name, List<Long> axes, String certificate, Boolean blockDelete, Boolean optionalStop) {
        /** All that may be left out as the server has it. */
        public RunRequestRequest(String text) {
            this(text, "", null, null, null, null);
        }

        public RunRequestRequest withName(String name) {
            return new RunRequestRequest(text, name, axes, certificate, blockDelete, optionalStop);
        }

        public RunRequestRequest withAxes(List<Long> axes) {
            return new RunRequestRequest(text, name, axes, certificate, blockDelete, optionalStop);
        }

        public RunRequestRequest withCertificate(String certificate) {
            return new RunRequestRequest(text, name, axes, certificate, blockDelete, optionalStop);
        }

        public RunRequestRequest withBlockDelete(Boolean blockDelete) {
            return new RunRequestRequest(text, name, axes, certificate, blockDelete, optionalStop);
        }

        public RunRequestRequest withOptionalStop(Boolean optionalStop) {
            return new RunRequestRequest(text, name, axes, certificate, blockDelete, optionalStop);
        }
    }

    /**
     * A request: what would move, how far, how long; `remaining_s` until it or its arming is over.
     * @param operator who armed or rejected it.
     * @param blockDelete those of the run, as in `OpenRequest`.
     * @param optionalStop those of the run, as in `OpenRequest`.
     * @param number a new one each time that the run is requested, even with the same text.
     * @param reason why it was rejected.
     * @param effects what the run leaves changed for later runs, a sentence each.
     * @param tools extents of the tools' tips.
     * @param digest SHA-256 of everything that the simulation read.
     * @param changed which of this has changed since, a sentence each; if there is any it cannot start.
     * @param approval hash of the approval for a while that has armed it; the run stays inside its envelope.
     * @param beyond what of the run is outside the envelope approved for its client, a sentence each.
     * @param servo it is approved for a while, for streamed targets, too.
     */
    public record RunRequestStatus(
            String sha256, String client, String name, RunState state, List<Long> axes, double durationS, List<Extent>
            extents, double remainingS, double override, String operator, boolean blockDelete, boolean optionalStop,
            @Sparse long number, @Sparse String reason, @Sparse List<String> effects, @Sparse List<ToolExtent> tools,
            @Sparse String digest, @Sparse List<String> changed, @Sparse String approval, @Sparse List<String> beyond,
            @Sparse boolean servo) {}

    /** The oldest first. */
    public record RunRequestsReply(List<RunRequestStatus> requests) {}

    /** Requests that wait for an operator, are armed, or were started recently. */
    public record RunRequestsRequest() {}

    /**
     * A node that answers on a bus.
     * @param node node number; on EtherCAT the position on the line.
     * @param profile number of the device profile, from 1000h.
     * @param what the same in words.
     * @param vendorId identity 1018h; null: the node did not give it.
     * @param productCode identity 1018h; null: the node did not give it.
     * @param revision identity 1018h; null: the node did not give it.
     * @param serial identity 1018h; null: the node did not give it.
     * @param modes modes of operation that 6502h lists.
     * @param axis axis of the running machine that this drive moves; null: no axis has it.
     * @param eds path of the EDS file in the machine file, or of one with this vendor and product; empty: none was
     *     found.
     * @param objects values of further objects, by keys such as `"6091:1"`: encoder (608Fh), gear (6091h), feed
     *     (6092h), rated torque (6076h [mN·m]), greatest motor speed (6080h [1/min]), travel limits (607Dh).
     */
    public record ScannedNode(
            long node, long profile, String what, @Sparse Long vendorId, @Sparse Long productCode, @Sparse Long
            revision, @Sparse Long serial, @Sparse List<String> modes, @Sparse Long axis, @Sparse String eds, @Sparse
            Map<String, Long> objects) {}

    /**
     * Values of an object in each cycle.
     * @param object index and subindex, such as `6064h:00`; empty: the values were computed.
     * @param unit unit of the values; empty: the drive's own.
     * @param values one for each cycle, float64, little endian; NaN: no value came in it.
     */
    public record ScopeSignal(String object, String name, String unit, byte[] values) {}

    /**
     * Reads an object of a drive's dictionary (CiA 301).
     * @param index of the object.
     * @param subindex of the object.
     * @param axis whose drive; or `node`, with `bus` where several buses have that number.
     * @param type how to read the bytes; null: by the drive's EDS, or the standard's objects.
     */
    public record SdoReadRequest(long index, long subindex, Long axis, Long node, String bus, SdoType type) {
        /** All that may be left out as the server has it. */
        public SdoReadRequest(long index) {
            this(index, 0, null, null, "", null);
        }

        public SdoReadRequest withSubindex(long subindex) {
            return new SdoReadRequest(index, subindex, axis, node, bus, type);
        }

        public SdoReadRequest withAxis(Long axis) {
            return new SdoReadRequest(index, subindex, axis, node, bus, type);
        }

        public SdoReadRequest withNode(Long node) {
            return new SdoReadRequest(index, subindex, axis, node, bus, type);
        }

        public SdoReadRequest withBus(String bus) {
            return new SdoReadRequest(index, subindex, axis, node, bus, type);
        }

        public SdoReadRequest withType(SdoType type) {
            return new SdoReadRequest(index, subindex, axis, node, bus, type);
        }
    }

    /**
     * Value of an object that was read or written.
     * @param node node number; on EtherCAT the position on the line.
     * @param value of the type `bytes` as hexadecimal text.
     * @param raw the transferred bytes, little endian.
     * @param fieldbus kind of the bus.
     */
    public record SdoReply(
            long axis, String bus, long node, long index, long subindex, SdoType type, Object value, byte[] raw,
            @Sparse("can") Fieldbus fieldbus) {}

    /** Writes an object; `value` may be text: a number such as `0x10`, or hexadecimal for `bytes`. */
    public record SdoWriteRequest(
            long index, long subindex, Long axis, Long node, String bus, SdoType type, Object value) {
        /** All that may be left out as the server has it. */
        public SdoWriteRequest(long index, Object value) {
            this(index, 0, null, null, "", null, value);
        }

        public SdoWriteRequest withSubindex(long subindex) {
            return new SdoWriteRequest(index, subindex, axis, node, bus, type, value);
        }

        public SdoWriteRequest withAxis(Long axis) {
            return new SdoWriteRequest(index, subindex, axis, node, bus, type, value);
        }

        public SdoWriteRequest withNode(Long node) {
            return new SdoWriteRequest(index, subindex, axis, node, bus, type, value);
        }

        public SdoWriteRequest withBus(String bus) {
            return new SdoWriteRequest(index, subindex, axis, node, bus, type, value);
        }

        public SdoWriteRequest withType(SdoType type) {
            return new SdoWriteRequest(index, subindex, axis, node, bus, type, value);
        }
    }

    /** The program that follows targets, sent as `StreamTargets` on `in/{client}/{program}`; its axes in order. */
    public record ServoReply(String program, List<Long> axes) {}

    /**
     * Leases axes for targets that the client streams, and energizes them.
     * @param axes the axes to lease, all free now; null: all of the machine.
     * @param name for people.
     * @param low lowest position that targets may command, by axis number as text [mm or deg]; only together with
     *     `high`. A machine with bodies or zones needs both: if these would not stay clear everywhere between, the
     *     program ends as faulted and nothing moves.
     * @param high highest position that targets may command, by axis number as text [mm or deg].
     */
    public record ServoRequest(List<Long> axes, String name, Map<String, Double> low, Map<String, Double> high) {
        /** All that may be left out as the server has it. */
        public ServoRequest() {
            this(null, "", null, null);
        }

        public ServoRequest withAxes(List<Long> axes) {
            return new ServoRequest(axes, name, low, high);
        }

        public ServoRequest withName(String name) {
            return new ServoRequest(axes, name, low, high);
        }

        public ServoRequest withLow(Map<String, Double> low) {
            return new ServoRequest(axes, name, low, high);
        }

        public ServoRequest withHigh(Map<String, Double> high) {
            return new ServoRequest(axes, name, low, high);
        }
    }

    /**
     * The targets of a program in servo mode, counted since it was opened.
     * @param taken messages accepted.
     * @param lost numbers that never came, or came after later ones.
     * @param late came after their validity.
     * @param doubled repeated the newest number, or had a lower one.
     * @param reordered repeated the newest number, or had a lower one.
     * @param jumped too far from the previous point, and not confirmed by the next one.
     * @param refused not finite, not of the program's axes, or a pose that the tool cannot reach.
     * @param clipped of those taken, beyond an axis's travel.
     * @param slowed of those taken, faster than a tool's axes can go.
     * @param intervalS between messages, by the sender's clock.
     * @param ageS of the newest one, beyond the quickest.
     */
    public record ServoStatus(
            long taken, long lost, long late, long doubled, long reordered, long jumped, long refused, long clipped,
            long slowed, double intervalS, double ageS) {}

    /** Sets a simulated input by its name, like `SetOutputRequest`; its script ends. */
    public record SetInputRequest(String input, double value) {}

    /** Sets an output by its name; digital: true and false, or 1 and 0. */
    public record SetOutputRequest(String output, double value) {}

    /** The value that an input or output has from the next cycle on. */
    public record SetReply(String name, double value) {}

    /**
     * Names a row of the tables, or sets how long a tool may cut; what is nil stays.
     * @param row `G54` to `G59.3`, or `T3`.
     * @param name for people; empty removes it.
     * @param lifeMin how long the tool may cut; 0: no limit.
     * @param usedMin how long it has cut, 0 when a new one is fitted.
     * @param by the person, if a client serves several.
     */
    public record SetTableRowRequest(String row, String name, Double lifeMin, Double usedMin, String by) {
        /** All that may be left out as the server has it. */
        public SetTableRowRequest(String row) {
            this(row, null, null, null, "");
        }

        public SetTableRowRequest withName(String name) {
            return new SetTableRowRequest(row, name, lifeMin, usedMin, by);
        }

        public SetTableRowRequest withLifeMin(Double lifeMin) {
            return new SetTableRowRequest(row, name, lifeMin, usedMin, by);
        }

        public SetTableRowRequest withUsedMin(Double usedMin) {
            return new SetTableRowRequest(row, name, lifeMin, usedMin, by);
        }

        public SetTableRowRequest withBy(String by) {
            return new SetTableRowRequest(row, name, lifeMin, usedMin, by);
        }
    }

    /**
     * What `mcserver simulate --json` prints.
     * @param lines those that took time, by start.
     * @param axes by number as text.
     * @param workOffsets of the systems used or set.
     * @param inputs their values at the end, by name.
     * @param outputs their values at the end, by name.
     * @param path if it was requested.
     * @param clearance of a machine that names bodies.
     * @param assertions results of those of the request, in their order.
     * @param difference to the motion of `against`.
     */
    public record SimulateReply(
            boolean ok, double durationS, double feedLengthMm, List<LineReport> lines, Map<String, AxisTravel> axes,
            List<Diagnostic> diagnostics, @Sparse List<WorkOffset> workOffsets, @Sparse Map<String, Double> inputs,
            @Sparse Map<String, Double> outputs, @Sparse SimulatedPath path, @Sparse ClearanceReport clearance, @Sparse
            List<Judged> assertions, @Sparse Difference difference) {}

    /**
     * Runs a program's text on a virtual clock and simulated drives.
     * @param positions start the axes there [mm, deg]; null: where the machine file starts simulated drives.
     * @param pathPoints maximum number of points in the reply's `path`; 0: no path.
     * @param lines whether the reply has the times of every line.
     * @param assertions are judged on every setpoint; one that does not hold is a fault (MC330).
     * @param against another program's text, from the same start: the reply has the `difference` to its motion.
     * @param role whose run it is: `agent`, one that a person approves, or `operator`, any other; zones of the
     *     other role do not count. null: all zones count.
     * @param blockDelete as of `OpenRequest`.
     * @param optionalStop as of `OpenRequest`.
     */
    public record SimulateRequest(
            String text, Map<String, Double> positions, long pathPoints, boolean lines, List<Assertion> assertions,
            String against, RunRole role, Boolean blockDelete, Boolean optionalStop) {
        /** All that may be left out as the server has it. */
        public SimulateRequest(String text) {
            this(text, null, 0, true, List.of(), null, null, null, null);
        }

        public SimulateRequest withPositions(Map<String, Double> positions) {
            return new SimulateRequest(text, positions, pathPoints, lines, assertions, against, role, blockDelete, optionalStop);
        }

        public SimulateRequest withPathPoints(long pathPoints) {
            return new SimulateRequest(text, positions, pathPoints, lines, assertions, against, role, blockDelete, optionalStop);
        }

        public SimulateRequest withLines(boolean lines) {
            return new SimulateRequest(text, positions, pathPoints, lines, assertions, against, role, blockDelete, optionalStop);
        }

        public SimulateRequest withAssertions(List<Assertion> assertions) {
            return new SimulateRequest(text, positions, pathPoints, lines, assertions, against, role, blockDelete, optionalStop);
        }

        public SimulateRequest withAgainst(String against) {
            return new SimulateRequest(text, positions, pathPoints, lines, assertions, against, role, blockDelete, optionalStop);
        }

        public SimulateRequest withRole(RunRole role) {
            return new SimulateRequest(text, positions, pathPoints, lines, assertions, against, role, blockDelete, optionalStop);
        }

        public SimulateRequest withBlockDelete(Boolean blockDelete) {
            return new SimulateRequest(text, positions, pathPoints, lines, assertions, against, role, blockDelete, optionalStop);
        }

        public SimulateRequest withOptionalStop(Boolean optionalStop) {
            return new SimulateRequest(text, positions, pathPoints, lines, assertions, against, role, blockDelete, optionalStop);
        }
    }

    /**
     * Points at equal distances along the axes' travel.
     * @param lines the program's line at each point.
     * @param tips the points of each tool.
     */
    public record SimulatedPath(List<Long> lines, List<TipPath> tips) {}

    /** The whole machine's state now: a `MachineStatus`. */
    public record StatusRequest() {}

    /** Starts the next line of a program in single-line mode. */
    public record StepRequest(String program) {}

    /**
     * Cumulative: lines through `accepted` are accepted, through `done` have ended; `credit` more fit.
     * `rejections`: how many the program has had.
     */
    public record SubmitReply(String program, long accepted, long done, long credit, @Sparse long rejections) {}

    /**
     * Lines `first`, `first + 1`, …; without `judge` the reply does not wait for the verdict. `rejections`: how
     * many the client knows of; lines from before a rejection are refused. null: unknown, the lines are taken as
     * current.
     */
    public record SubmitRequest(String program, long first, List<String> lines, boolean judge, Long rejections) {
        /** All that may be left out as the server has it. */
        public SubmitRequest(String program, long first, List<String> lines) {
            this(program, first, lines, true, null);
        }

        public SubmitRequest withJudge(boolean judge) {
            return new SubmitRequest(program, first, lines, judge, rejections);
        }

        public SubmitRequest withRejections(Long rejections) {
            return new SubmitRequest(program, first, lines, judge, rejections);
        }
    }

    /**
     * An output, or the speed or torque of an axis, that differs from its value in the program.
     * @param name of the output, or such as `axis 3`.
     * @param there value in the program before the line.
     * @param now present value.
     * @param unit of both values.
     */
    public record Switched(String name, double there, double now, @Sparse String unit) {}

    /**
     * Who changed a row of the tables; what one program does to one row in turn is one change.
     * @param wall Unix time [s].
     * @param client whose program it was.
     * @param program its id.
     * @param name of the program.
     * @param row `G54` to `G59.3`, or `T3`.
     * @param before by axis number, `R` of a turned system, or `length` and `diameter` [m, rad; in messages mm,
     *     deg]; empty: the row was not there. Or a tool's `life` and what it has `used` [s; in messages min].
     * @param after by axis number, `R` of a turned system, or `length` and `diameter` [m, rad; in messages mm,
     *     deg]; empty: the row was not there. Or a tool's `life` and what it has `used` [s; in messages min].
     * @param wasCalled its name before and after, where that was changed.
     * @param called its name before and after, where that was changed.
     */
    public record TableChange(
            double wall, String client, String program, String name, String row, Map<String, Double> before, Map<String,
            Double> after, @Sparse String wasCalled, @Sparse String called) {}

    /**
     * The tables that programs start with, and who changed them.
     * @param offsets systems that were set; the others read zero at the machine's zero.
     * @param toolTable whether the machine's programs have one, with G43 and G10 L1.
     * @param tools in the order of their numbers.
     * @param changes the newest first.
     * @param names of systems, by system.
     */
    public record Tables(
            List<WorkOffset> offsets, boolean toolTable, List<ToolRow> tools, List<TableChange> changes, @Sparse
            Map<String, String> names) {}

    /** The tables that programs start with. */
    public record TablesRequest() {}

    /** How to read `tele/batch`: its columns, its fields and the maximum of cycles in a message. */
    public record TelemetryInfo(List<Long> axes, List<String> fields, long cyclesAMessage, double stateHz) {}

    /**
     * How far apart two paths of a tip are, whatever their times.
     * @param tool null: the axes 0, 1 and 2 themselves.
     * @param apartMm the greatest distance of a point of one path from the other one.
     * @param timeS where that is.
     * @param line where that is.
     * @param other they are of the other program, whose path goes astray there.
     */
    public record TipDifference(@Nil Long tool, double apartMm, double timeS, long line, boolean other) {}

    /** Where a tool goes [mm]; `tool` null: the axes 0, 1 and 2 themselves. */
    public record TipPath(@Nil Long tool, List<List<Double>> points) {}

    /** Least and greatest X, Y and Z of a tool's tip in the base frame [mm], and its greatest speed [mm/s]. */
    public record ToolExtent(long tool, List<Double> low, List<Double> high, double speed) {}

    /**
     * One tool of G01 … Tn.
     * @param work the frame of its poses; empty: the base.
     */
    public record ToolInfo(
            long number, String frame, List<Long> axes, boolean orientation, String euler, @Sparse String work) {}

    /**
     * The jog's program, for `abort` and for keeping it alive.
     * @param obstacle which joint ends the motion, and why, for people; empty: nothing within the tool's reach, or
     *     the jog was kept alive.
     */
    public record ToolJogReply(String program, @Sparse String obstacle) {}

    /**
     * Moves a tool's tip in a straight line, by all its joints, until it is stopped or cannot continue.
     * @param tool number of the machine file.
     * @param word X Y Z to move along that axis of `frame`, A B C to turn about it with the tip at rest.
     * @param velocity of the tip [mm/s], of a turn [deg/s], signed. Near a singular position, and where a joint's
     *     limit is lower, it is slower.
     * @param frame the base, or the tool itself.
     * @param holdS dead-man timeout, as in `jog` (default 0.5 s).
     * @param program id of the running jog that this request keeps alive.
     * @param by the person, if a client serves several.
     */
    public record ToolJogRequest(
            long tool, ToolDirection word, double velocity, ToolFrame frame, Double holdS, String program, String by) {
        /** All that may be left out as the server has it. */
        public ToolJogRequest(long tool, ToolDirection word, double velocity) {
            this(tool, word, velocity, ToolFrame.BASE, null, null, "");
        }

        public ToolJogRequest withFrame(ToolFrame frame) {
            return new ToolJogRequest(tool, word, velocity, frame, holdS, program, by);
        }

        public ToolJogRequest withHoldS(Double holdS) {
            return new ToolJogRequest(tool, word, velocity, frame, holdS, program, by);
        }

        public ToolJogRequest withProgram(String program) {
            return new ToolJogRequest(tool, word, velocity, frame, holdS, program, by);
        }

        public ToolJogRequest withBy(String by) {
            return new ToolJogRequest(tool, word, velocity, frame, holdS, program, by);
        }
    }

    /** Path of a tool; `position`: lists of X, of Y and of Z at the moments of the `RunPath` [mm]. */
    public record ToolPath(long tool, List<List<Double>> position) {}

    /** Where a tool's frame is: `[x, y, z]` in mm, `[a, b, c]` in deg. */
    public record ToolPose(long number, List<Double> position, List<Double> orientation) {}

    /**
     * A line of the tool table [mm], for G43.
     * @param changed by G10 L1, so that it differs from the machine file.
     * @param lifeMin how long it may cut; 0: not set.
     * @param usedMin how long it has cut, counted in G01 to G03 while its spindle turns.
     */
    public record ToolRow(
            long number, double length, double diameter, @Sparse boolean changed, @Sparse String name, @Sparse double
            lifeMin, @Sparse double usedMin) {}

    /**
     * Gains of a control loop and its stability margins.
     * @param gains by the keys of `[axis.drive]`.
     * @param least in mode cst the least and the greatest inertia, as multiples of the measured one, with which
     *     the loop is stable; in mode csv `greatest` alone, the multiple of its gain up to which it is stable; 0:
     *     it is not stable.
     * @param greatest in mode cst the least and the greatest inertia, as multiples of the measured one, with which
     *     the loop is stable; in mode csv `greatest` alone, the multiple of its gain up to which it is stable; 0:
     *     it is not stable.
     * @param phaseDeg phase margin [deg].
     * @param crossoverHz crossover frequency [Hz] and phase margin [deg] on the measured response; null: not
     *     known.
     * @param measuredPhaseDeg crossover frequency [Hz] and phase margin [deg] on the measured response; null: not
     *     known.
     * @param measuredGain multiple of the gains up to which the loop is stable on that response; null: more than
     *     could be measured.
     */
    public record TunedLoop(
            String name, Map<String, Double> gains, double least, double greatest, double phaseDeg, @Sparse Double
            crossoverHz, @Sparse Double measuredPhaseDeg, @Sparse Double measuredGain) {}

    /**
     * One step of an approach: a move of axes, or a wait for an input.
     * @param text description for people.
     * @param targets end of the move, by axis number as text [mm, deg]; empty: no axis moves.
     * @param rapid each axis moves at its own limits; otherwise at the approach velocity.
     */
    public record WayStep(String text, @Sparse Map<String, Double> targets, @Sparse boolean rapid) {}

    /** One fault of a program, placed in its text; `line` is the client's line number. */
    public record Diagnostic(
            String code, String message, @Sparse long line, @Sparse long column, @Sparse long endColumn, @Sparse String
            hint, @Sparse("error") Severity severity, @Sparse Long tool, @Sparse Double residualMm, @Sparse Long axis,
            @Sparse Edit edit) {}

    /**
     * Withdraws a request; only the user who made it may.
     * @param sha256 of the text, or at least its first 8 digits.
     */
    public record WithdrawRequest(String sha256) {}

    /**
     * The origin of a work coordinate system.
     * @param system such as `G54`.
     * @param origin where the axes read zero, by number [mm, deg]; an axis that is omitted reads as the machine
     *     does.
     * @param rotation angle by which X and Y are turned about Z, counter-clockwise (G10 L2 R) [deg]: a single axis
     *     does not determine what they read then.
     */
    public record WorkOffset(String system, Map<String, Double> origin, @Sparse double rotation) {}

    /**
     * @param written the new text is on the disk.
     * @param before name of the file that keeps the old one; empty: none.
     * @param diagnostics errors and warnings of the new text.
     */
    public record WriteMachineFileReply(boolean written, String before, List<Diagnostic> diagnostics) {}

    /**
     * Checks a text as `mcserver machine check` does, and writes it if it has no error. The server continues with
     * the old one until it is restarted.
     * @param text all of the new file.
     * @param sha256 of the text that was edited, as `machine_file` returned it.
     * @param onlyCheck nothing is written.
     * @param by the person, if a client serves several.
     */
    public record WriteMachineFileRequest(String text, String sha256, boolean onlyCheck, String by) {
        /** All that may be left out as the server has it. */
        public WriteMachineFileRequest(String text, String sha256) {
            this(text, sha256, false, "");
        }

        public WriteMachineFileRequest withOnlyCheck(boolean onlyCheck) {
            return new WriteMachineFileRequest(text, sha256, onlyCheck, by);
        }

        public WriteMachineFileRequest withBy(String by) {
            return new WriteMachineFileRequest(text, sha256, onlyCheck, by);
        }
    }
}
