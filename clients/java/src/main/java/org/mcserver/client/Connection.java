package org.mcserver.client;

import java.net.URI;
import java.net.URLEncoder;
import java.net.http.HttpClient;
import java.net.http.WebSocket;
import java.nio.ByteBuffer;
import java.nio.charset.StandardCharsets;
import java.time.Duration;
import java.util.ArrayList;
import java.util.HashMap;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;
import java.util.concurrent.CompletableFuture;
import java.util.concurrent.Executors;
import java.util.concurrent.ScheduledExecutorService;
import java.util.concurrent.ScheduledFuture;
import java.util.concurrent.RejectedExecutionException;
import java.util.concurrent.TimeUnit;
import java.util.function.BiConsumer;

/**
 * One client of a gateway (docs/gateway.md), as machines and programs use it.
 *
 * <p>A connection that breaks is made anew, for ever: calls without an answer are sent again with the same number, so that nothing is
 * done twice, and subscriptions are made again.
 */
final class Connection {
    /** Messages of targets that wait for the link at most. */
    private static final int TARGETS_UNDER_WAY = 64;
    static final Duration DEADLINE = Duration.ofSeconds(15);
    private static final Duration CONNECT = Duration.ofSeconds(10);
    /** How often a silent connection is asked for a sign of life, and after how long a silence it is given up. */
    private static final long WATCH_MS = 2000;

    private static final long SILENCE_MS = 6000;
    private static final long[] RETRY_MS = {50, 100, 200, 400, 800, 1000};

    /** What waits for a reply. */
    private record Pending(Map<String, Object> frame, CompletableFuture<Object> reply, ScheduledFuture<?> deadline) {}

    /** What a subscription delivers to; {@code onResumed} after a lost connection. */
    private record Listening(String machine, String topic, BiConsumer<Object, Long> deliver, Runnable onResumed) {}

    private final URI uri;
    private final String token;
    private final HttpClient http = HttpClient.newBuilder().connectTimeout(CONNECT).build();
    /** All state below is read and changed on this thread alone. */
    private final ScheduledExecutorService loop;

    private final CompletableFuture<Connection> ready = new CompletableFuture<>();
    private final Map<Long, Pending> pending = new LinkedHashMap<>();
    private final Map<Long, Listening> listening = new LinkedHashMap<>();
    private final Map<Long, Boolean> subscribing = new HashMap<>();
    private WebSocket socket;
    private int targetsUnderWay;
    private CompletableFuture<?> sending = CompletableFuture.completedFuture(null);
    private String session = "";
    private long numbers;
    private int retries;
    private boolean closed;
    /** Counts connections, so that what an earlier one still says is known by it. */
    private int connection;
    private long heardAt;
    private volatile String client = "";
    private volatile String role = "";

    private final Duration patience;

    private Connection(URI uri, String token, Duration patience) {
        this.uri = uri;
        this.token = token;
        this.patience = patience;
        loop = Executors.newSingleThreadScheduledExecutor(task -> {
            Thread thread = new Thread(task, "mcclient");
            thread.setDaemon(true);
            return thread;
        });
    }

    /** Connects; fails with {@link MotionException.NobodyAnswers} (MC530) where no gateway is there or the token is wrong. */
    static CompletableFuture<Connection> open(URI uri, String token, Duration patience) {
        Connection made = new Connection(uri, token, patience);
        made.loop.execute(made::open);
        made.loop.scheduleWithFixedDelay(made::watch, WATCH_MS, WATCH_MS, TimeUnit.MILLISECONDS);
        return made.ready;
    }

    String client() {
        return client;
    }

    String role() {
        return role;
    }

    void close() {
        try {
            loop.execute(this::end);
        } catch (RejectedExecutionException alreadyClosed) {
            return;
        }
        loop.shutdown();
    }

    /** Names of the machines that are there. */
    CompletableFuture<Object> machines() {
        return request(frame("machines", null), DEADLINE);
    }

