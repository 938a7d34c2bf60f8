package org.mcserver.client;

import java.lang.annotation.ElementType;
import java.lang.annotation.Retention;
import java.lang.annotation.RetentionPolicy;
import java.lang.annotation.Target;
import java.util.List;
import java.util.Map;

/**
 * The messages of the key space, as plain values (docs/keyspace.md): positions in mm or deg, velocities in mm/s or deg/s, torques in
 * N·m, times in seconds since the executor's start, percentages in %. What may be left out and has no value is null.
 */
public final class Messages {
    private Messages() {}

    /** The field may be left out: then it is 0, false or empty (a boxed number, a record or "null": null), or this. */
    @Retention(RetentionPolicy.RUNTIME)
    @Target(ElementType.RECORD_COMPONENT)
    @interface Sparse {
        String value() default "";
    }

    /** A certain remedy: characters {@code column} to {@code endColumn} of the line become {@code text}. */
    public record Edit(long column, long endColumn, String text) {}

    /** One fault of a program, placed in its text; columns are code points from 1, the end exclusive. */
    public record Diagnostic(
            String code, String message, @Sparse long line, @Sparse long column, @Sparse long endColumn, @Sparse String hint,
            @Sparse("error") String severity, @Sparse Long tool, @Sparse Double residualMm, @Sparse Long axis, @Sparse Edit edit) {}

    /** What stopped motion; axis and line where they apply. */
    public record Fault(
            String code, String message, @Sparse String hint, @Sparse Long axis, @Sparse long line, @Sparse("null") String program,
            @Sparse double t) {}

    /**
     * Cumulative acknowledgement of a program's lines: the last one counts. {@code rejections} of lines so far: one with a smaller count is
     * older.
     */
    public record Ack(
            String program, long accepted, long done, long credit, String state, @Sparse long rejected,
            @Sparse List<Diagnostic> diagnostics, @Sparse Fault fault, @Sparse long expected, @Sparse long rejections) {}

    /** One program as the server knows it. */
    public record ProgramStatus(
            String program, String state, @Sparse String client, @Sparse String name, @Sparse List<Long> axes,
            @Sparse("1") long startLine, @Sparse long line, @Sparse long accepted, @Sparse long done, @Sparse long credit,
            @Sparse boolean closed, @Sparse("100") double override, @Sparse double progress, @Sparse double openedAt,
            @Sparse Double etaS, @Sparse Fault fault, @Sparse long rejected, @Sparse List<Diagnostic> diagnostics,
            @Sparse("null") String resumeOf, @Sparse Double endedAt, @Sparse long rejections) {}

    /** All axes, column-wise: each list has one entry for each of {@code index}. */
    public record AxesStatus(
            List<Long> index, List<Double> position, List<Double> setpoint, List<Double> velocity, List<Double> torque,
            List<String> state, @Sparse List<Boolean> homed) {}

    /** Where the encoders say that a tool's frame is: x y z [mm], a b c [deg]. */
    public record ToolPose(long number, List<Double> position, List<Double> orientation) {}

    /** The whole machine; {@code state} is ready, fault or estop, the latter two latched until reset. */
    public record MachineStatus(
            double t, double wall, String instance, String state, AxesStatus axes, @Sparse List<ProgramStatus> programs,
            @Sparse List<Fault> faults,
            @Sparse("100") double override, @Sparse long lateCycles, @Sparse List<ToolPose> tools, @Sparse List<InputStatus> inputs,
            @Sparse List<OutputStatus> outputs, @Sparse ProbeStatus probe, @Sparse List<WorkOffset> workOffsets,
            @Sparse DiskStatus disk) {}

    /** How slow the disk under the journal is, since a Unix time [s]; null in a status: it keeps up. */
    public record DiskStatus(double since, double commitS, double syncS, double worstS) {}

    /** The origin of a work coordinate system such as G54, by axis number [mm, deg]. */
    public record WorkOffset(String system, Map<String, Double> origin) {}

    /** An input: its value (digital: 0, 1), and whether it holds the programs or stops the machine now. */
    public record InputStatus(String name, double value, @Sparse boolean holds, @Sparse boolean stops) {}

    /** An output: its value (digital: 0, 1), and who has set it last: a program's id, operator or nobody (empty). */
    public record OutputStatus(String name, double value, @Sparse String setBy) {}

    /** Time of one line that has ended. */
    public record LineReport(
            long line, double startS, double endS, @Sparse Double requestedS, @Sparse Double stretchedBy, @Sparse("null") String boundBy) {}

    /** One event; {@code kind} says which fields are set (docs/wire/events.md). */
    public record Event(
            long seq, double t, String instance, String kind, @Sparse("null") String program, @Sparse("null") String client,
            @Sparse("null") String state,
            @Sparse long line, @Sparse List<LineReport> lines, @Sparse Fault fault, @Sparse List<Diagnostic> diagnostics,
            @Sparse String reason, @Sparse String message, @Sparse Double percent, @Sparse Long axis, @Sparse ProbeStatus probe, @Sparse double wall) {}

    /** The last probing move that has ended (G38.2 to G38.5): where the axes were when the probe changed, else at the end, by number. */
    public record ProbeStatus(String program, long line, boolean tripped, Map<String, Double> positions, double t) {}

    /** One axis; limits in mm or deg and seconds, null where not limited. */
    public record AxisInfo(
            long index, String type, String unit, double maxVelocity, double maxAcceleration, String drive, @Sparse Double maxJerk,
            @Sparse Double minPosition, @Sparse Double maxPosition, @Sparse double inPosition, @Sparse("null") String homing) {}

