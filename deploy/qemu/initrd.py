"""The guest's first file system: a cpio archive in memory, "newc" of the kernel's initramfs buffer format."""

from __future__ import annotations

import gzip
import stat
from collections.abc import Mapping

MAGIC = "070701"
ALIGNMENT = 4
FOLDER = stat.S_IFDIR | 0o755
FILE = stat.S_IFREG | 0o755
DEVICE = stat.S_IFCHR | 0o600
# the kernel opens it before /init can mount anything
CONSOLE = (5, 1)


def archive(files: Mapping[str, bytes]) -> bytes:
    """A gzipped archive of executable files and the folders that they need, with ``/dev/console``.

    Args:
        files: path without leading slash → content.
    """
    folders = {"dev"}
    for path in files:
        parts = path.split("/")[:-1]
        folders.update("/".join(parts[:count]) for count in range(1, len(parts) + 1))
    entries = [_entry(number, path, FOLDER, b"") for number, path in enumerate(sorted(folders), 1)]
    entries.append(_entry(len(entries) + 1, "dev/console", DEVICE, b"", CONSOLE))
    for path, content in sorted(files.items()):
        entries.append(_entry(len(entries) + 1, path, FILE, content))
    entries.append(_entry(0, "TRAILER!!!", 0, b""))
    return gzip.compress(b"".join(entries), compresslevel=1, mtime=0)


def _entry(number: int, path: str, mode: int, content: bytes, device: tuple[int, int] = (0, 0)) -> bytes:
    name = path.encode() + b"\0"
    links = 2 if stat.S_ISDIR(mode) else 1
    # inode, mode, uid, gid, links, mtime, size, its device, what device it is, length of the name, checksum
    fields = (number, mode, 0, 0, links, 0, len(content), 0, 0, *device, len(name), 0)
    header = MAGIC + "".join(f"{field:08x}" for field in fields)
    return _padded(header.encode() + name) + _padded(content)


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % ALIGNMENT)
