"""Long programs that clients upload in parts for check and simulation, as files beside the journal."""

from __future__ import annotations

import contextlib
import hashlib
import re
import shutil
from collections import OrderedDict
from pathlib import Path

from mcserver.errors import Refused
from mcserver.gcode.switches import Switches
from mcserver.service.kept_file import private

# Most texts kept, the last used ones; most bytes of one text, and of all together.
TEXTS = 8
TEXT_BYTES = 512 << 20
ALL_BYTES = 1 << 30
# Space to leave free on the disk, which the journal uses too [bytes].
FREE_BYTES = 256 << 20
_FILE = re.compile(r"[0-9a-f]{1,64}\.gcode")


class KeptText:
    """An uploaded text.

    Attributes:
        sha256, size: of the whole text [bytes]. received: so far [bytes].
        lines: received so far. path: of the file. complete: everything is received and matches the hash.
        checked: switches of a check without faults; None: there was none.
    """

    def __init__(self, sha256: str, size: int, path: Path) -> None:
        self.sha256 = sha256
        self.size = size
        self.path = path
        self.received = 0
        self.lines = 0
        self.complete = False
        self.checked: Switches | None = None
        self._digest = hashlib.sha256()
        self._last = b"\n"

    def append(self, part: bytes) -> None:
        """Append the next part.

        Raises:
            OSError: it cannot be written; nothing of the part is kept.
        """
        with open(self.path, "r+b" if self.received else "wb", opener=private) as file:
            file.seek(self.received)
            file.write(part)
            file.flush()
        self.received += len(part)
        self.lines += part.count(b"\n")
        self._last = part[-1:] or self._last
        self._digest.update(part)
        if self.received == self.size:
            # count a last line without a line end
            self.lines += self._last != b"\n"
            self.complete = self._digest.hexdigest() == self.sha256


class KeptTexts:
    """Texts uploaded in one start of a service.

    Args:
        folder: of the files; those of an earlier start are removed.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._texts: OrderedDict[str, KeptText] = OrderedDict()
        self._remove_files()

    def take(self, sha256: str, size: int, offset: int, part: bytes) -> KeptText:
        """Store a part of a text; writes to the disk, by one caller at a time.

        Args:
            size: of the whole text [bytes]. offset: of the part [bytes]; a part that does not begin at the
                end of those before changes nothing.

        Raises:
            Refused: MC591 no room; MC590 the text does not match its hash.
        """
        text = self._texts.get(sha256)
        if text is None or text.size != size:
            text = self._begin(sha256, size)
        self._texts.move_to_end(sha256)
        if offset == text.received and part and text.received + len(part) <= size:
            try:
                text.append(part)
            except OSError as error:
                self._drop(sha256)
                raise Refused("MC591", f"the text cannot be kept: {error.strerror}", _NO_ROOM) from error
        if text.received == size and not text.complete:
            self._drop(sha256)
            raise Refused("MC590", "the text is not what its hash says", "send the whole of it again")
        return text

    def find(self, sha256: str) -> KeptText:
        """Return a complete text.

        Raises:
            Refused: MC590 it is not complete.
        """
        text = self._texts.get(sha256)
        if text is None or not text.complete:
            raise Refused("MC590", "no text with this hash is kept", "send it by `put_text` first")
        self._texts.move_to_end(sha256)
        return text

    def has(self, sha256: str | None) -> bool:
        """Return whether a text is complete."""
        text = self._texts.get(sha256 or "")
        return text is not None and text.complete

    def close(self) -> None:
        """Remove all of them."""
        self._texts.clear()
        self._remove_files()

    def _begin(self, sha256: str, size: int) -> KeptText:
        if size > TEXT_BYTES:
            raise Refused(
                "MC591", f"a text may have {TEXT_BYTES >> 20} MiB", "run it without a check", limit=TEXT_BYTES
            )
        self._drop(sha256)
        while self._texts and (
            len(self._texts) >= TEXTS or sum(each.size for each in self._texts.values()) + size > ALL_BYTES
        ):
            self._drop(next(iter(self._texts)))
        try:
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            free = shutil.disk_usage(self._folder).free
        except OSError as error:
            raise Refused("MC591", f"the text cannot be kept: {error.strerror}", _NO_ROOM) from error
        if free < size + FREE_BYTES:
            raise Refused("MC591", "the disk is too full to keep the text", _NO_ROOM)
        text = self._texts[sha256] = KeptText(sha256, size, self._folder / f"{sha256}.gcode")
        return text

    def _remove_files(self) -> None:
        """Remove files named like texts, and the folder if it is then empty; nothing else."""
        with contextlib.suppress(OSError):
            for each in self._folder.iterdir():
                if _FILE.fullmatch(each.name):
                    each.unlink(missing_ok=True)
            self._folder.rmdir()

    def _drop(self, sha256: str) -> None:
        """Remove a text; readers that have its file open can continue."""
        text = self._texts.pop(sha256, None)
        if text is not None:
            text.path.unlink(missing_ok=True)


_NO_ROOM = "make room on the server's disk, or run it without a check"
