package org.mcserver.client;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertThrows;

import java.util.concurrent.CompletableFuture;
import java.util.concurrent.CompletionException;
import org.junit.jupiter.api.Test;

class MachineTest {
    private static String refusal(CompletableFuture<?> call) {
        CompletionException error = assertThrows(CompletionException.class, call::join);
        return ((MotionException) error.getCause()).code();
    }

    @Test
    void whatIsNoFiniteNumberNeverReachesAMachine() {
        Machine machine = new Machine(null, "cell", null);
        assertEquals("MC511", refusal(machine.jog(new Messages.JogRequest(0).withDistance(Double.NaN))));
        assertEquals("MC511", refusal(machine.jog(new Messages.JogRequest(0).withDistance(1.0).withVelocity(Double.POSITIVE_INFINITY))));
        assertEquals("MC511", refusal(machine.jogHeld(0, Double.NEGATIVE_INFINITY)));
    }

    @Test
    void whatIsNoUrlOfAGatewayIsRefusedWithARemedy() {
        for (String url : new String[] {"", "not a url", "http://127.0.0.1:8787/", "ws:///v1/ws"}) {
            assertEquals("MC537", refusal(Gateway.connect(url, null)));
        }
        assertEquals("MC537", refusal(Gateway.connect("ws://127.0.0.1:1/v1/ws", "two words")));
    }

    @Test
    void aGatewayThatIsNotThereIsSaidAtOnce() {
        assertEquals("MC530", refusal(Gateway.connect("ws://127.0.0.1:1/v1/ws", null)));
    }
}
