"""Debian's kernel and some of its modules, out of the package and without installing it."""

from __future__ import annotations

import lzma
import os
import re
import shutil
import subprocess
import tarfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from deploy.qemu.errors import RigError

# The cloud kernel (linux-image-cloud-amd64) has no CAN modules.
META_PACKAGE = "linux-image-amd64"
# Where the modules below and what they need lie.
FOLDERS = (
    *("drivers/net/can/", "drivers/virtio/", "fs/9p/", "fs/fscache/", "fs/netfs/", "fs/overlayfs/"),
    *("net/9p/", "net/can/", "net/sched/"),
)
# sch_tbf slows an interface down, so that its queue can be filled
MODULES = ("virtio_pci", "9pnet_virtio", "9p", "overlay", "can", "can_raw", "vcan", "sch_tbf")
DOWNLOAD_LIMIT_S = 600.0
DEPENDS = re.compile(rb"\0depends=([^\0]*)\0")


@dataclass(frozen=True)
class Kernel:
    """An extracted kernel.

    Attributes:
        image: for QEMU's ``-kernel``. modules: in the order in which they have to be loaded.
    """

    image: Path
    modules: tuple[Path, ...]


def kernel(cache: Path) -> Kernel:
    """The kernel in the cache; fetched from Debian's archive on first use.

    Raises:
        RigError: the package is not to be had, or lacks a module.
    """
    ready = cache / "kernel"
    if not (ready / "vmlinuz").is_file():
        cache.mkdir(parents=True, exist_ok=True)
        unpacked = cache / "kernel.part"
        shutil.rmtree(unpacked, ignore_errors=True)
        unpack(download(cache), unpacked)
        shutil.rmtree(ready, ignore_errors=True)
        unpacked.rename(ready)
    files = {module_name(path.name): path for path in ready.glob("*.ko")}
    built_in = {module_name(PurePosixPath(line).name) for line in _lines(ready / "modules.builtin")}
    order = load_order(MODULES, {name: depends(path.read_bytes()) for name, path in files.items()}, built_in)
    return Kernel(ready / "vmlinuz", tuple(files[name] for name in order))


def _lines(path: Path) -> list[str]:
    return path.read_text("utf-8").splitlines()


def module_name(file: str) -> str:
    """As the kernel calls it: ``can-raw.ko.xz`` is ``can_raw``."""
    return file.partition(".")[0].replace("-", "_")


def depends(module: bytes) -> tuple[str, ...]:
    """Names of the modules that a module's own information says it needs."""
    found = DEPENDS.search(module)
    names = found[1].decode().split(",") if found else []
    return tuple(module_name(name) for name in names if name)


def load_order(
    wanted: Iterable[str], needs: Mapping[str, Iterable[str]], built_in: set[str]
) -> tuple[str, ...]:
    """The wanted modules, each behind what it needs.

    Raises:
        RigError: one is neither a module nor built into the kernel.
    """
    order: list[str] = []

    def add(name: str) -> None:
        if name in order or name in built_in:
            return
        if name not in needs:
            raise RigError(
                f"the kernel has no module {name}", f"use Debian's {META_PACKAGE}, not the cloud kernel"
            )
        for each in needs[name]:
            add(each)
        order.append(name)

    for name in wanted:
        add(name)
    return tuple(order)


def download(folder: Path) -> Path:
    """The kernel's package, by apt-get; its lists are renewed once where they are too old.

    Raises:
        RigError: no apt-get, or it does not get the package.
    """
    if shutil.which("apt-get") is None:
        raise RigError("there is no apt-get here", "the rig takes its kernel from Debian's archive")
    for old in folder.glob("linux-image-*.deb"):
        old.unlink()
    answer = ""
    for renew in (False, True):
        if renew and os.geteuid() == 0:
            _call(["apt-get", "update", "-qq"], folder)
        package = kernel_package(_call(["apt-cache", "depends", META_PACKAGE], folder)[1])
        if package is not None:
            code, answer = _call(["apt-get", "download", "-qq", package], folder)
            found = list(folder.glob("linux-image-*.deb"))
            if code == 0 and found:
                return found[0]
    raise RigError(f"Debian's kernel cannot be fetched: {answer.strip() or 'no ' + META_PACKAGE}", UPDATE)


UPDATE = "apt-get update, as root, and try again"


def kernel_package(answer: str) -> str | None:
    """The package behind the meta package, in what ``apt-cache depends`` has said."""
    found = re.search(r"Depends: (linux-image-\S+)", answer)
    return found[1] if found else None


def _call(command: list[str], folder: Path) -> tuple[int, str]:
    ended = subprocess.run(
        command,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=DOWNLOAD_LIMIT_S,
        check=False,
    )
    return ended.returncode, ended.stdout + ended.stderr


def unpack(package: Path, folder: Path) -> None:
    """Takes the kernel's image and the modules of `FOLDERS`, and removes the package.

    Raises:
        RigError: no kernel is in it.
    """
    folder.mkdir(parents=True)
    with subprocess.Popen(["dpkg-deb", "--fsys-tarfile", str(package)], stdout=subprocess.PIPE) as running:
        assert running.stdout is not None
        with tarfile.open(fileobj=running.stdout, mode="r|") as files:
            for entry in files:
                name = _kept_as(entry.name)
                content = files.extractfile(entry) if name is not None and entry.isfile() else None
                if name is not None and content is not None:
                    data = content.read()
                    if name.endswith(".xz"):
                        name, data = name.removesuffix(".xz"), lzma.decompress(data)
                    (folder / name).write_bytes(data)
    if not (folder / "vmlinuz").is_file():
        raise RigError(f"{package.name} holds no kernel", f"remove {folder.parent} and try again")
    package.unlink()


def _kept_as(name: str) -> str | None:
    path = PurePosixPath(name)
    if path.name.startswith("vmlinuz-"):
        return "vmlinuz"
    if path.name == "modules.builtin":
        return path.name
    inside = name.partition("/kernel/")[2]
    return path.name if inside.startswith(FOLDERS) and ".ko" in path.suffixes else None
