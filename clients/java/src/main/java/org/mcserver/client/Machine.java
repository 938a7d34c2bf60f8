package org.mcserver.client;

import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;
import java.util.concurrent.CompletableFuture;
import java.util.concurrent.ForkJoinPool;
import java.util.concurrent.ThreadLocalRandom;
import java.util.concurrent.atomic.AtomicInteger;
import java.util.function.BiConsumer;
import java.util.function.Predicate;

/** A machine behind a gateway. */
public final class Machine {
    private static final int STATES_LIMIT = 32;
    private static final int SAMPLES_LIMIT = 4096;
    private static final int EVENTS_LIMIT = 20_000;
    private static final int EVENTS_A_PAGE = 1000;
    /** Beyond all numbers: the answer says which event is the newest. */
    private static final long NEWEST = 1L << 52;

    private final Gateway gateway;
    private final String name;
    private volatile Messages.Info info;

    Machine(Gateway gateway, String name, Messages.Info info) {
        this.gateway = gateway;
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
        return ask("info", Map.of(), Messages.Info.class).thenApply(now -> info = now);
    }

    /** The whole machine's state now. */
    public CompletableFuture<Messages.MachineStatus> status() {
        return ask("status", Map.of(), Messages.MachineStatus.class);
    }

    /** The programs that the server knows, the newest first: running, queued, ended and interrupted. */
    public CompletableFuture<List<Messages.ProgramStatus>> programs() {
        return ask("programs", Map.of(), Messages.ProgramsReply.class).thenApply(Messages.ProgramsReply::programs);
    }

    /** The drives on CAN buses. */
    public CompletableFuture<List<Messages.DriveInfo>> drives() {
        return ask("drives", Map.of(), Messages.DrivesReply.class).thenApply(Messages.DrivesReply::drives);
    }

    /** Calls any remote method by its name (docs/wire/calls.md); repeated until it is answered, carried out once. */
    public CompletableFuture<Object> call(String method, Map<String, Object> params) {
        return gateway.call(name, method, params, Gateway.DEADLINE);
    }

    /** As {@link #call(String, Map)}, with the reply as one of the records of {@link Messages}. */
    public <T extends Record> CompletableFuture<T> ask(String method, Map<String, Object> params, Class<T> reply) {
        return call(method, params).thenApply(value -> Wire.read(reply, value));
    }

    // ---------------------------------------------------------------- programs

    /** Opens a program. */
    public CompletableFuture<Program> program(ProgramOptions options) {
        return open(options.request());
    }

    /** Goes on with an interrupted program: the lines from {@code startLine} on have to be sent. */
    public CompletableFuture<Program> resumeProgram(String program, long startLine, ProgramOptions options) {
        Map<String, Object> request = options.startingAt(startLine, List.of()).request();
        request.put("resume_of", program);
        return open(request);
    }

    private CompletableFuture<Program> open(Map<String, Object> request) {
        return ask("open", request, Messages.OpenReply.class).thenCompose(opened -> Program.follow(gateway, this, opened));
    }

    // ---------------------------------------------------------------- the operator's part

    /** Feed hold along the path, of one program or (null) all; those concerned. */
    public CompletableFuture<List<String>> hold(String program) {
        return order("hold", program);
    }

    /** Ends a hold, M00 or M01. */
    public CompletableFuture<List<String>> resume(String program) {
        return order("resume", program);
    }

    /** Stops along the path, then drops the rest. */
    public CompletableFuture<List<String>> abort(String program) {
        return order("abort", program);
    }

    CompletableFuture<List<String>> order(String method, String program) {
        Map<String, Object> request = new LinkedHashMap<>();
        request.put("program", program);
        return ask(method, request, Messages.Done.class).thenApply(Messages.Done::programs);
    }

    /** Sets the feed override of one program, or (null) of all and those to come [%]; the one now in force. */
    public CompletableFuture<Double> override(double percent, String program) {
        Map<String, Object> request = new LinkedHashMap<>();
        request.put("percent", percent);
        request.put("program", program);
        return ask("override", request, Messages.OverrideReply.class).thenApply(Messages.OverrideReply::percent);
    }

    /** Moves one axis by a distance [mm, deg]; {@code velocity} [mm/s, deg/s], null: a tenth of its limit. The jog's program id. */
    public CompletableFuture<String> jog(int axis, double distance, Double velocity) {
        if (!Double.isFinite(distance) || (velocity != null && !Double.isFinite(velocity))) {
            return notFinite();
        }
        Map<String, Object> request = new LinkedHashMap<>();
        request.put("axis", axis);
        request.put("distance", distance);
        request.put("velocity", velocity);
        return ask("jog", request, Messages.JogReply.class).thenApply(Messages.JogReply::program);
    }

    /**
     * Moves one axis on until the result is closed; {@code velocity} is signed [mm/s, deg/s]. When this program, its link or the gateway
     * dies, the server stops the axis after the dead man's time.
     */
    public CompletableFuture<HeldJog> jogHeld(int axis, double velocity) {
        return !Double.isFinite(velocity) ? notFinite() : HeldJog.start(gateway, this, axis, velocity);
    }

