package org.mcserver.client;

import java.util.ArrayDeque;
import java.util.Deque;
import java.util.Optional;
import java.util.concurrent.Executor;
import java.util.concurrent.Flow;
import java.time.Duration;

/**
 * What arrives, for one reader: {@link #take} it one by one, or {@link #subscribe} to it.
 *
 * <p>It listens from its making on, until it is closed. It is bounded: of what a reader is too slow for the oldest is lost, and
 * {@link #missed} counts it.
 */
public final class Feed<T> implements Flow.Publisher<T>, AutoCloseable {
    private final Object lock = new Object();
    private final Deque<T> items = new ArrayDeque<>();
    private final int limit;
    private final Executor executor;
    private Runnable release = () -> {};
    private boolean closed;
    private long missed;
    private Flow.Subscriber<? super T> subscriber;
    private long demand;
    private boolean delivering;

    Feed(int limit, Executor executor) {
        this.limit = limit;
        this.executor = executor;
    }

    /** Sets what ends the listening; at once where it is closed already. */
    void onClose(Runnable release) {
        boolean late;
        synchronized (lock) {
            late = closed;
            this.release = release;
        }
        if (late) {
            release.run();
        }
    }

    void push(T item) {
        synchronized (lock) {
            if (closed) {
                return;
            }
            if (items.size() >= limit) {
                items.removeFirst();
                missed++;
            }
            items.addLast(item);
            lock.notifyAll();
        }
        deliver();
    }

    void miss(long count) {
        synchronized (lock) {
            missed += count;
        }
    }

    /** Counts items that came faster than they were read, and are lost. */
    public long missed() {
        synchronized (lock) {
            return missed;
        }
    }

    /**
     * Waits for the next item; empty: none came within the time, or no more will come.
     *
     * @throws InterruptedException the thread was interrupted
     */
    public Optional<T> take(Duration limit) throws InterruptedException {
        long until = System.nanoTime() + limit.toNanos();
        synchronized (lock) {
            while (items.isEmpty() && !closed) {
                long left = (until - System.nanoTime()) / 1_000_000;
                if (left <= 0) {
                    return Optional.empty();
                }
                lock.wait(left);
            }
            return Optional.ofNullable(items.pollFirst());
        }
    }

    /** Delivers to one subscriber, as many as it asks for; a second one is refused. */
    @Override
    public void subscribe(Flow.Subscriber<? super T> subscriber) {
        boolean first;
        synchronized (lock) {
            first = this.subscriber == null;
            if (first) {
                this.subscriber = subscriber;
            }
        }
        subscriber.onSubscribe(first ? new Subscription() : new Nothing());
        if (!first) {
            subscriber.onError(new IllegalStateException("a feed has one subscriber"));
        }
    }

    /** Stops listening; a reader that waits sees the end. */
    @Override
    public void close() {
        Runnable release;
        synchronized (lock) {
            if (closed) {
                return;
            }
            closed = true;
            release = this.release;
            lock.notifyAll();
        }
        release.run();
        deliver();
    }

    private void deliver() {
        synchronized (lock) {
            if (subscriber == null || delivering) {
                return;
            }
            delivering = true;
        }
        executor.execute(this::run);
    }

    private void run() {
        while (true) {
            T item = null;
            Flow.Subscriber<? super T> reader;
            boolean end;
            synchronized (lock) {
                reader = subscriber;
                end = closed && items.isEmpty();
                if (reader != null && demand > 0 && !items.isEmpty()) {
                    demand--;
                    item = items.removeFirst();
                } else if (reader == null || !end) {
                    delivering = false;
                    return;
                } else {
                    subscriber = null;
                }
            }
            if (item == null) {
                reader.onComplete();
            } else {
                try {
                    reader.onNext(item);
                } catch (RuntimeException error) {
                    synchronized (lock) {
                        subscriber = null;
                    }
                    close();
                    reader.onError(error);
                }
            }
        }
    }

    private final class Subscription implements Flow.Subscription {
        @Override
        public void request(long count) {
            synchronized (lock) {
                demand = count > 0 ? Math.addExact(Math.min(demand, Long.MAX_VALUE - count), count) : demand;
            }
            if (count <= 0) {
                cancel();
            } else {
                deliver();
            }
        }

        @Override
        public void cancel() {
            synchronized (lock) {
                subscriber = null;
            }
            close();
        }
    }

    private static final class Nothing implements Flow.Subscription {
        @Override
        public void request(long count) {}

        @Override
        public void cancel() {}
    }
}
