"""Long programs that clients hand over by parts, to be checked and simulated: files beside the journal."""

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

# Texts that are kept, the latest used; of one text, and of all [bytes].
TEXTS = 8
TEXT_BYTES = 512 << 20
ALL_BYTES = 1 << 30
# What stays free on the disk, which is the journal's too [bytes].
FREE_BYTES = 256 << 20
_FILE = re.compile(r"[0-9a-f]{1,64}\.gcode")


class KeptText:
    """One text.

    Attributes:
        sha256: of the whole of it. size: of the whole of it [bytes]. received: so much is there [bytes].
        lines: how many it has so far. path: the file. complete: all is there, and is what the hash says.
        checked: the switches with which a check has found no fault in it; None: there was none.
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
        """Write the next part.

        Raises:
            OSError: it cannot be written; nothing of it is kept.
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
            # a last line without an end counts too
            self.lines += self._last != b"\n"
            self.complete = self._digest.hexdigest() == self.sha256


class KeptTexts:
    """The texts of one start of a service.

    Args:
        folder: for them; what an earlier start left in it goes.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._texts: OrderedDict[str, KeptText] = OrderedDict()
        self._remove_files()

    def take(self, sha256: str, size: int, offset: int, part: bytes) -> KeptText:
        """Take a part of a text; writes to the disk, for one caller at a time.

        Args:
            size: of the whole text [bytes]. offset: of the part [bytes]; one that does not begin where the
                parts before it end changes nothing.

        Raises:
            Refused: MC591 there is no room for it; MC590 the text is not what its hash says.
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
        """Return a text that is there as a whole.

        Raises:
            Refused: MC590 it is not.
        """
        text = self._texts.get(sha256)
        if text is None or not text.complete:
            raise Refused("MC590", "no text with this hash is kept", "send it by `put_text` first")
        self._texts.move_to_end(sha256)
        return text

    def has(self, sha256: str | None) -> bool:
        """Return whether a text is there as a whole."""
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
        """Remove files named like texts, and the folder where it is empty then; nothing else."""
        with contextlib.suppress(OSError):
            for each in self._folder.iterdir():
                if _FILE.fullmatch(each.name):
                    each.unlink(missing_ok=True)
            self._folder.rmdir()

    def _drop(self, sha256: str) -> None:
        """Forget a text; who reads its file still reads on."""
        text = self._texts.pop(sha256, None)
        if text is not None:
            text.path.unlink(missing_ok=True)


_NO_ROOM = "make room on the server's disk, or run it without a check"
