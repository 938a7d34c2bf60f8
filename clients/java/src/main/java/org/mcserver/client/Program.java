package org.mcserver.client;

import java.util.ArrayList;
import java.util.Iterator;
import java.util.List;
import java.util.Map;
import java.util.concurrent.CompletableFuture;
import java.util.concurrent.CompletionException;
import java.util.concurrent.Flow;
import java.util.concurrent.RejectedExecutionException;
import java.util.concurrent.ScheduledFuture;
import java.util.concurrent.TimeUnit;
import java.util.function.BooleanSupplier;
import java.util.function.Function;
import java.util.function.Supplier;

/**
 * One client's stream of lines, with modal state and axes of its own.
 *
 * <p>It is ended by {@link #finish}. Closed before it has ended, such as by a try block that is left by an exception, it is aborted.
 */
public final class Program implements AutoCloseable {
    private static final long FIRST_DOUBT_MS = 250;
    private static final long LONGEST_DOUBT_MS = 2000;

    /** What is waited for: a condition on the core, checked at each change. */
    private record Waiter(BooleanSupplier condition, boolean pastRejection, MotionException before, CompletableFuture<Void> reached) {}

    private final Connection connection;
    private final MachineCalls machine;
    private final String machineName;
    private final String id;
    private final List<Long> axes;
    private final long longestLine;
    /** Guards the core and the waiters. */
    private final Object lock = new Object();
    private final LineCore core;
    private final List<Waiter> waiters = new ArrayList<>();
    /** Whoever gives lines has his turn behind those before him. */
    private CompletableFuture<?> turn = CompletableFuture.completedFuture(null);
    private Runnable unsubscribe = () -> {};
    private ScheduledFuture<?> doubting;
    private long doubtMs = FIRST_DOUBT_MS;
    private boolean left;
    private long heardAt = System.nanoTime();

    private Program(Connection connection, MachineCalls machine, String machineName, long longestLine, List<Long> axes, LineCore core) {
        this.connection = connection;
        this.machine = machine;
        this.machineName = machineName;
        this.longestLine = longestLine;
        this.axes = axes;
        this.core = core;
        id = core.extent().program();
    }

    static CompletableFuture<Program> follow(
            Connection connection, MachineCalls machine, String machineName, long longestLine, List<Long> axes, LineCore core) {
        Program program = new Program(connection, machine, machineName, longestLine, axes, core);
        return connection.listen(machineName, "ack/" + program.id,
                (message, missed) -> program.hear(Wire.read(Messages.Ack.class, message)), program::query).thenApply(stop -> {
                    program.unsubscribe = stop;
                    program.act();
                    return program;
                });
    }

    /** Its id. */
    public String id() {
        return id;
    }

    /** The axes that it leases. */
    public List<Long> axes() {
        return axes;
    }

    /** As last reported: queued, running, held, paused, ending, or how it ended. */
    public Messages.ProgramState state() {
        return known(core::state);
    }

    /** Number of the last line given. */
    public long givenThrough() {
        return known(core::given);
    }

    /** Lines through this number are taken and journaled by the server. */
    public long acceptedThrough() {
        return known(core::accepted);
    }

    /** Lines through this number have ended. */
    public long doneThrough() {
        return known(core::done);
    }

    /** Lines given that have not ended yet: how far this client is ahead of the motion. */
    public long linesAhead() {
        return known(() -> Math.max(0, core.given() - core.done()));
    }

    /** How many lines beyond those accepted the server takes now. */
    public long credit() {
        return known(core::credit);
    }

    /** Throws why nothing is taken any more. */
    void checkTargets(double now, double countsS) {
        check(() -> core.checkTargets(now, countsS));
    }

    // ---------------------------------------------------------------- lines

    /**
     * Sends one line and waits for the verdict on it; it may still be waiting to move. Its number; fails with
     * {@link MotionException.ProgramRejected} where it has faults: nothing of it moves, and the program goes on living.
     */
    public CompletableFuture<Long> send(String line) {
        return inTurn(sent -> {
            String text = LineCore.checked(line, longestLine);
            check(core::begin);
            return until(() -> !core.pending(), false).thenCompose(accepted -> {
                long number;
                synchronized (lock) {
                    core.checkGiving();
                    core.checkOpen();
                    number = core.give(text);
                    core.judge(true);
                }
                return judge(number, text).whenComplete((verdict, error) -> {
                    check(() -> core.judge(false));
                    act();
                    // a line before may have been rejected, which nobody has heard of
                }).exceptionallyCompose(error -> translated(error, "MC505"));
            });
        });
    }

