package org.mcserver.client;

import java.util.ArrayList;
import java.util.List;
import java.util.TreeMap;

/** Puts events in order: a state machine without I/O. */
final class EventOrder {
    private static final int WAITING_LIMIT = 5000;

    private final TreeMap<Long, Messages.Event> waiting = new TreeMap<>();
    private String instance;
    private String former;
    private long next;
    private long missed;

    /** Begins behind the newest event of this page; null: with the oldest that the server still has. */
    EventOrder(Messages.EventsReply page) {
        if (page != null) {
            instance = page.instance();
            next = page.newest() + 1;
        }
    }

    /** The next number that is expected. */
    long next() {
        return next;
    }

    /** Something is missing before what has come. */
    boolean gap() {
        return !waiting.isEmpty();
    }

    /** Events lost for good since the last time. */
    long takeMissed() {
        long count = missed;
        missed = 0;
        return count;
    }

    /** What may be passed on now that this event has come. */
    List<Messages.Event> take(Messages.Event event) {
        if (!turnTo(event.instance())) {
            return List.of();
        }
        if (event.seq() >= next && waiting.size() < WAITING_LIMIT) {
            waiting.put(event.seq(), event);
        }
        return inOrder();
    }

    /** What may be passed on now that the server has said its events again. */
    List<Messages.Event> fill(Messages.EventsReply page) {
        if (!turnTo(page.instance())) {
            return List.of();
        }
        if (page.oldest() > next) {
            // the server no longer has them; the first start of a count is no loss
            missed += next > 0 ? page.oldest() - next : 0;
            next = page.oldest();
        }
        for (Messages.Event event : page.events()) {
            if (event.seq() >= next && event.instance().equals(page.instance())) {
                waiting.put(event.seq(), event);
            }
        }
        return inOrder();
    }

    /** The gap cannot be closed: goes on behind it. */
    List<Messages.Event> giveUp() {
        if (!waiting.isEmpty()) {
            missed += waiting.firstKey() - next;
            next = waiting.firstKey();
        }
        return inOrder();
    }

    /** A new start of the server counts from its own beginning; false: it is a former one. */
    private boolean turnTo(String now) {
        if (now.equals(former)) {
            return false;
        }
        if (!now.equals(instance)) {
            if (instance != null) {
                next = 0;
                waiting.clear();
            }
            former = instance;
            instance = now;
        }
        return true;
    }

    private List<Messages.Event> inOrder() {
        List<Messages.Event> ready = new ArrayList<>();
        for (Messages.Event event = waiting.remove(next); event != null; event = waiting.remove(next)) {
            ready.add(event);
            next++;
        }
        return ready;
    }
}