    /** One tool of G01 … Tn. */
    public record ToolInfo(long number, String frame, List<Long> axes, boolean orientation, String euler) {}

    /** Columns and fields of the samples. */
    public record TelemetryInfo(List<Long> axes, List<String> fields, long cyclesAMessage, double stateHz) {}

    /** Bounds of the service. */
    public record LimitsInfo(
            long maxLineLength, long maxLinesAMessage, long queueLines, long programsAtOnce, long openPrograms, long rememberedAnswers,
            double rememberedAnswerS) {}

    /** The machine and the service. */
    public record Info(
            String machine, String server, List<Long> protocol, String instance, double epoch, double cycleS, List<AxisInfo> axes,
            List<ToolInfo> tools, TelemetryInfo telemetry, LimitsInfo limits, List<String> methods,
            @Sparse List<InputInfo> inputs, @Sparse List<OutputInfo> outputs) {}

    /** One input: its number of its kind (digital, analog), where a real one comes from (empty: simulated), what it can do. */
    public record InputInfo(
            String name, long number, String kind, @Sparse String unit, @Sparse String source, @Sparse boolean hold,
            @Sparse boolean stop) {}

    /** One output: where a real one goes (empty: simulated), its range, its value once what has set it is lost (null: it stays). */
    public record OutputInfo(
            String name, long number, String kind, @Sparse String unit, @Sparse String target, @Sparse double min,
            @Sparse("1") double max, @Sparse Double safe) {}

    /** Every fault of a text; {@code ok}: there is no error among them. */
    public record CheckReply(boolean ok, List<Diagnostic> diagnostics) {}

    /** Events again, by number; {@code oldest} is the first that the server still has. */
    public record EventsReply(String instance, long oldest, long newest, List<Event> events) {}

    /** Reply of {@code open}. */
    public record OpenReply(String program, String state, List<Long> axes, long expected, long credit, String instance) {}

    /** Reply of {@code submit}, cumulative as {@link Ack}. */
    public record SubmitReply(String program, long accepted, long done, long credit, @Sparse long rejections) {}

    /** Reply of {@code close}. */
    public record CloseReply(String program, long accepted, long done, String state) {}

    /** Reply of what only does something: the programs concerned. */
    public record Done(@Sparse("true") boolean ok, @Sparse List<String> programs) {}

    /** Reply of {@code override}: now in force [%]. */
    public record OverrideReply(double percent, List<String> programs) {}

    /** Reply of {@code jog}: the jog's program id. */
    public record JogReply(String program) {}

    /** Reply of {@code programs}, the newest first. */
    public record ProgramsReply(List<ProgramStatus> programs) {}

    /** Payload of an error reply. */
    public record ErrorReply(
            String code, String message, @Sparse String hint, @Sparse Map<String, Object> details, @Sparse List<Diagnostic> diagnostics) {}

    /** What the machine file shows of a drive; no value: none has come lately. */
    public record MonitoredValue(String name, @Sparse Object value, @Sparse long index, @Sparse long subindex) {}

    /** One drive on a CAN bus; ages are in seconds. */
    public record DriveInfo(
            long axis, String kind, String bus, long node, String state, @Sparse String nmt, @Sparse Double heartbeatAgeS,
            @Sparse Long statusword, @Sparse String status, @Sparse Long deviceType, @Sparse Long vendorId, @Sparse Long productCode,
            @Sparse String emergency, @Sparse Long emergencyCode, @Sparse Double emergencyAgeS, @Sparse long bootUps,
            @Sparse String message, @Sparse List<MonitoredValue> monitor) {}

    /** Reply of {@code drives}, by axis. */
    public record DrivesReply(List<DriveInfo> drives) {}

    /** Reply of {@code sdo_read} and {@code sdo_write}. */
    public record SdoReply(long axis, String bus, long node, long index, long subindex, String type, Object value, byte[] raw) {}

    /** What an axis moves through in a run that was asked for [mm, deg]. */
    public record Extent(long axis, double low, double high, String unit) {}

    /** A run that waits for an operator, is armed, or was started (docs/wire/arming.md). */
    public record RunRequestStatus(
            String sha256, String client, String name, String state, List<Long> axes, double durationS, List<Extent> extents,
            double remainingS, double override, String operator, @Sparse long number) {}

    /** Where a tool is at the moments of a path: X, Y and Z, a value a moment [mm]. */
    public record ToolPath(long tool, List<List<Double>> position) {}

    /** The simulated path of a request: moments [s], and for each of its axes a setpoint a moment [mm, deg]. */
    public record RunPath(List<Double> timeS, List<List<Double>> positions, List<ToolPath> tools) {}

    /** Reply of {@code run_preview}: what an operator looks at before arming. */
    public record RunPreviewReply(RunRequestStatus run, String text, RunPath path) {}

    /** Reply of {@code request_run}; no run for a text with faults. */
    public record RunRequestReply(boolean ok, List<Diagnostic> diagnostics, @Sparse RunRequestStatus run) {}

    /** Reply of {@code run_requests}, the oldest first. */
    public record RunRequestsReply(List<RunRequestStatus> requests) {}

    /** Reply of {@code run_armed}. */
    public record RunArmedReply(String program, double override) {}

    /** Payload of {@code samples}, an array. */
    record TelemetryBlock(long seq, double t, byte[] rows) {}
}
