"""The parts of the QEMU rig that need no QEMU; `make socketcan` runs the whole."""

from __future__ import annotations

import gzip
import io
import stat

import pytest

from deploy.qemu.errors import RigError
from deploy.qemu.guest import follow
from deploy.qemu.initrd import archive
from deploy.qemu.kernel import depends, kernel_package, load_order, module_name

MARK = b"rig-0123456789abcdef"


def entries(data: bytes) -> dict[str, tuple[int, bytes]]:
    """Path → mode and content, read as the kernel's buffer format says."""
    found: dict[str, tuple[int, bytes]] = {}
    at = 0
    while True:
        assert data[at : at + 6] == b"070701"
        fields = [int(data[start : start + 8], 16) for start in range(at + 6, at + 110, 8)]
        mode, size, length = fields[1], fields[6], fields[11]
        name = data[at + 110 : at + 110 + length - 1].decode()
        begin = (at + 110 + length + 3) // 4 * 4
        at = (begin + size + 3) // 4 * 4
        if name == "TRAILER!!!":
            return found
        found[name] = (mode, data[begin : begin + size])


def test_the_first_file_system_has_the_files_their_folders_and_a_console() -> None:
    found = entries(gzip.decompress(archive({"init": b"#!/bin/sh\n", "rig/deep/odd": b"12345"})))
    assert found["init"] == (stat.S_IFREG | 0o755, b"#!/bin/sh\n")
    assert found["rig/deep/odd"][1] == b"12345"
    assert stat.S_ISDIR(found["rig"][0])
    assert stat.S_ISDIR(found["rig/deep"][0])
    assert stat.S_ISCHR(found["dev/console"][0])
    assert list(found).index("rig") < list(found).index("rig/deep") < list(found).index("rig/deep/odd")


def test_modules_load_behind_what_they_need() -> None:
    needs = {"vcan": ("can_dev",), "can_dev": ("can",), "can": (), "9p": ("9pnet", "netfs"), "9pnet": ()}
    assert load_order(["vcan", "9p", "can"], needs, {"netfs"}) == ("can", "can_dev", "vcan", "9pnet", "9p")


def test_a_kernel_without_can_is_refused_by_name() -> None:
    with pytest.raises(RigError, match="no module can_raw"):
        load_order(["can_raw"], {"can": ()}, set())


def test_a_module_says_what_it_needs() -> None:
    assert depends(b"ELF\0license=GPL\0depends=can,can-dev\0name=vcan\0") == ("can", "can_dev")
    assert depends(b"ELF\0depends=\0name=can\0") == ()
    assert module_name("can-raw.ko.xz") == "can_raw"


def test_the_kernel_behind_the_meta_package_is_found() -> None:
    text = "linux-image-amd64\n  Depends: linux-image-6.1.0-56-amd64\n"
    assert kernel_package(text) == "linux-image-6.1.0-56-amd64"
    assert kernel_package("N: Unable to locate package\n") is None


@pytest.mark.parametrize("size", [1, 3, 7, 1000])
def test_output_is_the_commands_and_the_exit_code_is_behind_the_mark(size: int) -> None:
    text = b"rig-01 is no mark\n3 passed in 1 s\nri" + MARK + b" 5.\n"
    output = io.BytesIO()
    code = follow((text[at : at + size] for at in range(0, len(text), size)), MARK, output)
    assert code == 5
    assert output.getvalue() == b"rig-01 is no mark\n3 passed in 1 s\nri"


def test_a_machine_that_ends_early_gives_no_exit_code() -> None:
    output = io.BytesIO()
    assert follow(iter([b"half a ", b"line"]), MARK, output) is None
    assert output.getvalue() == b"half a line"
