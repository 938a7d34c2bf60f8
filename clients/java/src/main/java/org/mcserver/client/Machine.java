package org.mcserver.client;

import java.time.Duration;
import java.util.List;
import java.util.Map;
import java.util.concurrent.CompletableFuture;
import java.util.concurrent.ForkJoinPool;
import java.util.concurrent.ThreadLocalRandom;
import java.util.concurrent.atomic.AtomicInteger;
import java.util.function.BiConsumer;
import java.util.function.Consumer;

/** A machine behind a gateway. */
public final class Machine extends MachineCalls {
    private static final int STATES_LIMIT = 32;
    private static final int SAMPLES_LIMIT = 4096;
    private static final double COUNTS_S = 0.1;

    private final Connection connection;
    private final String name;
    private volatile Messages.Info info;

    Machine(Connection connection, String name, Messages.Info info) {
        this.connection = connection;
        this.name = name;
        this.info = info;
    }

    /** Its name. */
    public String name() {
        return name;
    }

    /** Axes, limits, tools, units; as of the connection or the last {@link #refreshInfo}. */
    public Messages.Info info() {
        return info;
    }

    /** Asks again, such as after the server was started anew. */
    public CompletableFuture<Messages.Info> refreshInfo() {
        return askInfo().thenApply(now -> info = now);
    }

    /** Calls any remote method by its name (docs/wire/calls.md); repeated until it is answered, carried out once. */
    public CompletableFuture<Object> call(String method, Map<String, Object> params) {
        for (Object value : params.values()) {
            if (value instanceof Double number && !Double.isFinite(number)) {
                return notFinite();
            }
        }
        Duration limit = MachineCalls.DEADLINES.getOrDefault(method, Connection.DEADLINE);
        return connection.call(name, method, params, limit.compareTo(Connection.DEADLINE) > 0 ? limit : Connection.DEADLINE);
    }

    /** As {@link #call(String, Map)}, with the reply as one of the records of {@link Messages}. */
    @Override
    public <T extends Record> CompletableFuture<T> ask(String method, Map<String, Object> params, Class<T> reply) {
        return call(method, params).thenApply(value -> Wire.read(reply, value));
    }

    // ---------------------------------------------------------------- programs

    /** Opens a program; the plain request leases all axes, and stops it when this client goes. */
    public CompletableFuture<Program> program(Messages.OpenRequest request) {
        return openProgram(request).thenCompose(opened -> follow(opened.axes(), new LineCore(opened)));
    }

    /** As {@link #continueProgram(Messages.ContinueRequest, Consumer)}, without showing anything. */
    public CompletableFuture<Program> continueProgram(Messages.ContinueRequest request) {
        return openContinuation(request).thenCompose(opened -> follow(opened.axes(), new LineCore(opened)));
    }

    /**
     * Goes on with a program that has ended, such as by a restart of the server: energizes what it had, brings the axes to where its next
     * line starts, and runs the lines that the journal has. Where its text was not whole, lines behind {@link Program#givenThrough} have to
     * be sent. What is not certain is refused (MC450, MC592, MC593, MC594), and nothing moves.
     *
     * @param show gets what ran, where the axes stand and where the program has them, before anything moves; where it throws, nothing does
     */
    public CompletableFuture<Program> continueProgram(Messages.ContinueRequest request, Consumer<Messages.Continuation> show) {
        return continuation(new Messages.ContinuationRequest().withProgram(request.program()).withLine(request.line()))
                .thenAccept(show).thenCompose(shown -> continueProgram(request));
    }

    /** As {@link #servo(Messages.ServoRequest, double)}, where each message counts for 0.1 s. */
    public CompletableFuture<Servo> servo(Messages.ServoRequest request) {
        return servo(request, COUNTS_S);
    }

    /**
     * Leases axes, energizes them and lets them follow targets that are streamed; fails with MC512 where one of them is leased.
     *
     * @param countsS how long each message counts, up to 10 s: without a newer one by then the axes stop, and the program ends
     */
    public CompletableFuture<Servo> servo(Messages.ServoRequest request, double countsS) {
        return Servo.open(connection, this, name, request, countsS);
    }

    private CompletableFuture<Program> follow(List<Long> axes, LineCore core) {
        return Program.follow(connection, this, name, info.limits().maxLineLength(), axes, core);
    }

    // ---------------------------------------------------------------- the operator's part

    /**
     * Moves one axis on until the result is closed; {@code velocity} is signed [mm/s, deg/s]. When this program, its link or the gateway
     * dies, the server stops the axis after the dead man's time.
     */
    public CompletableFuture<HeldJog> jogHeld(long axis, double velocity) {
        return !Double.isFinite(velocity) ? notFinite() : HeldJog.start(connection, this, name, axis, velocity);
    }

    /** What is no number must not reach a machine. */
    private static <T> CompletableFuture<T> notFinite() {
        return CompletableFuture.failedFuture(new MotionException.RequestRefused(
                "MC511", "a distance or velocity is no finite number", "give a number of mm or deg", Map.of(), List.of()));
    }

    /**
     * Emergency stop: at once on this connection, and on one of its own as soon as that is open, so that no queue is before it; completes
     * once the server has confirmed either. No safety function: machines need a circuit of their own.
     */
    public CompletableFuture<Void> estop(String reason) {
        CompletableFuture<Void> confirmed = new CompletableFuture<>();
        AtomicInteger left = new AtomicInteger(2);
        BiConsumer<Object, Throwable> settle = (done, error) -> {
            if (error == null) {
                confirmed.complete(null);
            } else if (left.decrementAndGet() == 0) {
                confirmed.completeExceptionally(Futures.cause(error));
            }
        };
        long number = ThreadLocalRandom.current().nextLong(1L << 32, 1L << 53);
        connection.estop(name, reason, number).whenComplete(settle);
        connection.another().thenCompose(other -> other.estop(name, reason, number).whenComplete((done, error) -> other.close())).whenComplete(settle);
        return confirmed;
    }

    // ---------------------------------------------------------------- what it says

    /** The whole machine some 20 times a second; a slow reader gets the newest states. */
    public CompletableFuture<Feed<Messages.MachineStatus>> telemetry() {
        Feed<Messages.MachineStatus> feed = new Feed<>(STATES_LIMIT, ForkJoinPool.commonPool());
        return follow(feed, "state", message -> feed.push(Wire.read(Messages.MachineStatus.class, message)));
    }

    /** Every cycle of every axis, some cycles at a time. */
    public CompletableFuture<Feed<Samples>> samples() {
        Feed<Samples> feed = new Feed<>(SAMPLES_LIMIT, ForkJoinPool.commonPool());
        return follow(feed, "samples", message -> {
            Messages.Info now = info;
            feed.push(Samples.of(Wire.block(message), now.telemetry(), now.cycleS()));
        });
    }

    private <T> CompletableFuture<Feed<T>> follow(Feed<T> feed, String topic, Consumer<Object> deliver) {
        return connection.listen(name, topic, (message, missed) -> {
            feed.miss(missed);
            deliver.accept(message);
        }, () -> {}).thenApply(stop -> {
            feed.onClose(stop);
            return feed;
        });
    }

    /** Events in order and without a gap from now on; with {@code history} those that the server still has come first. */
    public CompletableFuture<Feed<Messages.Event>> events(boolean history) {
        return EventReader.open(connection, this, name, history, event -> true, event -> false);
    }
}