    private CompletableFuture<Long> judge(long number, String text) {
        Messages.SubmitRequest request =
                new Messages.SubmitRequest(id, number, List.of(text)).withRejections(core.rejections());
        return machine.submitLines(request).handle((reply, error) -> {
            synchronized (lock) {
                if (error == null) {
                    core.onReply(reply);
                } else if (Futures.cause(error) instanceof MotionException.RequestRefused refusal) {
                    MotionException meaning = core.onRefusal(refusal, number);
                    throw meaning != null ? meaning : refusal;
                } else {
                    throw new CompletionException(Futures.cause(error));
                }
                return core.accepted() >= number;
            }
        }).thenCompose(taken -> {
            if (taken) {
                return CompletableFuture.completedFuture(number);
            }
            // no credit: what is before has to be consumed first
            long before = acceptedThrough();
            return until(() -> core.credit() > 0 || core.accepted() > before, false).thenCompose(room -> judge(number, text));
        });
    }

    /** As {@link #sendLines(Iterator)}. */
    public CompletableFuture<Long> sendLines(Iterable<String> lines) {
        return sendLines(lines.iterator());
    }

    /**
     * Streams lines as fast as the server takes them, with bounded memory, read in a thread of its own; the last one's number, once all
     * are accepted. A fault of a line that is judged later comes from {@link #done} and {@link #finish}. Where the future is cancelled, or
     * {@code lines} throws, lines that have not been sent are given up; those under way may be accepted, and the next line has the number
     * behind them ({@link #givenThrough}).
     */
    public CompletableFuture<Long> sendLines(Iterator<String> lines) {
        return inTurn(sent -> feeding(sent, () -> {
            Thread reader = new Thread(() -> {
                try {
                    while (!sent.isDone() && lines.hasNext()) {
                        give(lines.next(), sent).join();
                    }
                    acceptedAll().whenComplete((last, error) -> Futures.settle(sent, last, error));
                } catch (RuntimeException error) {
                    sent.completeExceptionally(Futures.cause(error));
                }
            }, "mcclient-lines");
            reader.setDaemon(true);
            reader.start();
        }));
    }

    /** As {@link #sendLines(Iterator)}, of lines that are published. */
    public CompletableFuture<Long> sendLines(Flow.Publisher<String> lines) {
        return inTurn(sent -> feeding(sent,
                () -> lines.subscribe(new PublishedLines(line -> give(line, sent), this::acceptedAll, sent))));
    }

    /** Begins to feed lines, until {@code sent} is done; where that is an error, those that have not gone out are given up. */
    private CompletableFuture<Long> feeding(CompletableFuture<Long> sent, Runnable begin) {
        check(core::begin);
        CompletableFuture<Long> over = sent.whenComplete((last, error) -> {
            if (error != null) {
                check(core::abandon);
                act();
            }
        });
        begin.run();
        return over;
    }

    private CompletableFuture<Void> give(String line, CompletableFuture<Long> sent) {
        String text = LineCore.checked(line, longestLine);
        CompletableFuture<Void> room = until(core::hasRoom, false);
        return room.thenAccept(ready -> {
            boolean sendNow;
            synchronized (lock) {
                if (sent.isDone()) {
                    return;
                }
                core.checkGiving();
                core.give(text);
                sendNow = core.given() - core.accepted() == 1 || core.given() % 100 == 0;
            }
            if (sendNow) {
                act();
            }
        });
    }

    private CompletableFuture<Long> acceptedAll() {
        act();
        return until(() -> !core.pending(), false).thenApply(all -> {
            synchronized (lock) {
                core.checkGiving();
                return core.given();
            }
        });
    }

    // ---------------------------------------------------------------- the end

    /** Completes once the line with this number has ended; fails as {@link #done}. */
    public CompletableFuture<Void> waitDone(long number) {
        // lines after M02 or M30 are accepted and never run
        return until(() -> core.done() >= number || core.state() == Messages.ProgramState.FINISHED, false);
    }

    /** Completes once every line given so far has ended; fails with how the program ended instead. */
    public CompletableFuture<Void> done() {
        return waitDone(givenThrough()).thenRun(() -> check(core::check));
    }

