package org.mcserver.client;

import java.util.ArrayDeque;
import java.util.ArrayList;
import java.util.Deque;
import java.util.Iterator;
import java.util.List;
import java.util.Locale;
import java.util.Map;
import java.util.Set;
import org.mcserver.client.Messages.ProgramState;

/**
 * Numbering, credit and repetition of one program's lines: a state machine without I/O and without a clock.
 *
 * <p>The server takes line n only if it is the next one; a repeat is acknowledged and never executed again, a gap is refused. So whatever
 * is not known to be accepted may be sent again at any time, and must be until it is (docs/wire/lines.md). Through the gateway lines go by
 * {@code submit}, one message under way at a time. Whoever calls it holds its lock.
 */
final class LineCore {
    /** What waits for its acknowledgement at most. */
    static final int BUFFER_LINES = 16_384;

    static final int BUFFER_CHARACTERS = 512 * 1024;
    static final int CHUNK_LINES = 1000;
    /** The server acknowledges targets within 50 ms; one that has not for so long beyond what they count is gone. */
    static final double UNANSWERED_S = 0.5;
    static final int CHUNK_CHARACTERS = 64 * 1024;
    private static final Set<ProgramState> ENDED = Set.of(
            ProgramState.FINISHED, ProgramState.ABORTED, ProgramState.REJECTED, ProgramState.FAULTED, ProgramState.INTERRUPTED);

    /** Lines {@code first}, {@code first + 1}, … to be sent; {@code rejections} were known as they were numbered. */
    record Chunk(long first, List<String> lines, long rejections) {}

    private final String program;
    private final int chunkLines;
    private final Deque<String> lines = new ArrayDeque<>();
    private long characters;
    private long accepted;
    /** The last line that has ever gone out: it may arrive, even where it is to be sent again. */
    private long wentOut;
    private long credit;
    private long done;
    private ProgramState state;
    private boolean closed;
    private boolean underWay;
    private boolean judging;
    /** A message got no answer: the server is asked before anything more is sent. */
    private boolean lost;
    /**
     * Rejections of lines that are known. Lines go out with this count, and the server takes none of before a rejection; what it says with a
     * smaller one is older than what is known.
     */
    private long rejections;
    private MotionException failure;
    private boolean reported;
    /** The last one of a streamed line: it stays when the line has been corrected. */
    private MotionException rejection;
    /** When targets were sent last since the server was heard, by the sender's clock [s]; null: none were. */
    private Double asked;
    /** How long the server has been silent up to then [s]. */
    private double silent;

    LineCore(Messages.OpenReply opened) {
        this(opened, CHUNK_LINES);
    }

    LineCore(Messages.OpenReply opened, int chunkLines) {
        program = opened.program();
        accepted = opened.expected() - 1;
        done = accepted;
        wentOut = accepted;
        credit = opened.credit();
        state = opened.state();
        this.chunkLines = chunkLines;
    }

    /** Of a program that goes on: lines that the server had already are not done. */
    LineCore(Messages.ContinueReply opened) {
        this(new Messages.OpenReply(
                opened.program(), opened.state(), opened.axes(), opened.expected(), opened.credit(), opened.instance()));
        done = opened.line() - 1;
        closed = opened.whole();
    }

    // ---------------------------------------------------------------- what is known

    long accepted() {
        return accepted;
    }

    long done() {
        return done;
    }

    long given() {
        return accepted + lines.size();
    }

    long credit() {
        return credit;
    }

    ProgramState state() {
        return state;
    }

    boolean pending() {
        return !lines.isEmpty();
    }

    boolean ended() {
        return ENDED.contains(state);
    }

    boolean isClosed() {
        return closed;
    }

    MotionException.Extent extent() {
        return new MotionException.Extent(program, accepted, done);
    }

    MotionException failure() {
        return failure;
    }

    /** Another line may be given: always where none waits, so that a long line cannot stick. */
    boolean hasRoom() {
        return lines.isEmpty() || (lines.size() < BUFFER_LINES && characters < BUFFER_CHARACTERS);
    }

    long rejections() {
        return rejections;
    }

    MotionException rejection() {
        return rejection;
    }

    /** The server has to be asked before anything more is sent. */
    boolean isLost() {
        return lost;
    }

    /** Before lines are given: throws the failure; a rejection that was reported is over. */
    void begin() {
        checkOpen();
        if (failure instanceof MotionException.ProgramRejected) {
            failure = null;
            reported = false;
        }
    }

    /**
     * Throws what has happened since {@link #begin}, whoever else has heard of it: lines that are given in ignorance of a rejection would
     * take the numbers of others.
     */
    void checkGiving() {
        if (failure != null) {
            reported = true;
            throw failure;
        }
    }

    /** Throws the failure; a rejection that was reported does not keep its line from being sent anew. */
    void check() {
        if (failure == null || (reported && failure instanceof MotionException.ProgramRejected && state != ProgramState.REJECTED)) {
            return;
        }
        reported = true;
        throw failure;
    }

