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
import java.util.function.Predicate;

/** A machine behind a gateway. */
public final class Machine extends MachineCalls {
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
        return askInfo().thenApply(now -> info = now);
    }

    /** Calls any remote method by its name (docs/wire/calls.md); repeated until it is answered, carried out once. */
    public CompletableFuture<Object> call(String method, Map<String, Object> params) {
        for (Object value : params.values()) {
            if (value instanceof Double number && !Double.isFinite(number)) {
                return notFinite();
            }
        }
        Duration limit = MachineCalls.DEADLINES.getOrDefault(method, Gateway.DEADLINE);
        return gateway.call(name, method, params, limit.compareTo(Gateway.DEADLINE) > 0 ? limit : Gateway.DEADLINE);
    }

    /** As {@link #call(String, Map)}, with the reply as one of the records of {@link Messages}. */
    @Override
    public <T extends Record> CompletableFuture<T> ask(String method, Map<String, Object> params, Class<T> reply) {
        return call(method, params).thenApply(value -> Wire.read(reply, value));
    }

    // ---------------------------------------------------------------- programs

    /** Opens a program. */
    public CompletableFuture<Program> program(ProgramOptions options) {
        return openProgram(options.request()).thenCompose(opened -> Program.follow(gateway, this, opened.axes(), new LineCore(opened)));
    }

    /** As {@link #continueProgram(Messages.ContinueRequest, Consumer)}, without showing anything. */
    public CompletableFuture<Program> continueProgram(Messages.ContinueRequest request) {
        return openContinuation(request).thenCompose(opened -> Program.follow(gateway, this, opened.axes(), new LineCore(opened)));
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

    // ---------------------------------------------------------------- the operator's part

    /**
     * Moves one axis on until the result is closed; {@code velocity} is signed [mm/s, deg/s]. When this program, its link or the gateway
     * dies, the server stops the axis after the dead man's time.
     */
    public CompletableFuture<HeldJog> jogHeld(long axis, double velocity) {
        return !Double.isFinite(velocity) ? notFinite() : HeldJog.start(gateway, this, axis, velocity);
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
        gateway.estop(name, reason, number).whenComplete(settle);
        gateway.another().thenCompose(other -> other.estop(name, reason, number).whenComplete((done, error) -> other.close())).whenComplete(settle);
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
        return pastEvents(new Messages.EventsRequest().withSince(since).withLimit(limit));
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
