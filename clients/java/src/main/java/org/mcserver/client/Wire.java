package org.mcserver.client;

import java.io.IOException;
import java.lang.reflect.Constructor;
import java.lang.reflect.ParameterizedType;
import java.lang.reflect.RecordComponent;
import java.lang.reflect.Type;
import java.math.BigInteger;
import java.nio.charset.CharacterCodingException;
import java.nio.charset.CodingErrorAction;
import java.nio.charset.StandardCharsets;
import java.nio.ByteBuffer;
import java.util.ArrayList;
import java.util.Arrays;
import java.util.Collections;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;
import org.msgpack.core.MessageBufferPacker;
import org.msgpack.core.MessagePack;
import org.msgpack.core.MessagePackException;
import org.msgpack.core.MessageUnpacker;

/** MessagePack to and from plain values, and plain values to the records of {@link Messages}. */
final class Wire {
    private static final int DEEPEST = 100;

    private Wire() {}

    /** Writes null, Boolean, Number, CharSequence, byte[], List, Map, a word of the wire or a message. */
    static byte[] encode(Object value) {
        try (MessageBufferPacker packer = MessagePack.newDefaultBufferPacker()) {
            pack(packer, value);
            return packer.toByteArray();
        } catch (IOException error) {
            throw new MotionException.Protocol("the request cannot be written: " + error.getMessage());
        }
    }

    private static void pack(MessageBufferPacker packer, Object value) throws IOException {
        if (value == null) {
            packer.packNil();
        } else if (value instanceof Boolean flag) {
            packer.packBoolean(flag);
        } else if (value instanceof Double || value instanceof Float) {
            packer.packDouble(((Number) value).doubleValue());
        } else if (value instanceof BigInteger number) {
            packer.packBigInteger(number);
        } else if (value instanceof Number number) {
            packer.packLong(number.longValue());
        } else if (value instanceof CharSequence text) {
            packer.packString(text.toString());
        } else if (value instanceof byte[] bytes) {
            packer.packBinaryHeader(bytes.length);
            packer.writePayload(bytes);
        } else if (value instanceof List<?> list) {
            packer.packArrayHeader(list.size());
            for (Object each : list) {
                pack(packer, each);
            }
        } else if (value instanceof Map<?, ?> map) {
            packer.packMapHeader(map.size());
            for (Map.Entry<?, ?> entry : map.entrySet()) {
                pack(packer, entry.getKey());
                pack(packer, entry.getValue());
            }
        } else if (value instanceof Messages.Word word) {
            packer.packString(word.word());
        } else if (value instanceof Record record) {
            pack(packer, params(record));
        } else {
            throw new MotionException.Protocol("a " + value.getClass().getSimpleName() + " cannot be sent");
        }
    }

    /** Reads one value: null, Boolean, Long (BigInteger beyond it), Double, String, byte[], List or Map. */
    static Object unpack(byte[] payload) {
        try (MessageUnpacker unpacker = MessagePack.newDefaultUnpacker(payload)) {
            return unpack(unpacker, DEEPEST);
        } catch (IOException | MessagePackException | ArithmeticException error) {
            throw new MotionException.Protocol("the payload is no MessagePack: " + error.getMessage());
        }
    }

    private static Object unpack(MessageUnpacker unpacker, int depth) throws IOException {
        if (depth == 0) {
            throw new MotionException.Protocol("the payload is nested more than " + DEEPEST + " deep");
        }
        switch (unpacker.getNextFormat().getValueType()) {
            case NIL:
                unpacker.unpackNil();
                return null;
            case BOOLEAN:
                return unpacker.unpackBoolean();
            case INTEGER: {
                BigInteger number = unpacker.unpackBigInteger();
                if (number.bitLength() < Long.SIZE) {
                    return number.longValue();
                }
                // a value of a drive: nothing else is so large
                return number;
            }
            case FLOAT:
                return unpacker.unpackDouble();
            case STRING:
                return text(read(unpacker, unpacker.unpackRawStringHeader()));
            case BINARY:
                return read(unpacker, unpacker.unpackBinaryHeader());
            case ARRAY: {
                int size = unpacker.unpackArrayHeader();
                List<Object> list = new ArrayList<>(Math.min(Math.max(size, 0), 1024));
                for (long left = size & 0xffffffffL; left > 0; left--) {
                    list.add(unpack(unpacker, depth - 1));
                }
                return list;
            }
            case MAP: {
                int size = unpacker.unpackMapHeader();
                Map<Object, Object> map = new LinkedHashMap<>();
                for (long left = size & 0xffffffffL; left > 0; left--) {
                    map.put(unpack(unpacker, depth - 1), unpack(unpacker, depth - 1));
                }
                return map;
            }
            default: {
                // an extension: a value that only later versions can mean something by
                int size = unpacker.unpackExtensionTypeHeader().getLength();
                return read(unpacker, size);
            }
        }
    }

    /** Reads so many bytes, growing with what is there and not with what is claimed. */
    private static byte[] read(MessageUnpacker unpacker, int size) throws IOException {
        if (size < 0) {
            throw new MotionException.Protocol("a text or data of more than 2 GiB");
        }
        byte[] bytes = new byte[0];
        while (bytes.length < size) {
            int more = Math.min(size - bytes.length, 1 << 20);
            byte[] piece = unpacker.readPayload(more);
            int before = bytes.length;
            bytes = Arrays.copyOf(bytes, before + more);
            System.arraycopy(piece, 0, bytes, before, more);
        }
        return bytes;
    }

    private static String text(byte[] bytes) {
        try {
            return StandardCharsets.UTF_8.newDecoder().onMalformedInput(CodingErrorAction.REPORT).decode(ByteBuffer.wrap(bytes)).toString();
        } catch (CharacterCodingException error) {
            throw new MotionException.Protocol("a text is no UTF-8");
        }
    }

