package org.mcserver.client;

import java.util.List;
import java.util.concurrent.CompletableFuture;
import java.util.concurrent.ForkJoinPool;
import java.util.function.Predicate;

/** Passes events on in order and asks for what is missing; all of it on the connection's loop. */
final class EventReader {
    private static final int EVENTS_LIMIT = 20_000;
    private static final int EVENTS_A_PAGE = 1000;
    /** Beyond all numbers: the answer says which event is the newest. */
    private static final long NEWEST = 1L << 52;

    private final Connection connection;
    private final MachineCalls calls;
    private final Feed<Messages.Event> feed = new Feed<>(EVENTS_LIMIT, ForkJoinPool.commonPool());
    private final EventOrder order;
    private final Predicate<Messages.Event> wanted;
    private final Predicate<Messages.Event> last;
    private boolean fetching;
    private boolean again;

    private EventReader(
            Connection connection, MachineCalls calls, EventOrder order, Predicate<Messages.Event> wanted, Predicate<Messages.Event> last) {
        this.connection = connection;
        this.calls = calls;
        this.order = order;
        this.wanted = wanted;
        this.last = last;
    }

    /** Those events of a machine that are {@code wanted}, to the {@code last} one; with {@code history} those of before come first. */
    static CompletableFuture<Feed<Messages.Event>> open(
            Connection connection, MachineCalls calls, String machine, boolean history,
            Predicate<Messages.Event> wanted, Predicate<Messages.Event> last) {
        CompletableFuture<Messages.EventsReply> begins = history ? CompletableFuture.completedFuture(null) : page(calls, NEWEST, 1);
        return begins.thenCompose(newest -> {
            EventReader reader = new EventReader(connection, calls, new EventOrder(newest), wanted, last);
            return connection.listen(machine, "events", (message, missed) -> reader.take(Wire.read(Messages.Event.class, message)), reader::fetch)
                    .thenApply(stop -> {
                        reader.feed.onClose(stop);
                        // what came between the newest number and the subscription
                        connection.loop().execute(reader::fetch);
                        return reader.feed;
                    });
        });
    }

    private static CompletableFuture<Messages.EventsReply> page(MachineCalls calls, long since, int limit) {
        return calls.pastEvents(new Messages.EventsRequest().withSince(since).withLimit(limit));
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
        page(calls, order.next(), EVENTS_A_PAGE).whenCompleteAsync(this::fetched, connection.loop());
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
