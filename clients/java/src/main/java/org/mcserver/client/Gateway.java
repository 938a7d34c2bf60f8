package org.mcserver.client;

import java.net.URI;
import java.time.Duration;
import java.util.List;
import java.util.Map;
import java.util.concurrent.CompletableFuture;

/**
 * One client of a gateway (docs/gateway.md).
 *
 * <p>A connection that breaks is made anew, for ever: calls without an answer are sent again with the same number, so that nothing is
 * done twice, and subscriptions are made again.
 */
public final class Gateway implements AutoCloseable {
    private static final Duration PATIENCE = Duration.ofSeconds(15);

    private final Connection connection;

    private Gateway(Connection connection) {
        this.connection = connection;
    }

    /**
     * Connects; fails with {@link MotionException.NobodyAnswers} (MC530) where no gateway is there or the token is wrong.
     *
     * @param url such as {@code ws://127.0.0.1:8787/v1/ws}
     * @param token the secret token; null or empty: none, on the gateway's own computer
     */
    public static CompletableFuture<Gateway> connect(String url, String token) {
        return connect(url, token, PATIENCE);
    }

    /** As {@link #connect(String, String)}; {@code patience}: how long a program waits for a server that has gone away. */
    public static CompletableFuture<Gateway> connect(String url, String token, Duration patience) {
        URI uri;
        try {
            uri = URI.create(url);
            if (uri.getHost() == null || !List.of("ws", "wss").contains(String.valueOf(uri.getScheme()))) {
                throw new IllegalArgumentException("it has to begin with ws:// or wss:// and a host");
            }
        } catch (IllegalArgumentException error) {
            return CompletableFuture.failedFuture(new MotionException.Configuration(
                    url + " is no gateway's URL: " + error.getMessage(), "it looks like ws://127.0.0.1:8787/v1/ws"));
        }
        if (token != null && !token.matches("[\\w.~-]*")) {
            return CompletableFuture.failedFuture(
                    new MotionException.Configuration("the token has characters that no token has", "copy it as the gateway printed it"));
        }
        return Connection.open(uri, token == null ? "" : token, patience).thenApply(Gateway::new);
    }

    /** This client's id, as others see it in events. */
    public String client() {
        return connection.client();
    }

    /** Observer, operator or engineer. */
    public String role() {
        return connection.role();
    }

    /** Names of the machines that are there. */
    public CompletableFuture<List<String>> machines() {
        return connection.machines().thenApply(
                value -> value instanceof List<?> list ? list.stream().map(String::valueOf).toList() : List.of());
    }

    /** The only machine that is there; MC531 where no machine or more than one answers. */
    public CompletableFuture<Machine> machine() {
        return machines().thenCompose(names -> names.size() == 1
                ? machine(names.get(0))
                : CompletableFuture.failedFuture(new MotionException.SeveralMachines(names)));
    }

    /** The machine of this name. */
    public CompletableFuture<Machine> machine(String name) {
        return connection.call(name, "info", Map.of(), Connection.DEADLINE)
                .thenApply(info -> new Machine(connection, name, Wire.read(Messages.Info.class, info)));
    }

    /** Ends the connection; programs still open end as their {@code on_disconnect} says, without their grace. */
    @Override
    public void close() {
        connection.close();
    }
}