    /** Says that no more lines will come; what is accepted runs to its end. Again is no error. */
    public CompletableFuture<Void> closeLines() {
        return inTurn(closed -> {
            synchronized (lock) {
                if (core.isClosed() || core.ended()) {
                    return CompletableFuture.<Void>completedFuture(null);
                }
            }
            return until(() -> !core.pending(), false).thenCompose(
                    all -> machine.closeProgram(new Messages.CloseRequest(id).withLast(acceptedThrough()))).thenCompose(reply -> {
                        check(() -> core.onClosed(reply));
                        // where it has ended the reply does not say why
                        return core.ended() ? CompletableFuture.<Void>completedFuture(null) : query();
                    }).exceptionallyCompose(error -> translated(error, "MC503", "MC504", "MC505", "MC510"))
                    .whenComplete((result, error) -> act());
        });
    }

    /** Closes the program and waits until it has ended; the number of its last line. Fails as {@link #done}, once it has ended. */
    public CompletableFuture<Long> finish() {
        return closeLines().thenApply(closed -> (MotionException) null).exceptionallyCompose(error -> {
            if (Futures.cause(error) instanceof MotionException.ProgramRejected rejection) {
                // it fails once what is before the rejected line has run
                return closeLines().thenApply(again -> rejection);
            }
            return CompletableFuture.failedFuture(Futures.cause(error));
        }).thenCompose(rejection -> until(core::ended, true).thenApply(end -> {
            unsubscribe.run();
            synchronized (lock) {
                core.check();
                if (rejection != null) {
                    throw rejection;
                }
                return core.accepted();
            }
        }));
    }

    /** Stops following the program without ending it; {@code on_disconnect} decides once this client is gone. */
    public void leave() {
        synchronized (lock) {
            left = true;
        }
        unsubscribe.run();
    }

    /** Aborts the program, unless it has ended or was left. */
    @Override
    public void close() {
        boolean over;
        synchronized (lock) {
            over = left || core.ended();
            left = true;
        }
        unsubscribe.run();
        if (!over) {
            machine.abort(id);
        }
    }

    // ---------------------------------------------------------------- the operator's part

    /** Feed hold along the path. */
    public CompletableFuture<Void> hold() {
        return machine.hold(id).thenApply(done -> null);
    }

    /** Ends a hold, M00 or M01. */
    public CompletableFuture<Void> resume() {
        return machine.resume(id).thenApply(done -> null);
    }

    /** Starts the next line of a program that was opened with {@link Messages.OpenRequest#withStep}. */
    public CompletableFuture<Void> step() {
        return machine.step(id).thenApply(done -> null);
    }

    /** Stops along the path and drops the rest; the program ends as aborted. */
    public CompletableFuture<Void> abort() {
        return machine.abort(id).thenApply(done -> null);
    }

    /** Sets the feed override of this program [%]; the one now in force. */
    public CompletableFuture<Double> override(double percent) {
        return machine.override(new Messages.OverrideRequest(percent).withProgram(id)).thenApply(Messages.OverrideReply::percent);
    }

    /** This program's events from now on; the feed ends behind {@code program.ended}. */
    public CompletableFuture<Feed<Messages.Event>> events() {
        return EventReader.open(connection, machine, machineName, false, event -> id.equals(event.program()),
                event -> event.kind() == Messages.EventKind.PROGRAM_ENDED);
    }

    // ---------------------------------------------------------------- sending and hearing

    private void hear(Messages.Ack ack) {
        synchronized (lock) {
            core.onAck(ack);
            heardAt = System.nanoTime();
            doubtMs = FIRST_DOUBT_MS;
        }
        act();
    }

    /** Sends what may be sent, completes what was waited for, and watches for a silence where something is awaited. */
    private void act() {
        LineCore.Chunk chunk;
        List<Runnable> reached = new ArrayList<>();
        synchronized (lock) {
            chunk = core.next();
            for (Iterator<Waiter> each = waiters.iterator(); each.hasNext(); ) {
                Waiter waiter = each.next();
                MotionException error = null;
                boolean over = waiter.condition().getAsBoolean();
                if (!over) {
                    try {
                        core.checkWait(waiter.pastRejection(), waiter.before());
                    } catch (MotionException failure) {
                        error = failure;
                    }
                }
                if (over || error != null) {
                    each.remove();
                    MotionException why = error;
                    reached.add(() -> Futures.settle(waiter.reached(), null, why));
                }
            }
            if (doubting != null) {
                doubting.cancel(false);
                doubting = null;
            }
            if (!left && core.inDoubt()) {
                doubting = later(this::query, doubtMs);
                doubtMs = Math.min(2 * doubtMs, LONGEST_DOUBT_MS);
            }
        }
        if (chunk != null) {
            submit(chunk);
        }
        reached.forEach(Runnable::run);
    }

