"""Metrics for Prometheus: what the fleet's states say, by machine."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Gauge, generate_latest

from mcserver.web.fleet import Fleet
from mcserver.web.formatting import current_program, is_live

STATES = ("ready", "fault", "estop")


def metrics_text(fleet: Fleet) -> bytes:
    """The exposition format 0.0.4 of every machine that is known."""
    registry = CollectorRegistry()

    def gauge(name: str, text: str, *labels: str) -> Gauge:
        return Gauge(name, text, ("machine", *labels), registry=registry)

    online = gauge("mc_machine_online", "1 while the machine answers")
    state = gauge("mc_machine_state", "1 for the state that the machine is in", "state")
    faults = gauge("mc_machine_faults", "Latched faults")
    late = gauge("mc_machine_late_cycles", "Late cycles since the server's start")
    delay = gauge(
        "mc_machine_journal_delay_seconds", "How long the journal waits for a slow disk; 0: it keeps up"
    )
    override = gauge("mc_machine_override_percent", "Feed override")
    programs = gauge("mc_machine_programs", "Programs that have not ended")
    progress = gauge("mc_program_progress_ratio", "Share of the program that is done")
    remaining = gauge("mc_program_remaining_seconds", "Time left of the program, where it is known")
    position = gauge("mc_axis_position", "Encoder position in mm or degrees", "axis")
    error = gauge("mc_axis_following_error", "Setpoint minus position in mm or degrees", "axis")
    for seen in list(fleet.machines.values()):
        online.labels(seen.name).set(seen.online)
        status = seen.status
        if status is None or not seen.online:
            continue
        for each in STATES:
            state.labels(seen.name, each).set(status.state == each)
        faults.labels(seen.name).set(len(status.faults))
        late.labels(seen.name).set(status.late_cycles)
        disk = status.disk
        delay.labels(seen.name).set(0.0 if disk is None else max(disk.commit_s, disk.sync_s))
        override.labels(seen.name).set(status.override)
        programs.labels(seen.name).set(sum(is_live(program) for program in status.programs))
        program = current_program(status)
        if program is not None and is_live(program):
            progress.labels(seen.name).set(program.progress)
            if program.eta_s is not None:
                remaining.labels(seen.name).set(program.eta_s)
        axes = status.axes
        for index, at, target in zip(axes.index, axes.position, axes.setpoint, strict=True):
            position.labels(seen.name, str(index)).set(at)
            error.labels(seen.name, str(index)).set(target - at)
    return generate_latest(registry)