    ScheduledExecutorService loop() {
        return loop;
    }

    CompletableFuture<Object> call(String machine, String method, Map<String, Object> params, Duration deadline) {
        Map<String, Object> frame = frame("call", machine);
        frame.put("method", method);
        frame.put("params", params);
        return request(frame, deadline);
    }

    Duration patience() {
        return patience;
    }

    /** A connection of its own to the same gateway. */
    CompletableFuture<Connection> another() {
        return open(uri, token, patience);
    }

    /** Emergency stop; all copies of one have the same random number, 2^32 or more. */
    CompletableFuture<Object> estop(String machine, String reason, long number) {
        Map<String, Object> frame = frame("estop", machine);
        frame.put("reason", reason);
        frame.put("request", number);
        return request(frame, DEADLINE);
    }

    /** Targets, without an answer, of which the next ones are newer; where the connection is away or full they are lost. */
    void put(String machine, String program, List<Object> targets) {
        run(new CompletableFuture<>(), () -> {
            if (socket == null || targetsUnderWay >= TARGETS_UNDER_WAY) {
                return;
            }
            Map<String, Object> frame = frame("targets", machine);
            frame.put("program", program);
            frame.put("message", targets);
            send(frame);
            targetsUnderWay++;
            sending.whenComplete((sent, error) -> onLoop(() -> targetsUnderWay--));
        });
    }

    /** Delivers each message of a topic and how many were lost before it, on the loop, until the result's runnable is called. */
    CompletableFuture<Runnable> listen(String machine, String topic, BiConsumer<Object, Long> deliver, Runnable onResumed) {
        CompletableFuture<Runnable> made = new CompletableFuture<>();
        run(made, () -> {
            long id = ++numbers;
            Map<String, Object> frame = frame("subscribe", machine);
            frame.put("topic", topic);
            frame.put("id", id);
            listening.put(id, new Listening(machine, topic, deliver, onResumed));
            subscribing.put(id, true);
            await(id, frame, DEADLINE).whenComplete((reply, error) -> {
                subscribing.remove(id);
                if (error != null) {
                    listening.remove(id);
                    made.completeExceptionally(error);
                } else {
                    made.complete(() -> run(new CompletableFuture<>(), () -> unsubscribe(id)));
                }
            });
        });
        return made;
    }

    private void unsubscribe(long id) {
        if (listening.remove(id) != null) {
            Map<String, Object> frame = frame("unsubscribe", null);
            frame.put("id", id);
            send(frame);
        }
    }

    private static Map<String, Object> frame(String operation, String machine) {
        Map<String, Object> frame = new LinkedHashMap<>();
        frame.put("op", operation);
        if (machine != null) {
            frame.put("machine", machine);
        }
        return frame;
    }

    private CompletableFuture<Object> request(Map<String, Object> frame, Duration deadline) {
        CompletableFuture<Object> reply = new CompletableFuture<>();
        run(reply, () -> {
            long id = ++numbers;
            frame.put("id", id);
            if ("call".equals(frame.get("op"))) {
                frame.put("request", id);
            }
            await(id, frame, deadline).whenComplete((value, error) -> {
                if (error != null) {
                    reply.completeExceptionally(error);
                } else {
                    reply.complete(value);
                }
            });
        });
        return reply;
    }

    /** Runs on the loop; where the client is closed the result fails. */
    private void run(CompletableFuture<?> result, Runnable task) {
        try {
            loop.execute(() -> {
                if (closed) {
                    result.completeExceptionally(closedClient());
                    return;
                }
                try {
                    task.run();
                } catch (RuntimeException error) {
                    result.completeExceptionally(error);
                }
            });
        } catch (RejectedExecutionException ended) {
            result.completeExceptionally(closedClient());
        }
    }

    static MotionException closedClient() {
        return new MotionException.NobodyAnswers("MC539", "the client is closed", "connect anew");
    }

    // ---------------------------------------------------------------- on the loop

