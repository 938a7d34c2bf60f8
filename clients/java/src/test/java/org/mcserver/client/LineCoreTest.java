package org.mcserver.client;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertNull;

import java.util.List;
import org.junit.jupiter.api.Test;

class LineCoreTest {
    private static final Messages.OpenReply OPENED =
            new Messages.OpenReply("p", Messages.ProgramState.RUNNING, List.of(0L), 1, 2, "i");

    private static LineCore with(int lines) {
        LineCore core = new LineCore(OPENED);
        for (int number = 1; number <= lines; number++) {
            core.give("G01 X" + number);
        }
        return core;
    }

    @Test
    void linesThatHaveNotGoneOutAreGivenUpAndTheNextOneHasTheNumberBehindThoseThatHave() {
        LineCore core = with(5);
        assertEquals(2, core.next().lines().size());
        core.abandon();
        assertEquals(2, core.given());
        core.onReply(new Messages.SubmitReply("p", 2, 0, 100, 0));
        assertNull(core.next());
        assertEquals(3, core.give("G01 X9"));
        assertEquals(3, core.next().first());
    }

    @Test
    void aLineUnderJudgementHasGoneOut() {
        LineCore core = with(0);
        core.give("G01 X1");
        core.judge(true);
        core.judge(false);
        core.abandon();
        assertEquals(1, core.given());
    }
}
