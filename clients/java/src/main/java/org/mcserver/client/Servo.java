package org.mcserver.client;

import java.util.List;
import java.util.concurrent.CompletableFuture;

/**
 * Axes that follow what is sent (docs/servo.md).
 *
 * <p>It is ended by {@link #finish}. Closed before, such as by a try block that is left by an exception, the axes stop at once.
 */
public final class Servo implements AutoCloseable {
    private final Connection connection;
    private final MachineCalls machine;
    private final String machineName;
    private final Program program;
    private final double countsS;
    private final long begun = System.nanoTime();
    private long seq;

    private Servo(Connection connection, MachineCalls machine, String machineName, Program program, double countsS) {
        this.connection = connection;
        this.machine = machine;
        this.machineName = machineName;
        this.program = program;
        this.countsS = countsS;
    }

    static CompletableFuture<Servo> open(Connection connection, MachineCalls machine, String machineName, Messages.ServoRequest request, double countsS) {
        return machine.openServo(request)
                .thenCompose(opened -> Program.follow(connection, machine, machineName, 0, opened.axes(), core(opened)))
                .thenApply(program -> new Servo(connection, machine, machineName, program, countsS));
    }

    /** What is known of a program that gets no lines. */
    static LineCore core(Messages.ServoReply opened) {
        return new LineCore(new Messages.OpenReply(opened.program(), Messages.ProgramState.RUNNING, opened.axes(), 1, 0, ""));
    }

    /** Of the program that follows. */
    public String id() {
        return program.id();
    }

    /** The axes that follow; rows of targets have a number for each, in this order. */
    public List<Long> axes() {
        return program.axes();
    }

    /** As last reported. */
    public Messages.ProgramState state() {
        return program.state();
    }

    /**
     * Sends targets, which replace those before, and waits for nothing: what a connection that is away would take is lost, for the next ones
     * are newer.
     *
     * @throws MotionException.ProgramAborted nothing came in time, or somebody stopped it
     * @throws MotionException.ProgramFaulted a fault of the machine ended it
     * @throws MotionException.ProgramClosed it has finished, or is closed
     * @throws MotionException.NobodyAnswers the server has not answered for as long as targets count, and 0.5 s (MC530)
     */
    public synchronized void send(Targets targets) {
        double now = (System.nanoTime() - begun) / 1e9;
        program.checkTargets(now, targets.countsS() == null ? countsS : targets.countsS());
        connection.put(machineName, program.id(), targets.message(++seq, now, countsS));
    }

    /** The program; {@code servo} of it counts what was late, lost or dropped. */
    public CompletableFuture<Messages.ProgramStatus> status() {
        return machine.programs(new Messages.ProgramsRequest().withProgram(id())).thenApply(found -> found.get(0));
    }

    /** Lets the axes go on to the last targets; completes once they stand there, and fails as the program ended otherwise. */
    public CompletableFuture<Void> finish() {
        return program.finish().thenApply(last -> null);
    }

    /** Stops the axes within their limits now. */
    public CompletableFuture<Void> abort() {
        return program.abort();
    }

    /** Stops the axes, unless it has ended. */
    @Override
    public void close() {
        program.close();
    }
}