    /** Reads a message from its bytes. */
    static <T extends Record> T decode(Class<T> kind, byte[] payload) {
        return read(kind, unpack(payload));
    }

    /** Takes a map as a record: unknown keys are skipped, what is left out has its default. */
    static <T extends Record> T read(Class<T> kind, Object value) {
        if (!(value instanceof Map<?, ?> map)) {
            throw refused(kind, "it is no map");
        }
        RecordComponent[] components = kind.getRecordComponents();
        Object[] arguments = new Object[components.length];
        Class<?>[] types = new Class<?>[components.length];
        for (int index = 0; index < components.length; index++) {
            RecordComponent component = components[index];
            types[index] = component.getType();
            String key = keyOf(component);
            Messages.Sparse sparse = component.getAnnotation(Messages.Sparse.class);
            if (map.containsKey(key)) {
                Object given = map.get(key);
                if (types[index] == Object.class && (given instanceof Map || given instanceof List || given instanceof byte[])) {
                    throw refused(kind, key + " is of another type");
                }
                boolean nil = sparse != null || component.isAnnotationPresent(Messages.Nil.class);
                arguments[index] = convert(kind, key, component.getGenericType(), given, nil);
            } else if (sparse != null) {
                arguments[index] = absent(component.getType(), sparse.value());
            } else {
                throw refused(kind, key + " is missing");
            }
        }
        try {
            Constructor<T> constructor = kind.getDeclaredConstructor(types);
            return constructor.newInstance(arguments);
        } catch (ReflectiveOperationException error) {
            throw new IllegalStateException(error);
        }
    }

    static String keyOf(RecordComponent component) {
        return component.getName().replaceAll("([A-Z])", "_$1").toLowerCase(java.util.Locale.ROOT);
    }

    /** The constant of a word; UNKNOWN for one of a later version. */
    private static Object wordOf(Class<?> type, String word) {
        Object unknown = null;
        for (Object each : type.getEnumConstants()) {
            if (((Messages.Word) each).word().equals(word)) {
                return each;
            }
            unknown = each;
        }
        return unknown;
    }

    /** A request as a map for {@link #encode}. */
    static Map<String, Object> params(Record request) {
        Map<String, Object> params = new LinkedHashMap<>();
        try {
            for (RecordComponent component : request.getClass().getRecordComponents()) {
                Object value = component.getAccessor().invoke(request);
                params.put(keyOf(component), value instanceof Messages.Word word ? word.word() : value);
            }
        } catch (ReflectiveOperationException error) {
            throw new IllegalStateException(error);
        }
        return params;
    }

    private static Object absent(Class<?> type, String written) {
        if (type == long.class) {
            return written.isEmpty() ? 0L : Long.parseLong(written);
        } else if (type == double.class) {
            return written.isEmpty() ? 0.0 : Double.parseDouble(written);
        } else if (type == boolean.class) {
            return Boolean.parseBoolean(written);
        } else if (type == List.class) {
            return List.of();
        } else if (type == Map.class) {
            return Map.of();
        }
        if (type.isEnum()) {
            return written.isEmpty() ? null : wordOf(type, written);
        }
        return type != String.class || written.equals("null") ? null : written;
    }

    private static Object convert(Class<?> kind, String key, Type type, Object value, boolean sparse) {
        if (type instanceof ParameterizedType generic) {
            if (generic.getRawType() == List.class && value instanceof List<?> list) {
                List<Object> converted = new ArrayList<>(list.size());
                for (Object each : list) {
                    converted.add(convert(kind, key, generic.getActualTypeArguments()[0], each, false));
                }
                return Collections.unmodifiableList(converted);
            }
            if (generic.getRawType() == Map.class && value instanceof Map<?, ?> map) {
                Map<Object, Object> converted = new LinkedHashMap<>();
                map.forEach((name, each) ->
                        converted.put(name, convert(kind, key, generic.getActualTypeArguments()[1], each, false)));
                return Collections.unmodifiableMap(converted);
            }
        } else if (type == Object.class) {
            return value;
        } else if (value == null && sparse && !((Class<?>) type).isPrimitive()) {
            return null;
        } else if ((type == long.class || type == Long.class) && value instanceof Long) {
            return value;
        } else if ((type == double.class || type == Double.class) && value instanceof Number number) {
            return number.doubleValue();
        } else if (((type == boolean.class || type == Boolean.class) && value instanceof Boolean)
                || (type == String.class && value instanceof String)
                || (type == byte[].class && value instanceof byte[])) {
            return value;
        } else if (type instanceof Class<?> words && words.isEnum() && value instanceof String word) {
            return wordOf(words, word);
        } else if (type instanceof Class<?> other && other.isRecord()) {
            return read(other.asSubclass(Record.class), value);
        }
        throw refused(kind, key + " is of another type");
    }

    /** Reads the array {@code [seq, t, bin]}; further elements are a later version's. */
    static TelemetryBlock block(Object value) {
        if (value instanceof List<?> list && list.size() >= 3 && list.get(0) instanceof Long seq
                && list.get(1) instanceof Number t && list.get(2) instanceof byte[] rows) {
            return new TelemetryBlock(seq, t.doubleValue(), rows);
        }
        throw refused(TelemetryBlock.class, "it is no array [seq, t, bin]");
    }

    /** Payload of the topic {@code samples}: number and time of the first cycle, and rows of float32. */
    record TelemetryBlock(long seq, double t, byte[] rows) {}

    private static MotionException.Protocol refused(Class<?> kind, String why) {
        return new MotionException.Protocol("the message is no " + kind.getSimpleName() + ": " + why);
    }
}