    /**
     * Throws why a wait cannot end any more; {@code pastRejection}: what is before a rejected line is waited for all the same. Each that waits
     * hears of a rejection after {@code before}, the last one as it began: what it waits for was given up.
     */
    void checkWait(boolean pastRejection, MotionException before) {
        if (!pastRejection && rejection != null && rejection != before) {
            reported = reported || failure == rejection;
            throw rejection;
        }
        if (!(pastRejection && failure instanceof MotionException.ProgramRejected)) {
            check();
        }
        if (ended() && pending()) {
            throw new MotionException.ProgramClosed(state.word(), extent());
        }
    }

    /** Sees whether targets can be sent now, by the sender's clock, which count for some seconds. */
    void checkTargets(double now, double countsS) {
        checkOpen();
        if (asked != null) {
            // a sender that stood still for longer has not listened meanwhile
            silent += Math.min(now - asked, UNANSWERED_S);
        }
        asked = now;
        if (silent > countsS + UNANSWERED_S) {
            throw new MotionException.NobodyAnswers(
                    "MC530", String.format(Locale.ROOT, "the server has not answered for %.1f s", silent),
                    "where it is gone the axes have stopped: once it is there, open servo mode anew");
        }
    }

    /** Throws where the program takes no more lines. */
    void checkOpen() {
        check();
        if (closed || ended()) {
            throw new MotionException.ProgramClosed(ended() ? state.word() : "closed", extent());
        }
    }

    // ---------------------------------------------------------------- what the application does

    /** Appends a line and returns its number. */
    long give(String line) {
        lines.addLast(line);
        characters += line.length();
        return given();
    }

    /** Gives up the lines that have never been sent; the others may be accepted. */
    void abandon() {
        drop(wentOut);
    }

    /** A line under judgement, which a call sends: its reply says whether it is faulty, not the acknowledgements. */
    void judge(boolean judging) {
        this.judging = judging;
        wentOut = judging ? given() : wentOut;
    }

    // ---------------------------------------------------------------- what goes out

    /** What to send now, within the credit; null: nothing. It counts as under way until its answer or {@link #onLost}. */
    Chunk next() {
        long count = Math.min(Math.min(lines.size(), credit), chunkLines);
        if (underWay || lost || judging || failure != null || closed || ended() || count < 1) {
            return null;
        }
        List<String> chunk = new ArrayList<>((int) count);
        long size = 0;
        for (Iterator<String> each = lines.iterator(); chunk.size() < count; ) {
            String line = each.next();
            size += line.length();
            if (size > CHUNK_CHARACTERS && !chunk.isEmpty()) {
                break;
            }
            chunk.add(line);
        }
        underWay = true;
        wentOut = Math.max(wentOut, accepted + chunk.size());
        return new Chunk(accepted + 1, chunk, rejections);
    }

    /** Something is awaited that a lost acknowledgement could have said. */
    boolean inDoubt() {
        boolean hopeless = failure != null && !(failure instanceof MotionException.ProgramRejected);
        return !ended() && !judging && !underWay && !hopeless && (lost || pending() || closed || done < accepted);
    }

    // ---------------------------------------------------------------- what the server says

    void onReply(Messages.SubmitReply reply) {
        underWay = false;
        // of a rejection that is not heard of the reply does not say which line it is
        lost = lost || reply.rejections() > rejections;
        take(reply.accepted(), reply.credit(), reply.rejections());
        done = Math.max(done, reply.done());
    }

    /** The message or its answer is lost: once the server has been asked, what is not accepted will be sent again. */
    void onLost() {
        underWay = false;
        lost = true;
    }

    /**
     * Takes the refusal of a message: a gap is closed by sending from where the server is, a faulty line is given up with what follows.
     * Returns the error for the application; null: none.
     */
    MotionException onRefusal(MotionException.RequestRefused refusal, long number) {
        underWay = false;
        done = Math.max(done, refusal.number("done", 0));
        long now = refusal.number("rejections", rejections);
        if (!refusal.diagnostics().isEmpty()) {
            if (now <= rejections && !judging && failure instanceof MotionException.ProgramRejected) {
                // an acknowledgement has said so before
                return failure;
            }
            long line = refusal.number("expected", refusal.line() > 0 ? refusal.line() : number);
            reject(Math.min(line, number));
            rejections = Math.max(rejections, now);
            take(refusal.number("accepted", accepted), refusal.number("credit", credit), rejections);
            MotionException faulty = new MotionException.ProgramRejected(line, extent(), refusal.diagnostics());
            if (line < number || !judging) {
                // whoever waits for lines that were streamed hears of it too
                rejection = faulty;
            }
            if (!judging) {
                fail(faulty);
            }
            return faulty;
        }
        if (refusal.code().equals("MC505")) {
            // which line was rejected before is not said here
            lost = lost || now > rejections;
            take(refusal.number("accepted", accepted), refusal.number("credit", credit), now);
            return null;
        }
        if (refusal.code().equals("MC510")) {
            take(refusal.number("accepted", accepted), 0, now);
            String end = String.valueOf(refusal.details().getOrDefault("state", "closed"));
            for (ProgramState each : ENDED) {
                if (each.word().equals(end)) {
                    progress(each, done, null, List.of(), String.valueOf(refusal.details().getOrDefault("reason", "")));
                }
            }
            if (failure == null && !end.equals("ending")) {
                fail(new MotionException.ProgramClosed(end, extent()));
            }
            // why it ends is said once it stands still
            lost = failure == null;
            return failure;
        }
        if (refusal.code().equals("MC503") || refusal.code().equals("MC504")) {
            lost = true;
        } else if (!judging) {
            fail(refusal);
        }
        return refusal;
    }