    private ScheduledFuture<?> later(Runnable task, long milliseconds) {
        try {
            return connection.loop().schedule(task, milliseconds, TimeUnit.MILLISECONDS);
        } catch (RejectedExecutionException closed) {
            core.fail(Connection.closedClient());
            return null;
        }
    }

    private void submit(LineCore.Chunk chunk) {
        Messages.SubmitRequest request = new Messages.SubmitRequest(id, chunk.first(), chunk.lines())
                .withRejections(chunk.rejections()).withJudge(false);
        machine.submitLines(request).whenComplete((reply, error) -> {
            boolean unclear = false;
            synchronized (lock) {
                if (error == null) {
                    core.onReply(reply);
                    unclear = core.isLost();
                } else if (Futures.cause(error) instanceof MotionException.RequestRefused refusal) {
                    core.onRefusal(refusal, chunk.first());
                    unclear = core.isLost() || List.of("MC503", "MC504", "MC510").contains(refusal.code());
                } else {
                    core.onLost();
                    onSilence(Futures.cause(error));
                }
            }
            if (unclear) {
                query();
            } else {
                act();
            }
        });
    }

    /** Asks the server how far the program is; what it lacks will be sent again. */
    private CompletableFuture<Void> query() {
        return machine.programs(new Messages.ProgramsRequest().withProgram(id)).handle((programs, error) -> {
            synchronized (lock) {
                if (error == null) {
                    heardAt = System.nanoTime();
                    core.onStatus(programs.stream().filter(each -> each.program().equals(id)).findFirst().orElse(null));
                } else if (Futures.cause(error) instanceof MotionException.RequestRefused refusal && refusal.code().equals("MC503")) {
                    core.onStatus(null);
                } else {
                    onSilence(Futures.cause(error));
                }
            }
            act();
            return null;
        });
    }

    /** Nobody answers: that is waited out for a while, anything else is the end of it. */
    private void onSilence(Throwable error) {
        MotionException why = Futures.asMotion(error);
        boolean away = why instanceof MotionException.NobodyAnswers && !why.code().equals("MC539");
        if (!away || System.nanoTime() - heardAt > connection.patience().toNanos()) {
            core.fail(why);
        }
    }

    /** A refusal with one of these codes as what it means for the program: ended, interrupted, rejected, or itself. */
    private <T> CompletableFuture<T> translated(Throwable error, String... codes) {
        if (!(Futures.cause(error) instanceof MotionException.RequestRefused refusal) || !List.of(codes).contains(refusal.code())) {
            return CompletableFuture.failedFuture(error);
        }
        return query().thenCompose(known -> {
            check(core::check);
            return CompletableFuture.failedFuture(refusal);
        });
    }

    // ---------------------------------------------------------------- waiting

    private CompletableFuture<Void> until(BooleanSupplier condition, boolean pastRejection) {
        CompletableFuture<Void> reached = new CompletableFuture<>();
        synchronized (lock) {
            if (condition.getAsBoolean()) {
                return CompletableFuture.completedFuture(null);
            }
            waiters.add(new Waiter(condition, pastRejection, core.rejection(), reached));
        }
        act();
        return reached;
    }

    private <T> T known(Supplier<T> look) {
        synchronized (lock) {
            return look.get();
        }
    }

    private void check(Runnable checks) {
        synchronized (lock) {
            checks.run();
        }
    }

    /** Begins once those who gave lines before are through, unless what it makes has been cancelled by then. */
    private <T> CompletableFuture<T> inTurn(Function<CompletableFuture<T>, CompletableFuture<T>> begin) {
        CompletableFuture<T> made = new CompletableFuture<>();
        CompletableFuture<T> result;
        synchronized (lock) {
            result = turn.handle((before, error) -> null).thenCompose(before -> made.isDone() ? made : begin.apply(made));
            turn = result;
        }
        result.whenComplete((value, error) -> Futures.settle(made, value, error));
        return made;
    }
}
