package org.mcserver.client;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertTrue;

import java.time.Duration;
import java.util.ArrayList;
import java.util.List;
import java.util.Optional;
import java.util.concurrent.Flow;
import org.junit.jupiter.api.Test;

class FeedTest {
    @Test
    void aSlowReaderGetsTheNewestAndTheCountOfWhatItLost() throws InterruptedException {
        List<String> released = new ArrayList<>();
        Feed<Integer> feed = new Feed<>(3, Runnable::run);
        feed.onClose(() -> released.add("released"));
        for (int item = 0; item < 10; item++) {
            feed.push(item);
        }
        feed.close();
        feed.push(99);
        for (int item = 7; item < 10; item++) {
            assertEquals(Optional.of(item), feed.take(Duration.ZERO));
        }
        assertEquals(Optional.empty(), feed.take(Duration.ofSeconds(10)));
        assertEquals(7, feed.missed());
        assertEquals(List.of("released"), released);
    }

    @Test
    void aSubscriberGetsNoMoreThanItAsksForAndThenTheEnd() {
        Feed<Integer> feed = new Feed<>(10, Runnable::run);
        List<Object> got = new ArrayList<>();
        Flow.Subscription[] subscription = new Flow.Subscription[1];
        feed.subscribe(new Flow.Subscriber<>() {
            @Override
            public void onSubscribe(Flow.Subscription made) {
                subscription[0] = made;
            }

            @Override
            public void onNext(Integer item) {
                got.add(item);
            }

            @Override
            public void onError(Throwable error) {
                got.add(error);
            }

            @Override
            public void onComplete() {
                got.add("end");
            }
        });
        feed.push(1);
        feed.push(2);
        assertTrue(got.isEmpty());
        subscription[0].request(1);
        assertEquals(List.of(1), got);
        feed.close();
        subscription[0].request(5);
        assertEquals(List.of(1, 2, "end"), got);
    }
}
