package org.mcserver.client;

import com.google.gson.GsonBuilder;
import com.google.gson.FieldNamingPolicy;
import com.google.gson.Gson;
import java.io.IOException;
import java.nio.file.Files;
import java.nio.file.Path;
import java.time.Duration;
import java.util.Arrays;
import java.util.Iterator;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;
import java.util.Optional;
import java.util.concurrent.CompletableFuture;
import java.util.concurrent.CompletionException;
import java.util.concurrent.atomic.AtomicLong;
import java.util.stream.Stream;

/**
 * The conformance program: URL TOKEN stream FILE [PROGRAM] | cancel FILE | watch N | jog AXIS VELOCITY MS | estop | bench FILE; JSON on standard
 * output, one object a line.
 */
public final class Conformance {
    private static final Gson JSON = new GsonBuilder().setFieldNamingPolicy(FieldNamingPolicy.LOWER_CASE_WITH_UNDERSCORES).create();

    /** A server that is killed needs so long at most to be there again. */
    private static final Duration PATIENCE = Duration.ofMinutes(2);

    private static final int STATUS_CALLS = 300;
    private static final double BENCH_S = 3.0;

    private Conformance() {}

    public static void main(String[] arguments) throws Exception {
        int code = 0;
        try (Gateway gateway = Gateway.connect(arguments[0], arguments[1], PATIENCE).join()) {
            Machine machine = gateway.machine().join();
            switch (arguments[2]) {
                case "stream" -> stream(machine, arguments);
                case "cancel" -> cancel(machine, arguments[3]);
                case "bench" -> bench(machine, arguments[3]);
                case "watch" -> watch(machine, Long.parseLong(arguments[3]));
                case "jog" -> {
                    HeldJog jog = machine.jogHeld(Integer.parseInt(arguments[3]), Double.parseDouble(arguments[4])).join();
                    Thread.sleep(Long.parseLong(arguments[5]));
                    jog.stop().join();
                    say(Map.of("ok", true));
                }
                case "estop" -> {
                    machine.estop("conformance").join();
                    say(Map.of("state", machine.status().join().state().word()));
                }
                default -> throw new IllegalArgumentException("no such task: " + arguments[2]);
            }
        } catch (CompletionException wrapped) {
            if (!(Futures.cause(wrapped) instanceof MotionException error)) {
                throw wrapped;
            }
            complain(error);
            code = 1;
        }
        System.exit(code);
    }

    private static void say(Map<String, ?> said) {
        System.out.println(JSON.toJson(said));
    }

    private static void complain(MotionException error) {
        Map<String, Object> said = new LinkedHashMap<>();
        said.put("code", error.code());
        said.put("message", error.getMessage());
        said.put("hint", error.hint());
        said.put("diagnostics", error.diagnostics());
        if (error instanceof MotionException.OfProgram about) {
            said.put("accepted", about.accepted());
            said.put("done", about.done());
        }
        say(said);
    }

    private static void stream(Machine machine, String[] arguments) throws IOException {
        boolean goesOn = arguments.length > 4;
        try (Program program = goesOn
                        ? machine.continueProgram(new Messages.ContinueRequest(arguments[4]).withWay(true)
                                .withOnDisconnect(Messages.OnDisconnect.FINISH), Conformance::show).join()
                        : machine.program(new Messages.OpenRequest().withName(arguments[3])
                                .withOnDisconnect(Messages.OnDisconnect.FINISH)).join()) {
            say(Map.of("program", program.id()));
            List<String> lines = Files.readAllLines(Path.of(arguments[3])).stream().filter(line -> !line.isEmpty()).skip(program.givenThrough()).toList();
            if (!lines.isEmpty()) {
                program.sendLines(lines).join();
            }
            long last = program.finish().join();
            say(Map.of("state", program.state().word(), "accepted", last, "done", program.doneThrough()));
        }
    }

    private static void show(Messages.Continuation shown) {
        say(Map.of("continuation", Map.of("line", shown.line(), "done", shown.done(), "axes", shown.axes().size())));
    }

    /** Streams a file over and over, gives that up in the middle, and goes on with one line. */
    private static void cancel(Machine machine, String file) throws IOException, InterruptedException {
        List<String> lines = Files.readAllLines(Path.of(file));
        AtomicLong fed = new AtomicLong();
        Iterator<String> endless = Stream.generate(() -> lines.get((int) Math.min(fed.getAndIncrement(), lines.size() - 1))).iterator();
        try (Program program = machine.program(new Messages.OpenRequest().withName(file)).join()) {
            CompletableFuture<Long> streaming = program.sendLines(endless);
            while (program.doneThrough() < lines.size()) {
                Thread.sleep(1);
            }
            streaming.cancel(true);
            long next = program.send(lines.get(lines.size() - 1)).join();
            long before = fed.get();
            long last = program.finish().join();
            say(Map.of("next", next, "fed", before, "fed_later", fed.get() - before, "accepted", last, "done", program.doneThrough()));
        }
    }

    private static void watch(Machine machine, long rows) throws InterruptedException {
        long seen = 0;
        long gaps = 0;
        long next = -1;
        int axes = 0;
        try (Feed<Samples> feed = machine.samples().join()) {
            while (seen < rows) {
                Optional<Samples> taken = feed.take(Duration.ofSeconds(10));
                if (taken.isEmpty()) {
                    break;
                }
                Samples samples = taken.get();
                gaps += next >= 0 && next != samples.seq() ? 1 : 0;
                next = samples.seq() + samples.rows();
                seen += samples.rows();
                axes = samples.axes().size();
            }
        }
        say(Map.of("rows", seen, "gaps", gaps, "axes", axes));
    }

    private static double since(long begun) {
        return (System.nanoTime() - begun) / 1e9;
    }

    private static void bench(Machine machine, String file) throws IOException, InterruptedException {
        Map<String, Object> figures = new LinkedHashMap<>();
        try (Program program = machine.program(new Messages.OpenRequest().withName("bench")).join()) {
            List<String> lines = Files.readAllLines(Path.of(file));
            long begun = System.nanoTime();
            long count = program.sendLines(lines).join();
            figures.put("lines_per_s", count / since(begun));
            program.finish().join();
        }
        double[] latencies = new double[STATUS_CALLS];
        for (int call = 0; call < STATUS_CALLS; call++) {
            long begun = System.nanoTime();
            machine.status().join();
            latencies[call] = since(begun);
        }
        Arrays.sort(latencies);
        figures.put("status_p50_ms", 1e3 * latencies[STATUS_CALLS / 2]);
        long frames = 0;
        long rows = 0;
        long begun = System.nanoTime();
        try (Feed<Samples> feed = machine.samples().join()) {
            while (since(begun) < BENCH_S) {
                Optional<Samples> samples = feed.take(Duration.ofSeconds(1));
                frames += samples.isPresent() ? 1 : 0;
                rows += samples.map(Samples::rows).orElse(0);
            }
        }
        figures.put("frames_per_s", frames / since(begun));
        figures.put("rows_per_s", rows / since(begun));
        say(figures);
    }
}
