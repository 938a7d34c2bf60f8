package org.mcserver.client;

import java.util.concurrent.CompletableFuture;
import java.util.concurrent.CompletionException;

/** What a future ended with. */
final class Futures {
    private Futures() {}

    /** Ends a future as another one did. */
    static <T> void settle(CompletableFuture<T> future, T value, Throwable error) {
        if (error == null) {
            future.complete(value);
        } else {
            future.completeExceptionally(cause(error));
        }
    }

    static MotionException asMotion(Throwable error) {
        return error instanceof MotionException motion ? motion : new MotionException.Protocol(String.valueOf(error));
    }

    /** What a future failed with, out of its wrappings. */
    static Throwable cause(Throwable error) {
        Throwable inner = error;
        while (inner instanceof CompletionException && inner.getCause() != null) {
            inner = inner.getCause();
        }
        return inner;
    }
}
