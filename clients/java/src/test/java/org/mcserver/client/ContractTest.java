package org.mcserver.client;

import static org.junit.jupiter.api.Assertions.assertArrayEquals;
import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertFalse;
import static org.junit.jupiter.api.Assertions.assertNotNull;
import static org.junit.jupiter.api.Assertions.assertThrows;
import static org.junit.jupiter.api.Assertions.assertTrue;

import com.google.gson.Gson;
import com.google.gson.GsonBuilder;
import com.google.gson.JsonArray;
import com.google.gson.JsonElement;
import com.google.gson.JsonObject;
import com.google.gson.JsonParser;
import java.io.IOException;
import java.lang.reflect.RecordComponent;
import java.nio.file.Files;
import java.nio.file.Path;
import java.util.ArrayDeque;
import java.util.ArrayList;
import java.util.Base64;
import java.util.Deque;
import java.util.HexFormat;
import java.util.List;
import java.util.Map;
import java.util.stream.Stream;
import org.junit.jupiter.api.DynamicTest;
import org.junit.jupiter.api.Test;
import org.junit.jupiter.api.TestFactory;

/** The files of clients/contract: what passes between server and clients, and what a streaming core makes of it. */
class ContractTest {
    private static final Path FOLDER = Path.of("..", "contract");
    /** These decide about lines and places: a client refuses any other value, and has each of their fields. */
    private static final List<String> DECISIVE =
            List.of("Ack", "OpenReply", "ContinueReply", "SubmitReply", "CloseReply", "ErrorReply", "TelemetryBlock");

    private static JsonObject read(Path file) throws IOException {
        return JsonParser.parseString(Files.readString(file)).getAsJsonObject();
    }

    private static List<JsonObject> files(String name) throws IOException {
        List<JsonObject> found = new ArrayList<>();
        try (Stream<Path> paths = Files.list(FOLDER.resolve(name))) {
            for (Path path : paths.sorted().toList()) {
                found.add(read(path));
            }
        }
        assertFalse(found.isEmpty());
        return found;
    }

    private static List<JsonObject> list(JsonObject file, String key) {
        List<JsonObject> found = new ArrayList<>();
        JsonElement list = file.get(key);
        if (list != null) {
            list.getAsJsonArray().forEach(each -> found.add(each.getAsJsonObject()));
        }
        return found;
    }

    private static byte[] bytes(JsonObject vector) {
        return HexFormat.of().parseHex(vector.get("bytes").getAsString());
    }

    private static String name(JsonObject file) {
        return file.get("name").getAsString();
    }

    /** The record of a message; null: this SDK has none, Machine.call gives it as it is. */
    private static Class<? extends Record> kind(String message) {
        String named = message.equals("WireDiagnostic") ? "Diagnostic" : message;
        for (Class<?> each : Messages.class.getDeclaredClasses()) {
            if (each.getSimpleName().equals(named) && each.isRecord()) {
                return each.asSubclass(Record.class);
            }
        }
        return null;
    }

    private static Object decoded(String message, byte[] bytes) {
        return message.equals("TelemetryBlock") ? Wire.block(Wire.unpack(bytes)) : Wire.decode(kind(message), bytes);
    }

    /** Compares what was read with what is meant; where it is not whole, the server may have further fields. */
    private static void same(Object read, JsonElement meant, boolean whole, String where) throws ReflectiveOperationException {
        if (meant.isJsonNull()) {
            assertEquals(null, read, where);
        } else if (read instanceof Wire.TelemetryBlock block) {
            JsonArray parts = meant.getAsJsonArray();
            same(block.seq(), parts.get(0), whole, where);
            same(block.t(), parts.get(1), whole, where);
            same(block.rows(), parts.get(2), whole, where);
        } else if (read instanceof Record record) {
            RecordComponent[] components = record.getClass().getRecordComponents();
            assertTrue(!whole || components.length == meant.getAsJsonObject().size(), where);
            for (RecordComponent component : components) {
                String key = Wire.keyOf(component);
                assertTrue(meant.getAsJsonObject().has(key), where + ": " + key);
                same(component.getAccessor().invoke(record), meant.getAsJsonObject().get(key), whole, where + "." + key);
            }
        } else if (read instanceof Messages.Word word) {
            // a word of a later version is UNKNOWN
            assertTrue(word.word().isEmpty() || word.word().equals(meant.getAsString()), where);
        } else if (read instanceof List<?> list) {
            assertEquals(meant.getAsJsonArray().size(), list.size(), where);
            for (int index = 0; index < list.size(); index++) {
                same(list.get(index), meant.getAsJsonArray().get(index), whole, where + "[" + index + "]");
            }
        } else if (read instanceof Map<?, ?> map) {
            assertEquals(meant.getAsJsonObject().size(), map.size(), where);
            for (Map.Entry<?, ?> entry : map.entrySet()) {
                same(entry.getValue(), meant.getAsJsonObject().get(String.valueOf(entry.getKey())), whole, where + "." + entry.getKey());
            }
        } else if (read instanceof byte[] data) {
            assertArrayEquals(Base64.getDecoder().decode(meant.getAsString()), data, where);
        } else if (read instanceof Long number) {
            assertEquals(meant.getAsLong(), number, where);
        } else if (read instanceof java.math.BigInteger number) {
            assertEquals(meant.getAsBigInteger(), number, where);
        } else if (read instanceof Double number) {
            assertEquals(Double.doubleToLongBits(meant.getAsDouble()), Double.doubleToLongBits(number), where);
        } else if (read instanceof Boolean flag) {
            assertEquals(meant.getAsBoolean(), flag, where);
        } else {
            assertEquals(meant.getAsString(), read, where);
        }
    }

