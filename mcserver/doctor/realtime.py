"""Whether a thread of this user can wake on time."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections import Counter
from pathlib import Path

import msgspec

from mcserver.doctor.files import read_int, read_text
from mcserver.doctor.finding import Finding, advice, good

AREA = "realtime"
GUIDE = "deploy/realtime.md"
FIFO_PRIORITY = 80
MEMLOCK_NEEDED = 256 * 1024 * 1024
_TRY_FIFO = f"import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({FIFO_PRIORITY}))"


class RealtimeFacts(msgspec.Struct, frozen=True):
    """What the kernel says.

    Attributes:
        fifo: a child could take SCHED_FIFO at the executor's priority.
        memlock: soft limit of locked memory [bytes], None where there is no limit.
        preemption: ``rt``, ``dynamic``, ``full``, ``voluntary``, ``none`` or empty where unknown.
        governors: how many CPUs use each frequency governor; empty where frequencies are not ours to govern.
        isolated: list of isolated CPUs as the kernel writes it.
        rt_runtime_us, rt_period_us: the share of time that realtime threads may take (-1: all of it).
        clock_source: the kernel's clock.
        cpus: how many this process may use.
    """

    fifo: bool
    memlock: int | None
    preemption: str
    governors: dict[str, int]
    isolated: str
    rt_runtime_us: int | None
    rt_period_us: int | None
    clock_source: str
    cpus: int


def probe_realtime() -> RealtimeFacts:
    """Read limits and kernel files, and try SCHED_FIFO in a child."""
    import resource  # of Unix alone; `--help` and `--version` import this module elsewhere, too

    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    governors = Counter(
        governor
        for path in Path("/sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor")
        if (governor := read_text(path)) is not None
    )
    return RealtimeFacts(
        fifo=_fifo_allowed(),
        memlock=None if soft == resource.RLIM_INFINITY or os.geteuid() == 0 else soft,
        preemption=_preemption(),
        governors=dict(governors),
        isolated=read_text("/sys/devices/system/cpu/isolated") or "",
        rt_runtime_us=read_int("/proc/sys/kernel/sched_rt_runtime_us"),
        rt_period_us=read_int("/proc/sys/kernel/sched_rt_period_us"),
        clock_source=read_text("/sys/devices/system/clocksource/clocksource0/current_clocksource") or "",
        cpus=len(os.sched_getaffinity(0)),
    )


def _fifo_allowed() -> bool:
    try:
        tried = subprocess.run(
            [sys.executable, "-I", "-S", "-c", _TRY_FIFO],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=20,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return tried.returncode == 0


def _preemption() -> str:
    if read_text("/sys/kernel/realtime") == "1":
        return "rt"
    built = platform.version()
    for mark, name in (("PREEMPT_RT", "rt"), ("PREEMPT_DYNAMIC", "dynamic"), ("PREEMPT", "full")):
        if mark in built:
            return name
    return ""


def judge_realtime(facts: RealtimeFacts) -> list[Finding]:
    """Findings about timing, most important first."""
    return [
        _judge_fifo(facts),
        _judge_memlock(facts),
        _judge_preemption(facts),
        _judge_governors(facts),
        _judge_isolation(facts),
        _judge_budget(facts),
        _judge_clock(facts),
    ]


def _judge_fifo(facts: RealtimeFacts) -> Finding:
    if facts.fifo:
        return good(AREA, "SCHED_FIFO", f"allowed at priority {FIFO_PRIORITY}")
    return advice(
        AREA,
        "SCHED_FIFO",
        "not allowed: the cycle runs at normal priority and will be late under load",
        "run by deploy/systemd/mcserver.service (LimitRTPRIO=90), or write '@realtime - rtprio 90' to "
        "/etc/security/limits.d/mcserver.conf; in a container: --cap-add SYS_NICE --ulimit rtprio=90",
    )


def _judge_memlock(facts: RealtimeFacts) -> Finding:
    if facts.memlock is None:
        return good(AREA, "locked memory", "not limited")
    shown = f"{facts.memlock // 1024 // 1024} MiB"
    if facts.memlock >= MEMLOCK_NEEDED:
        return good(AREA, "locked memory", shown)
    return advice(
        AREA,
        "locked memory",
        f"{shown}: mlockall may fail, page faults then delay the cycle",
        "LimitMEMLOCK=infinity in the systemd unit, or '@realtime - memlock unlimited' in limits.d; "
        "in a container: --ulimit memlock=-1",
    )


def _judge_preemption(facts: RealtimeFacts) -> Finding:
    if facts.preemption == "rt":
        return good(AREA, "kernel preemption", "PREEMPT_RT")
    shown = {"dynamic": "PREEMPT_DYNAMIC", "full": "PREEMPT"}.get(
        facts.preemption, "not known to be preemptible"
    )
    return advice(
        AREA,
        "kernel preemption",
        f"{shown}: wake-ups may be late by milliseconds under load",
        f"install a PREEMPT_RT kernel (Debian: apt-get install linux-image-rt-amd64); see {GUIDE}",
    )


def _judge_governors(facts: RealtimeFacts) -> Finding:
    if not facts.governors:
        return good(AREA, "CPU governor", "frequencies are not governed here")
    shown = ", ".join(f"{name} on {count}" for name, count in sorted(facts.governors.items()))
    if set(facts.governors) == {"performance"}:
        return good(AREA, "CPU governor", shown)
    return advice(
        AREA,
        "CPU governor",
        f"{shown}: a sleeping CPU wakes slowly",
        "cpupower frequency-set --governor performance",
    )


def _judge_isolation(facts: RealtimeFacts) -> Finding:
    if facts.isolated:
        return good(AREA, "isolated CPUs", facts.isolated)
    fix = (
        f"boot with isolcpus={facts.cpus - 1} nohz_full={facts.cpus - 1}; see {GUIDE}"
        if facts.cpus > 1
        else "use a computer with two or more CPUs: one for the cycle alone"
    )
    return advice(AREA, "isolated CPUs", f"none of {facts.cpus}: other work shares the cycle's CPU", fix)


def _judge_budget(facts: RealtimeFacts) -> Finding:
    title = "realtime budget"
    if facts.rt_runtime_us is None or facts.rt_period_us is None:
        return good(AREA, title, "not set by this kernel")
    if facts.rt_runtime_us < 0:
        return good(AREA, title, "not limited")
    share = facts.rt_runtime_us / max(facts.rt_period_us, 1)
    if share >= 0.5:
        return good(AREA, title, f"{share:.0%} of the time")
    return advice(
        AREA,
        title,
        f"{share:.0%} of the time: the kernel will stop the cycle when that is used up",
        "sysctl -w kernel.sched_rt_runtime_us=950000",
    )


def _judge_clock(facts: RealtimeFacts) -> Finding:
    title = "clock source"
    slow = {"hpet", "acpi_pm", "jiffies", "pit"}
    if facts.clock_source in slow:
        return advice(
            AREA,
            title,
            f"{facts.clock_source}: reading the time is slow",
            "boot with clocksource=tsc tsc=reliable",
        )
    return good(AREA, title, facts.clock_source or "unknown")
