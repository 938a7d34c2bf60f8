"""What `mcserver doctor` makes of facts; the probes only read them."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import msgspec
import pytest

from mcserver.doctor import State, examine, service, worst
from mcserver.doctor.can import CanFacts, CanInterface, judge_can
from mcserver.doctor.finding import advice, good, missing
from mcserver.doctor.python import PACKAGES, PythonFacts, judge_python
from mcserver.doctor.realtime import RealtimeFacts, judge_realtime
from mcserver.doctor.service import ServiceFacts, judge_service

TUNED = RealtimeFacts(
    fifo=True,
    memlock=None,
    preemption="rt",
    governors={"performance": 4},
    isolated="3",
    rt_runtime_us=950_000,
    rt_period_us=1_000_000,
    clock_source="tsc",
    cpus=4,
)
ALL_PACKAGES = {package.distribution: "1.0" for package in PACKAGES}


def test_a_tuned_computer_lacks_nothing() -> None:
    assert {finding.state for finding in judge_realtime(TUNED)} == {State.OK}


@pytest.mark.parametrize(
    ("change", "title", "fix"),
    [
        ({"fifo": False}, "SCHED_FIFO", "LimitRTPRIO"),
        ({"memlock": 65536}, "locked memory", "LimitMEMLOCK"),
        ({"preemption": "dynamic"}, "kernel preemption", "PREEMPT_RT"),
        ({"preemption": ""}, "kernel preemption", "PREEMPT_RT"),
        ({"governors": {"powersave": 3, "performance": 1}}, "CPU governor", "cpupower"),
        ({"isolated": ""}, "isolated CPUs", "isolcpus=3"),
        ({"isolated": "", "cpus": 1}, "isolated CPUs", "two or more CPUs"),
        ({"rt_runtime_us": 100_000}, "realtime budget", "sched_rt_runtime_us"),
        ({"clock_source": "hpet"}, "clock source", "tsc"),
    ],
)
def test_each_thing_that_lacks_is_advised_with_its_mend(
    change: dict[str, object], title: str, fix: str
) -> None:
    findings = judge_realtime(msgspec.structs.replace(TUNED, **change))
    lacking = [finding for finding in findings if finding.state is not State.OK]
    assert [finding.title for finding in lacking] == [title]
    assert fix in lacking[0].fix


def test_an_old_python_cannot_run_the_server() -> None:
    findings = judge_python(PythonFacts((3, 10, 4), ALL_PACKAGES))
    assert (findings[0].state, findings[0].found) == (State.MISSING, "3.10.4")


def test_a_required_package_that_does_not_load_is_missing() -> None:
    findings = judge_python(
        PythonFacts((3, 12, 0), {**ALL_PACKAGES, "eclipse-zenoh": "!ImportError: no glibc"})
    )
    broken = next(finding for finding in findings if finding.title == "eclipse-zenoh")
    assert broken.state is State.MISSING
    assert "no glibc" in broken.found


def test_an_optional_package_is_advice_that_names_its_extra() -> None:
    findings = judge_python(PythonFacts((3, 12, 0), {**ALL_PACKAGES, "matplotlib": None}))
    absent = next(finding for finding in findings if finding.title == "matplotlib")
    assert absent.state is State.ADVICE
    assert "mcserver[plot]" in absent.fix


def test_a_kernel_without_can_is_one_advice() -> None:
    findings = judge_can(CanFacts(sockets=False, virtual=False, interfaces=()))
    assert [finding.state for finding in findings] == [State.ADVICE]


@pytest.mark.parametrize(
    ("interface", "fix"),
    [
        (CanInterface("can0", up=False, queue=1000), "ip link set can0 up"),
        (CanInterface("can0", up=True, queue=10), "txqueuelen"),
        (CanInterface("can0", up=True, queue=1000, state="BUS-OFF"), "restart"),
        (
            CanInterface("can0", up=True, queue=1000, state="ERROR-PASSIVE", tx_errors=130, rx_errors=0),
            "120 Ω",
        ),
        (CanInterface("can0", up=True, queue=1000, state="ERROR-ACTIVE", tx_errors=0, rx_errors=3), "120 Ω"),
    ],
)
def test_each_trouble_of_an_interface_has_its_mend(interface: CanInterface, fix: str) -> None:
    findings = judge_can(CanFacts(sockets=True, virtual=False, interfaces=(interface,)))
    assert findings[1].state is State.ADVICE
    assert fix in findings[1].fix


def test_a_sound_interface_is_said_with_its_bit_rate() -> None:
    interface = CanInterface(
        "can0", up=True, queue=128, state="ERROR-ACTIVE", tx_errors=0, rx_errors=0, bitrate=1_000_000
    )
    findings = judge_can(CanFacts(sockets=True, virtual=False, interfaces=(interface,)))
    assert findings[1].state is State.OK
    assert "1000 kbit/s" in findings[1].found


@pytest.mark.parametrize("free", [None, 1_000_000])
def test_too_little_shared_memory_keeps_the_server_from_running(free: int | None) -> None:
    assert judge_service(ServiceFacts(free, "free"))[0].state is State.MISSING


def test_a_port_that_cannot_be_listened_on_is_advised_with_another() -> None:
    finding = judge_service(ServiceFacts(10**9, "Permission denied"))[1]
    assert finding.state is State.ADVICE
    assert "--listen" in finding.fix


@pytest.mark.parametrize(
    ("sync_s", "state"), [(0.004, State.OK), (0.4, State.ADVICE), (3.0, State.ADVICE), (None, State.ADVICE)]
)
def test_a_disk_that_takes_long_to_sync_is_advised_against(sync_s: float | None, state: State) -> None:
    finding = judge_service(ServiceFacts(10**9, "free", sync_s))[2]
    assert finding.state is state
    assert state is State.OK or "--journal" in finding.fix


def test_a_disk_that_hangs_does_not_hang_the_doctor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    released = threading.Event()
    monkeypatch.setattr(service, "SYNC_LIMIT_S", 0.01)
    monkeypatch.setattr(os, "fdatasync", lambda _file: released.wait(10.0))
    assert service.longest_sync_s(tmp_path / "not" / "made") == 0.01
    released.set()


def test_a_folder_that_cannot_be_written_takes_no_sync(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert service.longest_sync_s(tmp_path / "file") is None


def test_the_gravest_state_counts() -> None:
    assert worst([]) is State.OK
    assert worst([good("a", "b", "c"), advice("a", "b", "c", "d")]) is State.ADVICE
    assert worst([missing("a", "b", "c", "d"), advice("a", "b", "c", "d")]) is State.MISSING


def test_this_computer_can_be_examined_and_every_lack_has_a_mend() -> None:
    findings = examine()
    assert {finding.area for finding in findings} == {"python", "realtime", "can", "service"}
    assert all(finding.fix for finding in findings if finding.state is not State.OK)