    @Test
    void everyMessageOfTheServerIsReadAsItIsMeant() throws Exception {
        int seen = 0;
        for (JsonObject file : files("messages")) {
            if (!file.get("sent_by").getAsString().equals("server") || kind(name(file)) == null) {
                continue;
            }
            boolean whole = DECISIVE.contains(name(file));
            List<JsonObject> vectors = list(file, "vectors");
            vectors.addAll(list(file, "later_words"));
            for (JsonObject vector : vectors) {
                String where = name(file) + ", " + name(vector);
                same(decoded(name(file), bytes(vector)), vector.get("value"), whole, where);
                seen++;
            }
        }
        assertTrue(seen > 200, "only " + seen);
    }

    @Test
    void whatIsNoSuchMessageIsRefusedWhereItDecidesAboutLinesAndPlaces() throws Exception {
        for (JsonObject file : files("messages")) {
            for (JsonObject vector : DECISIVE.contains(name(file)) ? list(file, "refused") : List.<JsonObject>of()) {
                if (!name(vector).equals("two messages")) {
                    String where = name(file) + ", " + name(vector);
                    assertEquals("MC533", assertThrows(MotionException.class, () -> decoded(name(file), bytes(vector)), where).code());
                }
            }
        }
    }

    @Test
    void aMessageInsideOfARequestIsSentByItsFields() {
        Messages.Assertion asked = new Messages.Assertion(Messages.Quantity.POSITION, "T3.Z", null, 300.0);
        Messages.SimulateRequest request = new Messages.SimulateRequest("G1 X1").withAssertions(List.of(asked));
        Map<?, ?> sent = (Map<?, ?>) Wire.unpack(Wire.encode(Wire.params(request)));
        Map<?, ?> one = (Map<?, ?>) ((List<?>) sent.get("assertions")).get(0);
        assertEquals(List.of("position", "T3.Z", 300.0), List.of(one.get("what"), one.get("of"), one.get("most")));
        assertTrue(one.containsKey("least") && one.get("least") == null);
    }

    @Test
    void garbageIsRefusedWhateverItIsTakenFor() throws Exception {
        for (JsonObject vector : list(read(FOLDER.resolve("garbage.json")), "refused")) {
            for (String message : DECISIVE) {
                MotionException error = assertThrows(MotionException.class, () -> decoded(message, bytes(vector)), name(vector));
                assertEquals("MC533", error.code());
            }
        }
    }

    @Test
    void samplesAreTakenApartByField() throws Exception {
        JsonObject file = read(FOLDER.resolve("telemetry.json"));
        List<String> fields = new ArrayList<>();
        file.get("fields").getAsJsonArray().forEach(each -> fields.add(each.getAsString()));
        for (JsonObject vector : list(file, "vectors")) {
            List<Long> axes = new ArrayList<>();
            vector.get("axes").getAsJsonArray().forEach(each -> axes.add(each.getAsLong()));
            Messages.TelemetryInfo info = new Messages.TelemetryInfo(axes, fields, 10, 20.0);
            Samples samples = Samples.of(Wire.block(Wire.unpack(bytes(vector))), info, 0.001);
            assertEquals(vector.get("rows").getAsInt(), samples.rows());
            assertEquals(vector.get("seq").getAsLong(), samples.seq());
            for (Map.Entry<String, JsonElement> column : vector.get("columns").getAsJsonObject().entrySet()) {
                float[] read = samples.field(column.getKey());
                JsonArray meant = column.getValue().getAsJsonArray();
                assertEquals(meant.size(), read.length);
                for (int index = 0; index < read.length; index++) {
                    assertEquals(meant.get(index).getAsDouble(), (double) read[index], 0.0, name(vector));
                }
            }
        }
        Messages.TelemetryInfo one = new Messages.TelemetryInfo(List.of(0L), fields, 10, 20.0);
        Wire.TelemetryBlock odd = new Wire.TelemetryBlock(0, 0.0, new byte[17]);
        assertEquals("MC533", assertThrows(MotionException.class, () -> Samples.of(odd, one, 0.001)).code());
    }