    private CompletableFuture<Object> await(long id, Map<String, Object> frame, Duration limit) {
        CompletableFuture<Object> reply = new CompletableFuture<>();
        String what = String.valueOf(frame.getOrDefault("method", frame.get("op")));
        ScheduledFuture<?> deadline = loop.schedule(() -> {
            pending.remove(id);
            reply.completeExceptionally(new MotionException.NobodyAnswers(
                    "MC532", "no answer to " + what + " within " + limit.toSeconds() + " s", "is the gateway running?"));
        }, limit.toMillis(), TimeUnit.MILLISECONDS);
        pending.put(id, new Pending(frame, reply, deadline));
        send(frame);
        return reply;
    }

    /** A pulled cable closes nothing: who has been silent for too long is gone. */
    private void watch() {
        if (closed || socket == null) {
            return;
        }
        if (System.nanoTime() - heardAt > SILENCE_MS * 1_000_000) {
            socket.abort();
            lost(connection, "silent for " + SILENCE_MS / 1000 + " s");
        } else {
            // one that is still under way is asked for nothing new
            socket.sendPing(ByteBuffer.allocate(0)).exceptionally(error -> null);
        }
    }

    private void open() {
        int number = ++connection;
        String resumed = session.isEmpty() ? "" : "?session=" + URLEncoder.encode(session, StandardCharsets.UTF_8);
        WebSocket.Builder builder = http.newWebSocketBuilder().connectTimeout(CONNECT);
        CompletableFuture<WebSocket> opening = token.isEmpty()
                ? builder.subprotocols("mc.v1").buildAsync(URI.create(uri + resumed), listener(number))
                : builder.subprotocols("mc.v1").header("Authorization", "Bearer " + token)
                        .buildAsync(URI.create(uri + resumed), listener(number));
        opening.whenComplete((made, error) -> {
            if (error != null) {
                onLoop(() -> lost(number, String.valueOf(error.getMessage())));
            }
        });
    }

    /** Runs on the loop; nothing more does once the client is closed. */
    private void onLoop(Runnable task) {
        try {
            loop.execute(task);
        } catch (RejectedExecutionException ended) {
            // the client was closed meanwhile: nobody waits for it
            return;
        }
    }

    private void lost(int which, String reason) {
        if (closed || which != connection) {
            return;
        }
        connection++;
        socket = null;
        if (session.isEmpty()) {
            closed = true;
            ready.completeExceptionally(new MotionException.NobodyAnswers("MC530",
                    "the gateway at " + uri + " refuses the connection or is not there: " + reason, "is it running, and is the token right?"));
            loop.shutdown();
            return;
        }
        loop.schedule(() -> {
            if (!closed) {
                open();
            }
        }, RETRY_MS[Math.min(retries++, RETRY_MS.length - 1)], TimeUnit.MILLISECONDS);
    }

    private void receive(WebSocket from, int which, byte[] bytes) {
        if (which != connection) {
            return;
        }
        heardAt = System.nanoTime();
        Object decoded;
        try {
            decoded = Wire.unpack(bytes);
        } catch (MotionException error) {
            // what is no frame is dropped: what it answered is asked again or runs into its deadline
            return;
        }
        if (closed || !(decoded instanceof Map<?, ?> frame)) {
            return;
        }
        String operation = String.valueOf(frame.get("op"));
        if (operation.equals("hello")) {
            hello(from, frame);
        } else if (operation.equals("message") && frame.get("id") instanceof Long id) {
            Listening reader = listening.get(id);
            if (reader != null) {
                try {
                    reader.deliver().accept(frame.get("message"), frame.get("missed") instanceof Long missed ? missed : 0L);
                } catch (MotionException error) {
                    // a message that is not understood costs itself alone
                    return;
                }
            }
        } else if (operation.equals("reply") && frame.get("id") instanceof Long id) {
            answer(pending.remove(id), frame);
        }
    }

