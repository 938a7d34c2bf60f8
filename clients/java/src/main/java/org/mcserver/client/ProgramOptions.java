package org.mcserver.client;

import java.time.Duration;
import java.util.List;

/** How a program is opened. */
public final class ProgramOptions {
    private static final int NAME_LENGTH = 200;

    private final Messages.OpenRequest request;

    private ProgramOptions(Messages.OpenRequest request) {
        this.request = request;
    }

    /** All axes, from line 1, stopped when this client goes; {@code name} is for people: a file's name. */
    public static ProgramOptions named(String name) {
        String shown = name.substring(0, name.offsetByCodePoints(0, Math.min(NAME_LENGTH, name.codePointCount(0, name.length()))));
        return new ProgramOptions(new Messages.OpenRequest().withName(shown));
    }

    /** Leases these axes only; it waits in order for axes that other programs have. */
    public ProgramOptions withAxes(Long... axes) {
        return new ProgramOptions(request.withAxes(List.of(axes)));
    }

    /** Runs what was accepted to its end when this client is gone for longer than the grace, or is closed; else it is stopped. */
    public ProgramOptions finishingOnDisconnect() {
        return new ProgramOptions(request.withOnDisconnect(Messages.OnDisconnect.FINISH));
    }

    /** Waits for this client for so long when it is away; 10 s otherwise. */
    public ProgramOptions withGrace(Duration grace) {
        return new ProgramOptions(request.withGraceS(grace.toNanos() / 1e9));
    }

    /** Begins at this line; those before it do not run: the axes go to where they end, energized, in the modal state of there. */
    public ProgramOptions startingAt(long line, List<String> before) {
        return new ProgramOptions(request.withStartLine(line).withBefore(List.copyOf(before)));
    }

    /** Begins held. */
    public ProgramOptions held() {
        return new ProgramOptions(request.withHold(true));
    }

    /** Starts a line only when {@code Program.step} asks for it. */
    public ProgramOptions stepping() {
        return new ProgramOptions(request.withStep(true));
    }

    /** Skips lines that begin with {@code /}. */
    public ProgramOptions withBlockDelete() {
        return new ProgramOptions(request.withBlockDelete(true));
    }

    /** Lets M01 pass without a pause. */
    public ProgramOptions withoutOptionalStop() {
        return new ProgramOptions(request.withOptionalStop(false));
    }

    /** Of a start in the middle: lets axes go the way that {@code continuation} shows, where the machine file names no safe one. */
    public ProgramOptions withWay() {
        return new ProgramOptions(request.withWay(true));
    }

    /** Of a start in the middle: sets what the program had switched, or leaves it. */
    public ProgramOptions withOutputs(Messages.Outputs what) {
        return new ProgramOptions(request.withOutputs(what));
    }

    Messages.OpenRequest request() {
        return request;
    }
}