    @TestFactory
    Stream<DynamicTest> everySequenceGoesAsTheContractSays() throws Exception {
        return files("sequences").stream().filter(sequence -> !sequence.get("puts_only").getAsBoolean())
                .map(sequence -> DynamicTest.dynamicTest(name(sequence), () -> new Player(sequence).play()));
    }

    @TestFactory
    Stream<DynamicTest> servoModeGoesAsTheContractSays() throws Exception {
        return files("targets").stream().map(sequence -> DynamicTest.dynamicTest(name(sequence), () -> new TargetPlayer().play(sequence)));
    }

    /** Plays one sequence of targets. */
    private static final class TargetPlayer {
        private LineCore core;
        private long seq;
        private List<Object> put;
        private Messages.ProgramStatus status;
        private MotionException failed;

        void play(JsonObject sequence) {
            int number = 0;
            for (JsonObject step : list(sequence, "steps")) {
                Map.Entry<String, JsonElement> only = step.entrySet().iterator().next();
                take(only.getKey(), only.getValue(), name(sequence) + ", step " + number++ + ", " + only.getKey());
            }
        }

        private void take(String what, JsonElement value, String where) {
            switch (what) {
                case "servo" -> core = Servo.core(Wire.decode(Messages.ServoReply.class, bytes(value.getAsJsonObject())));
                case "refused" -> {
                    Messages.ErrorReply error = Wire.decode(Messages.ErrorReply.class, bytes(value.getAsJsonObject()));
                    failed = new MotionException.RequestRefused(error.code(), error.message(), error.hint(), error.details(), error.diagnostics());
                }
                case "targets" -> targets(value.getAsJsonObject());
                case "puts" -> {
                    Gson gson = new GsonBuilder().serializeNulls().create();
                    assertEquals(JsonParser.parseString(value.toString()), JsonParser.parseString(gson.toJson(put)), where);
                    put = null;
                }
                case "lost" -> {
                    // nothing to do
                }
                case "asked" -> status = Wire.decode(Messages.ProgramStatus.class, bytes(value.getAsJsonObject()));
                case "counts" -> {
                    JsonObject counted = new Gson().toJsonTree(Wire.params(status.servo())).getAsJsonObject();
                    value.getAsJsonObject().entrySet().forEach(
                            each -> assertEquals(each.getValue().getAsLong(), counted.get(each.getKey()).getAsLong(), where + " " + each.getKey()));
                }
                case "ack" -> core.onAck(Wire.decode(Messages.Ack.class, bytes(value.getAsJsonObject())));
                case "knows" -> assertEquals(value.getAsJsonObject().get("state").getAsString(), core.state().word(), where);
                case "fails" -> {
                    assertNotNull(failed, where);
                    assertEquals(value.getAsJsonObject().get("code").getAsString(), failed.code(), where);
                    assertTrue(failed.getMessage().contains(value.getAsJsonObject().get("says").getAsString()), where);
                    assertEquals(null, put, where);
                }
                default -> throw new AssertionError(where + ": a step that is not known here");
            }
        }

        private void targets(JsonObject given) {
            try {
                core.checkTargets(given.get("sent").getAsDouble(), given.get("counts_s").getAsDouble());
            } catch (MotionException error) {
                failed = error;
                return;
            }
            Gson gson = new Gson();
            Targets targets = new Targets(
                    gson.fromJson(given.get("positions"), double[][].class), gson.fromJson(given.get("velocities"), double[][].class),
                    gson.fromJson(given.get("times"), double[].class), given.get("counts_s").getAsDouble(),
                    gson.fromJson(given.get("tool"), Long.class), given.get("frame").getAsString().equals("tool"));
            put = targets.message(++seq, given.get("sent").getAsDouble(), 0.0);
        }
    }

    /** Plays one sequence to a core: what would be sent stands in {@code sent}. */
    private static final class Player {
        private final JsonObject sequence;
        private final int chunkLines;
        private final Deque<LineCore.Chunk> sent = new ArrayDeque<>();
        private LineCore core;
        private Long judged;
        private MotionException verdict;
        private boolean closing;

