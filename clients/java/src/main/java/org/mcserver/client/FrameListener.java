package org.mcserver.client;

import java.io.ByteArrayOutputStream;
import java.net.http.WebSocket;
import java.nio.ByteBuffer;
import java.util.concurrent.CompletionStage;

/** Puts the parts of frames together. */
final class FrameListener implements WebSocket.Listener {
    /** What a connection says; from threads of the HTTP client. */
    interface Events {
        void frame(WebSocket from, byte[] whole);

        /** The other end has answered a ping. */
        void alive();

        void lost(String reason);
    }

    private final ByteArrayOutputStream parts = new ByteArrayOutputStream();
    private final Events events;

    FrameListener(Events events) {
        this.events = events;
    }

    @Override
    public CompletionStage<?> onBinary(WebSocket from, ByteBuffer data, boolean last) {
        byte[] part = new byte[data.remaining()];
        data.get(part);
        parts.writeBytes(part);
        if (last) {
            byte[] whole = parts.toByteArray();
            parts.reset();
            events.frame(from, whole);
        }
        from.request(1);
        return null;
    }

    @Override
    public CompletionStage<?> onPong(WebSocket from, ByteBuffer message) {
        events.alive();
        from.request(1);
        return null;
    }

    @Override
    public CompletionStage<?> onClose(WebSocket from, int code, String reason) {
        events.lost("closed with " + code + (reason.isEmpty() ? "" : ": " + reason));
        return null;
    }

    @Override
    public void onError(WebSocket from, Throwable error) {
        events.lost(String.valueOf(error.getMessage()));
    }
}
