package org.mcserver.client;

import java.util.ArrayList;
import java.util.List;

/**
 * Where axes, or a tool, are to be: a row for each point, in it a number for each axis.
 *
 * @param positions [mm, deg]: the axes come to rest there, unless the next ones lead on; null: velocities alone
 * @param velocities [mm/s, deg/s]: with positions, the axes pass there at them; alone, they go on at them; null: none
 * @param times of the points, ascending [s from now]; null: one point, for now
 * @param countsS how long they count [s]; null: as long as {@link Machine#servo} says
 * @param tool its number: the rows are its poses X Y Z A B C and twists (X Y Z of one without orientation); null: rows of axes
 * @param inToolFrame whether a tool's velocities are along and about its own axes, else the base's; poses are in the base's
 */
public record Targets(double[][] positions, double[][] velocities, double[] times, Double countsS, Long tool, boolean inToolFrame) {
    public Targets(double[][] positions, double[][] velocities, double[] times, Double countsS) {
        this(positions, velocities, times, countsS, null, false);
    }

    /** One point to come to rest at. */
    public static Targets at(double... positions) {
        return new Targets(new double[][] {positions}, null, null, null);
    }

    /** Points at times from now. */
    public static Targets chunk(double[] times, double[][] positions) {
        return new Targets(positions, null, times, null);
    }

    /** Velocities alone, to go on at. */
    public static Targets going(double... velocities) {
        return new Targets(null, new double[][] {velocities}, null, null);
    }

    /** The same, passed at velocities: a row for each point. */
    public Targets passing(double[]... velocities) {
        return new Targets(positions, velocities, times, countsS, tool, inToolFrame);
    }

    /** The same, counting for another time. */
    public Targets withCounts(double seconds) {
        return new Targets(positions, velocities, times, seconds, tool, inToolFrame);
    }

    /** The same, as poses of a tool, and twists along and about the axes of the base. */
    public Targets ofTool(long number) {
        return new Targets(positions, velocities, times, countsS, number, false);
    }

    /** The same, with twists along and about the tool's own axes. */
    public Targets alongTool() {
        return new Targets(positions, velocities, times, countsS, tool, true);
    }

    /** The message {@code StreamTargets}, an array. */
    List<Object> message(long seq, double sent, double counts) {
        List<Object> made = new ArrayList<>();
        made.add(seq);
        made.add(sent);
        made.add(countsS == null ? counts : countsS);
        made.add(rows(positions));
        made.add(rows(velocities));
        made.add(times == null ? null : row(times));
        made.add(tool);
        made.add(inToolFrame ? "tool" : "base");
        return made;
    }

    private static List<List<Double>> rows(double[][] rows) {
        if (rows == null) {
            return null;
        }
        List<List<Double>> made = new ArrayList<>();
        for (double[] row : rows) {
            made.add(row(row));
        }
        return made;
    }

    private static List<Double> row(double[] values) {
        List<Double> made = new ArrayList<>();
        for (double value : values) {
            made.add(value);
        }
        return made;
    }
}
