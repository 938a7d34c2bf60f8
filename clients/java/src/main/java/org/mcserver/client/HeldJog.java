package org.mcserver.client;

import java.util.Map;
import java.util.concurrent.CompletableFuture;
import java.util.concurrent.ScheduledFuture;
import java.util.concurrent.TimeUnit;
import java.time.Duration;

/**
 * A jog that goes on until it is stopped or closed: calls keep it alive; when they stop coming, the server stops the axis after the dead
 * man's time.
 */
public final class HeldJog implements AutoCloseable {
    static final double HOLD_S = 0.5;
    private static final long KEEP_MS = 150;
    private static final Duration KEEP_DEADLINE = Duration.ofMillis((long) (HOLD_S * 1000));

    private final MachineCalls machine;
    private final String program;
    private final CompletableFuture<Void> ended = new CompletableFuture<>();
    private ScheduledFuture<?> keeping;
    private boolean keepUnderWay;

    private HeldJog(MachineCalls machine, String program) {
        this.machine = machine;
        this.program = program;
    }

    static CompletableFuture<HeldJog> start(Connection connection, MachineCalls machine, String machineName, long axis, double velocity) {
        Messages.JogRequest request = new Messages.JogRequest(axis).withVelocity(velocity).withHoldS(HOLD_S);
        return machine.jog(request).thenApplyAsync(program -> {
            HeldJog jog = new HeldJog(machine, program);
            Map<String, Object> keep = Wire.params(request.withProgram(program));
            jog.keeping = connection.loop().scheduleWithFixedDelay(() -> jog.keep(connection, machineName, keep), KEEP_MS, KEEP_MS, TimeUnit.MILLISECONDS);
            return jog;
        }, connection.loop());
    }

    /** The jog's program id. */
    public String program() {
        return program;
    }

    /** Completes once the jog has ended; with an error where it ended by itself: at a limit, by an abort, with the link. */
    public CompletableFuture<Void> ended() {
        return ended.copy();
    }

    /** Stops the axis within its limits; completes once the stop is ordered. */
    public CompletableFuture<Void> stop() {
        keeping.cancel(false);
        machine.abort(program).whenComplete((done, error) -> Futures.settle(ended, null, error));
        return ended();
    }

    /** As {@link #stop}, without waiting. */
    @Override
    public void close() {
        stop();
    }

    private void keep(Connection connection, String machineName, Map<String, Object> request) {
        if (keepUnderWay || ended.isDone()) {
            return;
        }
        keepUnderWay = true;
        connection.call(machineName, "jog", request, KEEP_DEADLINE).whenCompleteAsync((reply, error) -> {
            keepUnderWay = false;
            if (error != null && !keeping.isCancelled()) {
                keeping.cancel(false);
                // it is not known whether the axis still moves
                machine.abort(program);
                ended.completeExceptionally(error);
            }
        }, connection.loop());
    }
}