    /** What is no number must not reach a machine. */
    private static <T> CompletableFuture<T> notFinite() {
        return CompletableFuture.failedFuture(new MotionException.RequestRefused(
                "MC511", "a distance or velocity is no finite number", "give a number of mm or deg", Map.of(), List.of()));
    }

    /** Clears a latched fault or emergency stop, of these axes or (null) all; energy comes back with G1010 only. */
    public CompletableFuture<Void> reset(List<Integer> axes) {
        Map<String, Object> request = new LinkedHashMap<>();
        request.put("axes", axes);
        return call("reset", request).thenApply(done -> null);
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
        gateway.estop(name, reason, number).whenComplete(settle);
        gateway.another().thenCompose(other -> other.estop(name, reason, number).whenComplete((done, error) -> other.close())).whenComplete(settle);
        return confirmed;
    }

    // ---------------------------------------------------------------- without motion

    /** Every fault of a program's text. */
    public CompletableFuture<Messages.CheckReply> check(String text) {
        return gateway.call(name, "check", Map.of("text", text), Gateway.LONG_JOB)
                .thenApply(value -> Wire.read(Messages.CheckReply.class, value));
    }

    /** Runs a text on a virtual clock; the object of {@code mcserver simulate --json}. */
    public CompletableFuture<Map<?, ?>> simulate(String text) {
        return gateway.call(name, "simulate", Map.of("text", text), Gateway.LONG_JOB).thenApply(value -> (Map<?, ?>) value);
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

    private <T> CompletableFuture<Feed<T>> follow(Feed<T> feed, String topic, java.util.function.Consumer<Object> deliver) {
        return gateway.listen(name, topic, (message, missed) -> {
            feed.miss(missed);
            deliver.accept(message);
        }, () -> {}).thenApply(stop -> {
            feed.onClose(stop);
            return feed;
        });
    }

    /** Events in order and without a gap from now on; with {@code history} those that the server still has come first. */
    public CompletableFuture<Feed<Messages.Event>> events(boolean history) {
        return events(history, event -> true, event -> false);
    }

    /** Those events that are {@code wanted}, to the {@code last} one. */
    CompletableFuture<Feed<Messages.Event>> events(
            boolean history, Predicate<Messages.Event> wanted, Predicate<Messages.Event> last) {
        Feed<Messages.Event> feed = new Feed<>(EVENTS_LIMIT, ForkJoinPool.commonPool());
        CompletableFuture<Messages.EventsReply> begins = history ? CompletableFuture.completedFuture(null) : page(NEWEST, 1);
        return begins.thenCompose(newest -> {
            EventReader reader = new EventReader(feed, new EventOrder(newest), wanted, last);
            return gateway.listen(name, "events", (message, missed) -> reader.take(Wire.read(Messages.Event.class, message)), reader::fetch)
                    .thenApply(stop -> {
                        feed.onClose(stop);
                        // what came between the newest number and the subscription
                        gateway.loop().execute(reader::fetch);
                        return feed;
                    });
        });
    }

    private CompletableFuture<Messages.EventsReply> page(long since, int limit) {
        return ask("events", Map.of("since", since, "limit", limit), Messages.EventsReply.class);
    }

    /** Passes events on in order and asks for what is missing; all of it on the gateway's loop. */
    private final class EventReader {
        private final Feed<Messages.Event> feed;
        private final EventOrder order;
        private final Predicate<Messages.Event> wanted;
        private final Predicate<Messages.Event> last;
        private boolean fetching;
        private boolean again;

        EventReader(
                Feed<Messages.Event> feed, EventOrder order, Predicate<Messages.Event> wanted, Predicate<Messages.Event> last) {
            this.feed = feed;
            this.order = order;
            this.wanted = wanted;
            this.last = last;
        }

        void take(Messages.Event event) {
            passOn(order.take(event));
            if (order.gap()) {
                fetch();
            }
        }

        void fetch() {
            if (fetching) {
                again = true;
                return;
            }
            fetching = true;
            again = false;
            page(order.next(), EVENTS_A_PAGE).whenCompleteAsync(this::fetched, gateway.loop());
        }

        private void fetched(Messages.EventsReply page, Throwable error) {
            fetching = false;
            if (error != null) {
                passOn(order.giveUp());
                return;
            }
            passOn(order.fill(page));
            boolean more = !page.events().isEmpty() && page.events().get(page.events().size() - 1).seq() < page.newest();
            if (!more && order.gap()) {
                // the server has been asked and did not close it
                passOn(order.giveUp());
            }
            if (more || order.gap() || again) {
                fetch();
            }
        }

        private void passOn(List<Messages.Event> events) {
            long lost = order.takeMissed();
            if (lost > 0) {
                feed.miss(lost);
            }
            for (Messages.Event event : events) {
                if (wanted.test(event)) {
                    feed.push(event);
                    if (last.test(event)) {
                        feed.close();
                    }
                }
            }
        }
    }
}
