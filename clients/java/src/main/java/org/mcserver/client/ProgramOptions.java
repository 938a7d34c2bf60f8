package org.mcserver.client;

import java.util.List;

/**
 * How a program is opened.
 *
 * @param name for people: a file's name
 * @param axes the axes to lease; null: all of the machine
 * @param finishOnDisconnect what was accepted runs on when this client is gone for longer than the grace, or is closed; else it is stopped
 * @param startLine the first line that runs
 * @param before the lines before it, read for their modal state only
 * @param hold begins held
 * @param step a line starts only when {@link Program#step} asks for it
 * @param way of a start in the middle: axes may go the way that {@code continuation} shows, where the machine file names no safe one
 * @param outputs of a start in the middle: {@code set} what the program had switched, or {@code leave} it; null: nothing is said
 * @param graceSeconds how long this client may be away before that
 */
public record ProgramOptions(
        String name, List<Long> axes, boolean finishOnDisconnect, long startLine, List<String> before, boolean hold, boolean step,
        boolean way, Messages.Outputs outputs, double graceSeconds) {
    private static final double GRACE_SECONDS = 10;

    /** All axes, from line 1, stopped when this client goes. */
    public static ProgramOptions named(String name) {
        return new ProgramOptions(name, null, false, 1, List.of(), false, false, false, null, GRACE_SECONDS);
    }

    /** Leases these axes only; it waits in order for axes that other programs have. */
    public ProgramOptions withAxes(Long... axes) {
        return new ProgramOptions(name, List.of(axes), finishOnDisconnect, startLine, before, hold, step, way, outputs, graceSeconds);
    }

    /** Runs what was accepted to its end when this client goes. */
    public ProgramOptions finishingOnDisconnect() {
        return new ProgramOptions(name, axes, true, startLine, before, hold, step, way, outputs, graceSeconds);
    }

    /** Waits for this client for so long when it is away. */
    public ProgramOptions withGrace(java.time.Duration grace) {
        return new ProgramOptions(name, axes, finishOnDisconnect, startLine, before, hold, step, way, outputs, grace.toNanos() / 1e9);
    }

    /** Begins at this line; those before it are read for their modal state only. */
    public ProgramOptions startingAt(long line, List<String> before) {
        return new ProgramOptions(name, axes, finishOnDisconnect, line, List.copyOf(before), hold, step, way, outputs, graceSeconds);
    }

    /** Lets axes go the way that {@code continuation} shows, where the machine file names no safe one. */
    public ProgramOptions withWay() {
        return new ProgramOptions(name, axes, finishOnDisconnect, startLine, before, hold, step, true, outputs, graceSeconds);
    }

    /** Sets what the program had switched, or leaves it. */
    public ProgramOptions withOutputs(Messages.Outputs what) {
        return new ProgramOptions(name, axes, finishOnDisconnect, startLine, before, hold, step, way, what, graceSeconds);
    }

    Messages.OpenRequest request() {
        String shown = name.substring(0, name.offsetByCodePoints(0, Math.min(200, name.codePointCount(0, name.length()))));
        return new Messages.OpenRequest().withName(shown).withAxes(axes)
                .withOnDisconnect(finishOnDisconnect ? Messages.OnDisconnect.FINISH : Messages.OnDisconnect.STOP)
                .withStartLine(startLine).withBefore(before).withHold(hold).withStep(step).withWay(way).withOutputs(outputs).withGraceS(graceSeconds);
    }
}
