package org.mcserver.client;

import java.util.List;
import java.util.Map;

/**
 * What went wrong: a stable code such as MC505, a sentence, and the remedy.
 *
 * <p>Codes MC100 to MC529 and MC550 to MC579 come from the server, MC530 to MC539 from here, MC070 to MC074 from the gateway.
 */
public sealed class MotionException extends RuntimeException {
    /** How far a program came. */
    record Extent(String program, long accepted, long done) {}

    private static final long serialVersionUID = 1L;

    private final String code;
    private final String hint;
    private final transient Map<String, Object> details;
    private final transient List<Messages.Diagnostic> diagnostics;

    MotionException(String code, String message, String hint, Map<String, Object> details, List<Messages.Diagnostic> diagnostics) {
        super(message);
        this.code = code;
        this.hint = hint;
        this.details = details;
        this.diagnostics = diagnostics;
    }

    MotionException(String code, String message, String hint) {
        this(code, message, hint, Map.of(), List.of());
    }

    /** Stable code such as MC505. */
    public String code() {
        return code;
    }

    /** The remedy; empty where nothing useful is known. */
    public String hint() {
        return hint;
    }

    /** Values that the code promises. */
    public Map<String, Object> details() {
        return details == null ? Map.of() : details;
    }

    /** Faults of G-code; empty where the error is about something else. */
    public List<Messages.Diagnostic> diagnostics() {
        return diagnostics == null ? List.of() : diagnostics;
    }

    /** Line of the program, from 1; 0: none. */
    public long line() {
        return diagnostics().isEmpty() ? 0 : diagnostics().get(0).line();
    }

    /** Column of the line, from 1; 0: none. */
    public long column() {
        return diagnostics().isEmpty() ? 0 : diagnostics().get(0).column();
    }

    @Override
    public String toString() {
        return code + ": " + getMessage() + (hint.isEmpty() ? "" : " (" + hint + ")");
    }

    /** A number among the details; the fallback where it is missing. */
    long number(String name, long fallback) {
        return details().get(name) instanceof Long value ? value : fallback;
    }

    /** The gateway's URL or a name cannot be used. */
    public static final class Configuration extends MotionException {
        private static final long serialVersionUID = 1L;

        Configuration(String message, String hint) {
            super("MC537", message, hint);
        }
    }

    /** No gateway or machine is there, or no longer, or the token is wrong; or no answer came in time. */
    public static final class NobodyAnswers extends MotionException {
        private static final long serialVersionUID = 1L;

        NobodyAnswers(String code, String message, String hint) {
            super(code, message, hint);
        }
    }

    /** More than one machine is there, or none, and none was named. */
    public static final class SeveralMachines extends MotionException {
        private static final long serialVersionUID = 1L;

        SeveralMachines(List<String> machines) {
            super("MC531", machines.size() + " machines are there: " + String.join(", ", machines),
                    machines.isEmpty() ? "start a server (mcserver run)" : "name one, such as " + machines.get(0),
                    Map.of("machines", machines), List.of());
        }
    }

    /** What came is no such message. */
    public static final class Protocol extends MotionException {
        private static final long serialVersionUID = 1L;

        Protocol(String message) {
            super("MC533", message, "client and server differ in version");
        }
    }

    /** The server or the gateway refuses a request; the state is as it was before. */
    public static final class RequestRefused extends MotionException {
        private static final long serialVersionUID = 1L;

        RequestRefused(String code, String message, String hint, Map<String, Object> details, List<Messages.Diagnostic> diagnostics) {
            super(code, message, hint, details, diagnostics);
        }
    }

    /** About one program: says what was accepted and done. */
    public abstract static sealed class OfProgram extends MotionException {
        private static final long serialVersionUID = 1L;

        private final String program;
        private final long accepted;
        private final long done;

        OfProgram(String code, String message, String hint, Extent extent, List<Messages.Diagnostic> diagnostics) {
            super(code, message, hint, Map.of(), diagnostics);
            program = extent.program();
            accepted = extent.accepted();
            done = extent.done();
        }

        /** Its id. */
        public String program() {
            return program;
        }

        /** Lines through this number were taken by the server. */
        public long accepted() {
            return accepted;
        }

        /** Lines through this number have surely ended. */
        public long done() {
            return done;
        }
    }

    /** A line has faults; nothing of it has moved. */
    public static final class ProgramRejected extends OfProgram {
        private static final long serialVersionUID = 1L;

        private final long line;

        ProgramRejected(long line, Extent extent, List<Messages.Diagnostic> diagnostics) {
            super(first(diagnostics, "MC100", Messages.Diagnostic::code),
                    first(diagnostics, "line " + line + " was rejected", Messages.Diagnostic::message),
                    first(diagnostics, "", Messages.Diagnostic::hint), extent, diagnostics);
            this.line = line;
        }

        private static String first(
                List<Messages.Diagnostic> diagnostics, String otherwise, java.util.function.Function<Messages.Diagnostic, String> get) {
            return diagnostics.isEmpty() ? otherwise : get.apply(diagnostics.get(0));
        }

        @Override
        public long line() {
            return line;
        }
    }

    /** A fault of the machine ended the program. */
    public static final class ProgramFaulted extends OfProgram {
        private static final long serialVersionUID = 1L;

        private final transient Messages.Fault fault;

        ProgramFaulted(Messages.Fault fault, Extent extent) {
            super(fault.code(), fault.message(),
                    fault.hint().isEmpty() ? "clear the fault with reset, then capture the axes (G1010)" : fault.hint(), extent, List.of());
            this.fault = fault;
        }

        /** Axis and line. */
        public Messages.Fault fault() {
            return fault;
        }

        @Override
        public long line() {
            return fault == null ? 0 : fault.line();
        }
    }

    /** The program was stopped before its end; the message says why. */
    public static final class ProgramAborted extends OfProgram {
        private static final long serialVersionUID = 1L;

        ProgramAborted(Extent extent, String reason) {
            super("MC535", "the program was aborted" + (reason.isEmpty() ? "" : " (" + reason + ")") + "; lines through " + extent.done() + " are done",
                    "once the machine is clear, open another one", extent, List.of());
        }
    }

    /** The server that ran the program went away: the line after {@code done} may have begun, axes have no energy. */
    public static final class ProgramInterrupted extends OfProgram {
        private static final long serialVersionUID = 1L;

        ProgramInterrupted(Extent extent) {
            super("MC534", "the server that ran the program went away; lines through " + extent.done() + " are done, line "
                            + (extent.done() + 1) + " may have begun",
                    "continueProgram(new Messages.ContinueRequest(\"" + extent.program() + "\")) goes on",
                    extent, List.of());
        }
    }

    /** The program takes no more lines. */
    public static final class ProgramClosed extends OfProgram {
        private static final long serialVersionUID = 1L;

        ProgramClosed(String state, Extent extent) {
            super("MC536", "the program takes no more lines: it is " + state, "open another one with Machine.program", extent, List.of());
        }
    }
}