    private static void answer(Pending waiting, Map<?, ?> frame) {
        if (waiting == null) {
            return;
        }
        waiting.deadline().cancel(false);
        if (Boolean.TRUE.equals(frame.get("ok"))) {
            waiting.reply().complete(frame.get("value"));
            return;
        }
        try {
            Messages.ErrorReply error = Wire.read(Messages.ErrorReply.class, frame.get("error"));
            waiting.reply().completeExceptionally(List.of("MC530", "MC532").contains(error.code())
                    ? new MotionException.NobodyAnswers(error.code(), error.message(), error.hint())
                    : new MotionException.RequestRefused(error.code(), error.message(), error.hint(), error.details(), error.diagnostics()));
        } catch (MotionException notUnderstood) {
            waiting.reply().completeExceptionally(notUnderstood);
        }
    }

    private void hello(WebSocket from, Map<?, ?> frame) {
        boolean again = !session.isEmpty();
        socket = from;
        sending = CompletableFuture.completedFuture(null);
        session = String.valueOf(frame.get("session"));
        client = String.valueOf(frame.get("client"));
        role = String.valueOf(frame.get("role"));
        retries = 0;
        if (!again) {
            ready.complete(this);
            return;
        }
        listening.forEach((id, reader) -> {
            if (!subscribing.containsKey(id)) {
                Map<String, Object> subscribe = frame("subscribe", reader.machine());
                subscribe.put("topic", reader.topic());
                subscribe.put("id", id);
                send(subscribe);
            }
        });
        if (!Boolean.TRUE.equals(frame.get("resumed"))) {
            failWhatCountsByClient();
        }
        pending.values().forEach(waiting -> send(waiting.frame()));
        List.copyOf(listening.values()).forEach(reader -> reader.onResumed().run());
    }

    /** To the server this is another client now: a call that was sent before could be carried out a second time. */
    private void failWhatCountsByClient() {
        for (Map.Entry<Long, Pending> each : List.copyOf(pending.entrySet())) {
            Map<String, Object> frame = each.getValue().frame();
            if ("call".equals(frame.get("op")) && !MachineCalls.REPEATABLE.contains(String.valueOf(frame.get("method")))) {
                pending.remove(each.getKey());
                each.getValue().deadline().cancel(false);
                each.getValue().reply().completeExceptionally(new MotionException.NobodyAnswers("MC532",
                        "the connection was away for too long; " + frame.get("method") + " may have been carried out",
                        "see what the machine does, then decide"));
            }
        }
    }

    /** What is not sent now is sent by the next connection. */
    private void send(Map<String, Object> frame) {
        WebSocket current = socket;
        if (current == null) {
            return;
        }
        ByteBuffer payload = ByteBuffer.wrap(Wire.encode(frame));
        // one message at a time: the next one goes once this one is on its way; a link that is full breaks, and all is sent again
        sending = sending.thenCompose(sent -> current.sendBinary(payload, true));
        int which = connection;
        sending.exceptionally(error -> {
            onLoop(() -> lost(which, String.valueOf(error.getMessage())));
            return null;
        });
    }

    private void end() {
        if (closed) {
            return;
        }
        closed = true;
        if (socket != null) {
            socket.sendClose(WebSocket.NORMAL_CLOSURE, "").exceptionally(error -> null);
        }
        for (Pending waiting : pending.values()) {
            waiting.deadline().cancel(false);
            waiting.reply().completeExceptionally(closedClient());
        }
        pending.clear();
        listening.clear();
        ready.completeExceptionally(closedClient());
    }

    /** What one connection says, on the loop. */
    private FrameListener listener(int number) {
        return new FrameListener(new FrameListener.Events() {
            @Override
            public void frame(WebSocket from, byte[] whole) {
                onLoop(() -> receive(from, number, whole));
            }

            @Override
            public void alive() {
                onLoop(() -> heardAt = System.nanoTime());
            }

            @Override
            public void lost(String reason) {
                onLoop(() -> Connection.this.lost(number, reason));
            }
        });
    }
}