        Player(JsonObject sequence) {
            this.sequence = sequence;
            chunkLines = sequence.get("chunk_lines").getAsInt();
        }

        void play() {
            int number = 0;
            for (JsonObject step : list(sequence, "steps")) {
                Map.Entry<String, JsonElement> only = step.entrySet().iterator().next();
                String where = name(sequence) + ", step " + number++ + ", " + only.getKey();
                take(only.getKey(), only.getValue(), where);
                for (LineCore.Chunk chunk = core.next(); chunk != null; chunk = core.next()) {
                    sent.add(chunk);
                }
            }
        }

        private void take(String what, JsonElement value, String where) {
            switch (what) {
                case "open" -> core = new LineCore(Wire.decode(Messages.OpenReply.class, bytes(value.getAsJsonObject())), chunkLines);
                case "continues" -> core = new LineCore(Wire.decode(Messages.ContinueReply.class, bytes(value.getAsJsonObject())));
                case "give" -> {
                    core.begin();
                    value.getAsJsonArray().forEach(line -> core.give(line.getAsString()));
                }
                case "judge" -> {
                    core.begin();
                    long line = core.give(value.getAsString());
                    judged = line;
                    core.judge(true);
                    sent.add(new LineCore.Chunk(line, List.of(value.getAsString()), core.rejections()));
                }
                case "sends" -> {
                    LineCore.Chunk chunk = sent.poll();
                    assertNotNull(chunk, where);
                    List<String> lines = new ArrayList<>();
                    value.getAsJsonObject().get("lines").getAsJsonArray().forEach(line -> lines.add(line.getAsString()));
                    assertEquals(value.getAsJsonObject().get("first").getAsLong(), chunk.first(), where);
                    assertEquals(lines, chunk.lines(), where);
                    assertEquals(value.getAsJsonObject().get("rejections").getAsLong(), chunk.rejections(), where);
                }
                case "quiet" -> assertTrue(sent.isEmpty(), where);
                case "lost" -> {
                    core.onLost();
                }
                case "answer" -> answer(value.getAsJsonObject());
                case "ack" -> core.onAck(Wire.decode(Messages.Ack.class, bytes(value.getAsJsonObject())));
                case "asked" -> core.onStatus(
                        value.isJsonNull() ? null : Wire.decode(Messages.ProgramStatus.class, bytes(value.getAsJsonObject())));
                case "closes" -> {
                    assertEquals(value.getAsJsonObject().get("last").getAsLong(), core.accepted(), where);
                    closing = true;
                }
                case "knows" -> {
                    JsonObject known = value.getAsJsonObject();
                    assertEquals(known.get("accepted").getAsLong(), core.accepted(), where);
                    assertEquals(known.get("done").getAsLong(), core.done(), where);
                    assertEquals(known.get("state").getAsString(), core.state().word(), where);
                }
                case "fails" -> fails(value.getAsJsonObject(), where);
                default -> throw new AssertionError(where + ": a step that is not known here");
            }
        }

        private void answer(JsonObject answer) {
            if (closing && answer.has("reply")) {
                closing = false;
                core.onClosed(Wire.decode(Messages.CloseReply.class, bytes(answer.get("reply").getAsJsonObject())));
            } else if (answer.has("reply")) {
                core.onReply(Wire.decode(Messages.SubmitReply.class, bytes(answer.get("reply").getAsJsonObject())));
            } else {
                Messages.ErrorReply error = Wire.decode(Messages.ErrorReply.class, bytes(answer.get("refused").getAsJsonObject()));
                verdict = core.onRefusal(new MotionException.RequestRefused(
                        error.code(), error.message(), error.hint(), error.details(), error.diagnostics()), judged == null ? 1 : judged);
            }
            if (judged != null) {
                judged = null;
                core.judge(false);
            }
        }

        private void fails(JsonObject meant, String where) {
            MotionException error = verdict;
            verdict = null;
            if (error == null) {
                error = assertThrows(MotionException.class, () -> core.checkWait(false, null), where);
            } else if (core.failure() == error) {
                assertThrows(MotionException.class, core::check, where);
            }
            assertEquals(meant.get("code").getAsString(), error.code(), where);
            if (meant.has("says")) {
                assertTrue(error.getMessage().contains(meant.get("says").getAsString()), where);
            }
            if (meant.has("line")) {
                assertEquals(meant.get("line").getAsLong(), error.line(), where);
                assertEquals(meant.get("column").getAsLong(), error.column(), where);
            }
        }
    }
}
