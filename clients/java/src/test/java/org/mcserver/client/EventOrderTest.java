package org.mcserver.client;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertFalse;
import static org.junit.jupiter.api.Assertions.assertTrue;

import java.util.List;
import java.util.Map;
import java.util.stream.LongStream;
import org.junit.jupiter.api.Test;

class EventOrderTest {
    private static Messages.Event event(String instance, long seq) {
        return Wire.read(Messages.Event.class, Map.of("seq", seq, "t", 0.5, "instance", instance, "kind", "reset"));
    }

    private static Messages.EventsReply page(String instance, long oldest, long newest, long... numbers) {
        return new Messages.EventsReply(instance, oldest, newest, LongStream.of(numbers).mapToObj(seq -> event(instance, seq)).toList());
    }

    private static List<Long> numbers(List<Messages.Event> events) {
        return events.stream().map(Messages.Event::seq).toList();
    }

    @Test
    void eventsThatComeOutOfOrderAndTwiceArePassedOnOnceAndInOrder() {
        EventOrder order = new EventOrder(page("a", 1, 4));
        assertTrue(order.take(event("a", 7)).isEmpty());
        assertTrue(order.gap());
        assertTrue(order.take(event("a", 6)).isEmpty());
        assertEquals(List.of(5L, 6L, 7L), numbers(order.take(event("a", 5))));
        assertTrue(order.take(event("a", 6)).isEmpty());
        assertFalse(order.gap());
    }

    @Test
    void aPageClosesTheGapAndWhatTheServerNoLongerHasIsCounted() {
        EventOrder order = new EventOrder(page("a", 1, 4));
        order.take(event("a", 9));
        assertEquals(List.of(7L, 8L, 9L), numbers(order.fill(page("a", 7, 9, 7, 8, 9))));
        assertEquals(2, order.takeMissed());
        assertEquals(0, order.takeMissed());
    }

    @Test
    void aNewStartOfTheServerCountsAnewAndTheFormerOneIsNotHeardAnyMore() {
        EventOrder order = new EventOrder(page("a", 1, 40));
        assertEquals(List.of(1L, 2L), numbers(order.fill(page("b", 1, 2, 1, 2))));
        assertTrue(order.take(event("a", 41)).isEmpty());
        assertEquals(List.of(3L), numbers(order.take(event("b", 3))));
        assertEquals(0, order.takeMissed());
    }
}
