package org.mcserver.client;

import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.nio.FloatBuffer;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;

/**
 * Some cycles of every axis, in mm, deg and s.
 *
 * @param seq number of the first row's cycle; a jump means cycles lost on the way
 * @param t executor time of the first row [s]
 * @param cycleS time between two rows [s]
 * @param rows how many cycles
 * @param axes the axes' numbers
 * @param fields by name ({@code setpoint}, {@code position}, {@code velocity}, {@code torque}): arrays of shape (rows, axes) in C order
 */
public record Samples(long seq, double t, double cycleS, int rows, List<Long> axes, Map<String, float[]> fields) {
    /** A field by its name; empty where the server sends no such field. */
    public float[] field(String name) {
        return fields.getOrDefault(name, new float[0]);
    }

    /** Setpoints [mm, deg]. */
    public float[] setpoint() {
        return field("setpoint");
    }

    /** The encoders' readings [mm, deg]. */
    public float[] position() {
        return field("position");
    }

    /** Reads a block as {@code info} says; MC533: it does not fit the machine's axes. */
    static Samples of(Wire.TelemetryBlock block, Messages.TelemetryInfo info, double cycleS) {
        List<String> names = info.fields();
        int columns = info.axes().size() * names.size();
        if (columns == 0 || block.rows().length % (4 * columns) != 0) {
            throw new MotionException.Protocol(block.rows().length + " bytes of samples do not fit " + columns + " columns");
        }
        FloatBuffer values = ByteBuffer.wrap(block.rows()).order(ByteOrder.LITTLE_ENDIAN).asFloatBuffer();
        int rows = values.remaining() / columns;
        Map<String, float[]> fields = new LinkedHashMap<>();
        for (int field = 0; field < names.size(); field++) {
            float[] column = new float[rows * info.axes().size()];
            for (int index = 0; index < column.length; index++) {
                column[index] = values.get(index * names.size() + field);
            }
            fields.put(names.get(field), column);
        }
        return new Samples(block.seq(), block.t(), cycleS, rows, info.axes(), fields);
    }
}
