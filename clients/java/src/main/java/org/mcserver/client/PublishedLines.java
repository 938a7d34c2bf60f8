package org.mcserver.client;

import java.util.concurrent.CompletableFuture;
import java.util.concurrent.Flow;
import java.util.function.Function;
import java.util.function.Supplier;

/** Gives each published line on once there is room, and asks for more then. */
final class PublishedLines implements Flow.Subscriber<String> {
    private static final int REQUEST = 256;

    private final Function<String, CompletableFuture<Void>> give;
    private final Supplier<CompletableFuture<Long>> acceptedAll;
    private final CompletableFuture<Long> sent;
    private CompletableFuture<?> given = CompletableFuture.completedFuture(null);
    private Flow.Subscription subscription;

    /** {@code sent}: the last line's number, once all are accepted. */
    PublishedLines(
            Function<String, CompletableFuture<Void>> give, Supplier<CompletableFuture<Long>> acceptedAll, CompletableFuture<Long> sent) {
        this.give = give;
        this.acceptedAll = acceptedAll;
        this.sent = sent;
    }

    @Override
    public void onSubscribe(Flow.Subscription subscription) {
        this.subscription = subscription;
        // whoever gives up wants no more of them
        sent.whenComplete((last, error) -> subscription.cancel());
        subscription.request(REQUEST);
    }

    @Override
    public void onNext(String line) {
        given = given.thenCompose(before -> give.apply(line)).whenComplete((number, error) -> {
            if (error == null) {
                subscription.request(1);
            } else {
                sent.completeExceptionally(Futures.cause(error));
            }
        });
    }

    @Override
    public void onError(Throwable error) {
        sent.completeExceptionally(error);
    }

    @Override
    public void onComplete() {
        given.thenCompose(all -> acceptedAll.get()).whenComplete((last, error) -> Futures.settle(sent, last, error));
    }
}