    void onAck(Messages.Ack ack) {
        asked = null;
        silent = 0;
        hearRejection(ack);
        // from before a rejection that is known; that a program has ended is never too old
        if (ack.rejections() < rejections && !ENDED.contains(ack.state())) {
            return;
        }
        take(ack.accepted(), ack.credit(), ack.rejections());
        progress(ack.state(), ack.done(), ack.fault(), ack.diagnostics(), ack.reason());
    }

    /** Takes the program as the server knows it; null: it knows no such program. */
    void onStatus(Messages.ProgramStatus status) {
        lost = false;
        if (status == null) {
            underWay = false;
            progress(ProgramState.INTERRUPTED, 0, null, List.of(), "");
            return;
        }
        underWay = underWay && judging;
        onAck(new Messages.Ack(
                program, status.accepted(), status.done(), status.credit(), status.state(), status.rejected(), status.diagnostics(),
                status.fault(), 0, status.rejections(), status.reason()));
    }

    void onClosed(Messages.CloseReply reply) {
        closed = true;
        if (!ENDED.contains(reply.state())) {
            progress(reply.state(), reply.done(), null, List.of(), "");
        }
    }

    /** Why it does not go on. */
    void fail(MotionException error) {
        failure = error;
        reported = false;
    }

    /** Takes the rejection that a report tells of, if it is not known yet. */
    private void hearRejection(Messages.Ack ack) {
        if (ack.rejections() <= rejections || (judging && !ENDED.contains(ack.state()))) {
            return;
        }
        long line = ack.rejected() > 0 ? ack.rejected() : ack.accepted() + 1;
        boolean ours = line <= given();
        rejections = ack.rejections();
        reject(line);
        // what is before it is accepted
        take(ack.accepted(), credit, rejections);
        if (ours) {
            // where the program has ended otherwise than well, that will be the failure
            rejection = new MotionException.ProgramRejected(line, extent(), ack.diagnostics());
            fail(rejection);
        }
    }

    /** Takes cumulative numbers, unless a line has been rejected since, or one that is not heard of; older ones change nothing. */
    private void take(long accepted, long credit, long rejections) {
        if (rejections != this.rejections || accepted < this.accepted || accepted > given()) {
            return;
        }
        for (long taken = this.accepted; taken < accepted; taken++) {
            characters -= lines.removeFirst().length();
        }
        this.accepted = accepted;
        this.credit = credit;
    }

    /** Line {@code line} is faulty: it and what follows is given up; acceptance may step back. */
    private void reject(long line) {
        drop(line - 1);
        accepted = Math.min(accepted, line - 1);
        wentOut = Math.min(wentOut, line - 1);
    }

    /** Drops the lines behind this one that are not known to be accepted. */
    private void drop(long through) {
        while (given() > through && !lines.isEmpty()) {
            characters -= lines.removeLast().length();
        }
    }

    /** Takes the program's state; the first one that is an end stays. */
    private void progress(
            ProgramState now, long done, Messages.Fault fault, List<Messages.Diagnostic> diagnostics, String reason) {
        this.done = Math.max(this.done, done);
        if (ended()) {
            return;
        }
        state = now;
        if (ended() && (failure == null || now != ProgramState.FINISHED)) {
            fail(ending(fault, diagnostics, reason));
        }
    }

    private MotionException ending(Messages.Fault fault, List<Messages.Diagnostic> diagnostics, String reason) {
        return switch (state) {
            case FINISHED -> null;
            case FAULTED -> new MotionException.ProgramFaulted(
                    fault != null ? fault : new Messages.Fault("MC400", "a fault of the machine ended the program", "", null, 0, null, 0.0),
                    extent());
            case REJECTED -> new MotionException.ProgramRejected(
                    diagnostics.isEmpty() ? accepted + 1 : diagnostics.get(0).line(), extent(), diagnostics);
            case INTERRUPTED -> new MotionException.ProgramInterrupted(extent());
            default -> new MotionException.ProgramAborted(extent(), reason);
        };
    }

    /** The line without its end; fails with MC538 where it is not one line, or too long. */
    static String checked(String line, long longestLine) {
        String text = line.replaceAll("[\\r\\n]+$", "");
        if (text.indexOf('\n') >= 0 || text.indexOf('\r') >= 0) {
            throw new MotionException.RequestRefused(
                    "MC538", "a line must not hold a line end", "give each line by itself", Map.of(), List.of());
        }
        int length = text.codePointCount(0, text.length());
        if (length > longestLine) {
            throw new MotionException.RequestRefused("MC538",
                    "the line has " + length + " characters, the server takes " + longestLine, "break it at a command", Map.of(), List.of());
        }
        return text;
    }
}
