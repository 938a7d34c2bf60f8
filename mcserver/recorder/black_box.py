"""The last minutes as chunks in memory, bounded in time and in bytes."""

from __future__ import annotations

from collections import deque

from mcserver.recorder.chunks import Chunk


class BlackBox:
    """The newest chunks.

    Args:
        span_s: how far back. max_bytes: of all chunks; where they are larger, the span is shorter.

    Attributes:
        size: bytes held.
    """

    def __init__(self, span_s: float, max_bytes: int) -> None:
        self._span_ns = round(span_s * 1e9)
        self._max_bytes = max_bytes
        self._chunks: deque[Chunk] = deque()
        self.size = 0

    def add(self, chunk: Chunk) -> None:
        """Take a chunk, and let go of those that are too old or too many; the newest always stays."""
        self._chunks.append(chunk)
        self.size += len(chunk.data)
        while len(self._chunks) > 1 and (
            self.size > self._max_bytes or self._chunks[0].end_ns < chunk.end_ns - self._span_ns
        ):
            self.size -= len(self._chunks.popleft().data)

    @property
    def chunks(self) -> list[Chunk]:
        """Oldest first."""
        return list(self._chunks)

    @property
    def start_ns(self) -> int:
        """Time of the first message that is held [ns]; 0 where nothing is."""
        return self._chunks[0].start_ns if self._chunks else 0

    @property
    def span_s(self) -> float:
        """Time from the first to the last message that is held [s]."""
        if not self._chunks:
            return 0.0
        return (self._chunks[-1].end_ns - self._chunks[0].start_ns) * 1e-9
