"""Recordings as what ``mcserver plot`` and ``mcserver view`` show: the run, its machine, its tools."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mckinematics.solver import MachineKinematics

from mcserver.cli.console import narration
from mcserver.cli.options import DEFAULT_MACHINE
from mcserver.errors import McError
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics

if TYPE_CHECKING:
    from mcserver.recorder.reading import RecordedRun


@dataclass(frozen=True)
class OpenedRecording:
    """A recording with the machine that it is shown on."""

    run: RecordedRun
    machine: Machine
    kinematics: MachineKinematics | None


def is_recording_name(file: str) -> bool:
    """Return whether a file is a recording by its name; what reads it is loaded only then."""
    return Path(file).suffix.lower() in (".mcap", ".npz")


def open_recording(file: str, machine: str) -> OpenedRecording:
    """Return a recording and its machine: the one named, or the one that the file holds.

    Raises:
        UsageFault: MC581. ConfigurationError: the machine named cannot be used.
    """
    from mcserver.recorder.reading import read_recording

    run = read_recording(Path(file))
    if machine != DEFAULT_MACHINE or run.machine is None:
        described = load_machine(machine)
        return OpenedRecording(run, described, build_kinematics(described))
    try:
        return OpenedRecording(run, run.machine, build_kinematics(run.machine))
    except McError as error:
        # its URDF is on another computer
        narration().print(f"without tools: {error.message}; --machine names a machine file here")
        return OpenedRecording(run, run.machine, None)
