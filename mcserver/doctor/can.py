"""CAN: the kernel's ability, the interfaces, their queues and error counters."""

from __future__ import annotations

import shutil
import socket
import subprocess
from pathlib import Path
from typing import Any

import msgspec

from mcserver.doctor.files import read_int, read_text
from mcserver.doctor.finding import Finding, advice, good

AREA = "can"
ARPHRD_CAN = 280  # linux/if_arp.h
LEAST_QUEUE = 128


class CanInterface(msgspec.Struct, frozen=True):
    """One CAN network interface.

    Attributes:
        state: ``ERROR-ACTIVE``, ``ERROR-WARNING``, ``ERROR-PASSIVE``, ``BUS-OFF`` or ``STOPPED``; empty for
            virtual ones.
        tx_errors, rx_errors: the controller's error counters, None where unknown.
        bitrate: [bit/s], None for virtual ones.
    """

    name: str
    up: bool
    queue: int
    state: str = ""
    tx_errors: int | None = None
    rx_errors: int | None = None
    bitrate: int | None = None


class CanFacts(msgspec.Struct, frozen=True):
    """Whether the kernel opens CAN sockets, whether it has vcan, and the interfaces."""

    sockets: bool
    virtual: bool
    interfaces: tuple[CanInterface, ...]


def probe_can() -> CanFacts:
    """Look at the kernel and at ``/sys/class/net``."""
    details = _details()
    interfaces = []
    for folder in sorted(Path("/sys/class/net").glob("*")):
        if read_int(folder / "type") == ARPHRD_CAN:
            interfaces.append(_interface(folder, details.get(folder.name, {})))
    return CanFacts(
        sockets=_opens_socket(),
        virtual=Path("/sys/module/vcan").exists() or any(not each.state for each in interfaces),
        interfaces=tuple(interfaces),
    )


def _opens_socket() -> bool:
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except (OSError, AttributeError):
        return False
    return True


def _details() -> dict[str, dict[str, Any]]:
    """Return what ``ip`` tells of CAN interfaces by name; empty where it is not installed."""
    command = shutil.which("ip")
    if command is None:
        return {}
    try:
        found = subprocess.run(
            [command, "-json", "-details", "link", "show", "type", "can"],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=5,
            check=False,
        )
        links = msgspec.json.decode(found.stdout or b"[]", type=list[dict[str, Any]])
    except (OSError, subprocess.TimeoutExpired, msgspec.DecodeError):
        return {}
    return {str(link.get("ifname", "")): link for link in links}


def _interface(folder: Path, detail: dict[str, Any]) -> CanInterface:
    info: dict[str, Any] = detail.get("linkinfo", {}).get("info_data", {})
    counters: dict[str, Any] = info.get("berr_counter", {})
    return CanInterface(
        name=folder.name,
        up=bool(int(read_text(folder / "flags") or "0", 16) & 1),
        queue=read_int(folder / "tx_queue_len") or 0,
        state=str(info.get("state", "")),
        tx_errors=counters.get("tx"),
        rx_errors=counters.get("rx"),
        bitrate=info.get("bittiming", {}).get("bitrate"),
    )


def judge_can(facts: CanFacts) -> list[Finding]:
    """Findings about CAN; a computer without it runs simulated drives."""
    if not facts.sockets:
        return [
            advice(
                AREA,
                "SocketCAN",
                "this kernel opens no CAN sockets: simulated drives only",
                "modprobe can can_raw; without it, python-can's socketcand brings a bus over the network",
            )
        ]
    findings = [good(AREA, "SocketCAN", "available")]
    if not facts.interfaces:
        found = "none; vcan is loaded" if facts.virtual else "none"
        findings.append(
            advice(
                AREA,
                "interfaces",
                found,
                "ip link set can0 up type can bitrate 1000000, or without hardware: "
                "modprobe vcan; ip link add vcan0 type vcan; ip link set vcan0 up",
            )
        )
    for interface in facts.interfaces:
        findings.append(_judge_interface(interface))
    return findings


def _judge_interface(interface: CanInterface) -> Finding:
    name = interface.name
    if not interface.up:
        return advice(AREA, name, "down", f"ip link set {name} up")
    if interface.state == "BUS-OFF":
        return advice(
            AREA,
            name,
            "bus off",
            f"check wiring, termination and bit rate; then ip link set {name} type can restart",
        )
    if interface.queue < LEAST_QUEUE:
        return advice(
            AREA,
            name,
            f"its queue holds {interface.queue} frames: a burst of one cycle may not fit",
            f"ip link set {name} txqueuelen 1000",
        )
    errors = max(interface.tx_errors or 0, interface.rx_errors or 0)
    if errors > 0 or interface.state in ("ERROR-WARNING", "ERROR-PASSIVE"):
        return advice(
            AREA,
            name,
            f"{interface.state or 'up'}, error counters tx {interface.tx_errors} rx {interface.rx_errors}",
            "check wiring, the two 120 Ω terminators and that every node has the same bit rate",
        )
    rate = f", {interface.bitrate // 1000} kbit/s" if interface.bitrate else ""
    return good(AREA, name, f"up{rate}, queue of {interface.queue} frames")
