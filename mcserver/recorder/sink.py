"""Files written by a thread of their own: a disk that is slow or full costs the files, and nothing else."""

from __future__ import annotations

import contextlib
import os
import queue
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

import msgspec

from mcserver.recorder.chunks import Chunk
from mcserver.recorder.folder import RecordingFolder
from mcserver.recorder.mcap_file import McapFile

Metadata = Mapping[str, Mapping[str, str]]


class Written(msgspec.Struct, frozen=True):
    """A file is whole; ``lost`` chunks found no room on the way to it."""

    name: str
    size: int
    lost: int = 0


class NotWritten(msgspec.Struct, frozen=True):
    """A file could not be written to its end; ``kept``: what was written before it stays, and opens."""

    name: str
    message: str
    kept: bool


class Sink:
    """One file to be: chunks in, in order; whole under its name at the end."""

    def __init__(self, name: str, metadata: Metadata) -> None:
        self.name = name
        self.metadata = metadata
        self.lost = 0
        # the rest belongs to the writer's thread
        self.file: McapFile | None = None
        self.descriptor = -1
        self.failure: str | None = None
        self.good_bytes = 0


class FileWriter:
    """Writes several files; its methods return at once, and what became of a file is in `outcomes`.

    Args:
        folder: where to. open_file: makes the file's format over a stream.
        max_waiting: bytes that may wait for the disk; what comes beyond is left out and counted.
        min_free: bytes that stay free on the disk for others: the journal lies there too.
    """

    def __init__(
        self,
        folder: RecordingFolder,
        open_file: Callable[[BinaryIO, Metadata], McapFile],
        max_waiting: int,
        min_free: int,
    ) -> None:
        self._folder = folder
        self._open_file = open_file
        self._max_waiting = max_waiting
        self._min_free = min_free
        self._waiting = 0
        self._lock = threading.Lock()
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self.outcomes: queue.SimpleQueue[Written | NotWritten] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="files", daemon=True)
        self._thread.start()

    def begin(self, name: str, metadata: Metadata) -> Sink:
        """Return a file of that name; a missing folder is made."""
        sink = Sink(name, metadata)
        self._jobs.put(lambda: self._begin(sink))
        return sink

    def add(self, sink: Sink, chunks: Sequence[Chunk]) -> None:
        """Chunks that follow."""
        for chunk in chunks:
            with self._lock:
                if self._waiting + len(chunk.data) > self._max_waiting:
                    sink.lost += 1
                    continue
                self._waiting += len(chunk.data)
            self._jobs.put(lambda chunk=chunk: self._add(sink, chunk))  # type: ignore[misc]

    def add_made(self, sink: Sink, make: Callable[[], Chunk | None]) -> None:
        """A chunk that is made when its turn comes, in the thread: it may read files."""
        self._jobs.put(lambda: self._add_made(sink, make))

    def finish(self, sink: Sink) -> None:
        """No more chunks."""
        self._jobs.put(lambda: self._finish(sink))

    def close(self, timeout_s: float) -> None:
        """Wait for what is to be written, within a limit."""
        self._jobs.put(None)
        self._thread.join(timeout_s)

    # ------------------------------------------------------------ in the thread

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            job()

    def _begin(self, sink: Sink) -> None:
        path = self._folder.unfinished(sink.name)
        try:
            self._folder.path.mkdir(parents=True, exist_ok=True)
            if self._folder.room() < self._min_free:
                sink.failure = f"less than {self._min_free >> 20} MiB are free on the disk"
                return
            sink.descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o640)
            stream = os.fdopen(os.dup(sink.descriptor), "wb", buffering=0)
            try:
                sink.file = self._open_file(stream, sink.metadata)
            except BaseException:
                stream.close()
                raise
            sink.good_bytes = sink.file.size
        except OSError as error:
            sink.failure = error.strerror or str(error)

    def _add(self, sink: Sink, chunk: Chunk) -> None:
        with self._lock:
            self._waiting -= len(chunk.data)
        self._write(sink, chunk)

    def _add_made(self, sink: Sink, make: Callable[[], Chunk | None]) -> None:
        chunk = make()
        if chunk is not None:
            self._write(sink, chunk)

    def _write(self, sink: Sink, chunk: Chunk) -> None:
        if sink.failure is not None or sink.file is None:
            return
        try:
            if self._folder.room() < self._min_free:
                sink.failure = f"less than {self._min_free >> 20} MiB are free on the disk"
                return
            sink.file.add(chunk)
            sink.good_bytes = sink.file.size
        except OSError as error:
            sink.failure = error.strerror or str(error)

    def _finish(self, sink: Sink) -> None:
        unfinished, finished = self._folder.unfinished(sink.name), self._folder.finished(sink.name)
        failure = sink.failure
        size = 0
        if sink.file is not None:
            try:
                # of a chunk that did not fit only a part may be there
                os.ftruncate(sink.descriptor, sink.good_bytes)
                os.lseek(sink.descriptor, 0, os.SEEK_END)
                sink.file.finish()
                os.fsync(sink.descriptor)
                size = os.fstat(sink.descriptor).st_size
                os.replace(unfinished, finished)
            except OSError as error:
                failure = failure or error.strerror or str(error)
                with contextlib.suppress(OSError):
                    os.ftruncate(sink.descriptor, sink.good_bytes)
        if sink.file is not None:
            sink.file.close()
        if sink.descriptor >= 0:
            os.close(sink.descriptor)
            sink.descriptor = -1
        if failure is None:
            self.outcomes.put(Written(sink.name, size, sink.lost))
        else:
            self.outcomes.put(NotWritten(sink.name, failure, kept=_exists(finished) or _exists(unfinished)))


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:
        return False
