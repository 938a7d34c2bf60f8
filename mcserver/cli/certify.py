"""``mcserver certify``: an approval of a run as a signed file."""

from __future__ import annotations

import asyncio
import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from mcserver.cli.console import json_answer_on_error, results, write_json
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import (
    DEFAULT_MACHINE,
    BlockDeleteOption,
    JsonOption,
    MachineOption,
    OptionalStopOption,
    ProgramArgument,
    ZeroOption,
)
from mcserver.cli.output_file import write_atomically
from mcserver.cli.program_text import load_program
from mcserver.cli.rejection import reject
from mcserver.cli.simulation_report import diagnostics_of
from mcserver.errors import NobodyAnswers, ServiceError
from mcserver.gcode.axes_used import axes_used
from mcserver.gcode.switches import Switches
from mcserver.machine.machine_file import load_machine
from mcserver.planning.start_state import StartState
from mcserver.simulation.work_zero import with_zeros

if TYPE_CHECKING:
    from mcserver.service.run_certificate import Approval

MOST_HOURS = 24.0 * 366


def certify(
    file: ProgramArgument,
    site: Annotated[
        Path, typer.Option("--site", metavar="FOLDER", help="The site's folder, of mcserver security init.")
    ],
    by: Annotated[str, typer.Option("--by", metavar="NAME", help="Who approves; the events name you.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Where the certificate is written.")
    ],
    machine: MachineOption = DEFAULT_MACHINE,
    zero: ZeroOption = None,
    block_delete: BlockDeleteOption = False,
    optional_stop: OptionalStopOption = True,
    connect: Annotated[
        str | None,
        typer.Option(
            "--connect",
            metavar="E",
            help="Begin where the machine of this server stands, not as its file says.",
        ),
    ] = None,
    zenoh: Annotated[
        Path | None, typer.Option("--zenoh-config", metavar="PATH", help="Who asks there; needs --connect.")
    ] = None,
    hours: Annotated[
        float, typer.Option("--hours", min=0.01, max=MOST_HOURS, help="How long it may be used.")
    ] = 24.0,
    override: Annotated[
        float, typer.Option("--override", min=1.0, max=200.0, help="The greatest feed override, in percent.")
    ] = 100.0,
    json: JsonOption = False,
) -> None:
    """Simulate a program and sign what the run keeps to: `mcctl run --certificate` runs nothing else."""
    with json_answer_on_error(json, {"ok": False}):
        described = with_zeros(load_machine(machine), zero or ())
        program = load_program(file)
        from mcserver.net.certified_runs import approval_of, refuse_other_motion, refuse_other_run
        from mcserver.security.site_folder import signer_of
        from mcserver.service.approval_basis import ApprovalBasis
        from mcserver.service.run_certificate import sign
        from mcserver.simulation.preview import preview

        now = datetime.datetime.now(datetime.UTC)
        signer = signer_of(site, by, now)
        switches = Switches(block_delete, optional_stop)
        basis, axes, start = ApprovalBasis(described), axes_used(program.text, described), None
        if connect is not None:
            asked = asyncio.run(_ask(described.name, connect, zenoh, program.text, switches))
            refuse_other_run(basis, asked, program.text, axes)
            start = asked.start
        start = start or StartState.of(described, switches=switches)
        seen = preview(program.text, described, start, axes)
        faults = diagnostics_of(seen.report)
        if seen.envelope is not None:
            if connect is not None:
                refuse_other_motion(asked, seen)
            approval = msgspec.structs.replace(
                approval_of(basis, program.text, axes, start, seen),
                override=override / 100.0,
                until=(now + datetime.timedelta(hours=hours)).timestamp(),
            )
            written = sign(approval, signer.certificate, signer.key)
            write_atomically(str(output), lambda stream: stream.write(written))
    if seen.envelope is None:
        if json:
            write_json({"ok": False, "diagnostics": seen.report["diagnostics"]})
            raise typer.Exit(ExitCode.REJECTED)
        reject(faults, program.lines, program.name)
    if json:
        write_json(
            {"ok": True, "file": str(output), "approval": msgspec.to_builtins(approval, str_keys=True)}
        )
    else:
        _show(approval, by, output)


async def _ask(machine: str, endpoint: str, zenoh: Path | None, text: str, switches: Switches) -> Approval:
    """Let a server simulate a run from where its machine stands; return what can be certified of it."""
    from mcclient import Machine as RemoteMachine
    from mcclient.errors import MotionError, RequestRefused

    from mcserver.service.run_certificate import Approval

    try:
        remote = await RemoteMachine.connect(machine, [endpoint], client="certify", config_file=zenoh)
        try:
            asked = await remote.request_run(
                text,
                "certify",
                block_delete=switches.block_delete,
                optional_stop=switches.optional_stop,
            )
            if asked.run is None:
                fault = asked.diagnostics[0]
                raise ServiceError(fault.code, f"line {fault.line}: {fault.message}", fault.hint)
            seen = await remote.run_preview(asked.run.sha256)
            await remote.withdraw(asked.run.sha256)
        finally:
            await remote.close()
    except RequestRefused as error:
        raise ServiceError(error.code, error.message, error.hint) from error
    except MotionError as error:
        raise NobodyAnswers(error.code, error.message, error.hint) from error
    return msgspec.json.decode(seen.certifiable, type=Approval)


def _show(approval: Approval, by: str, output: Path) -> None:
    console = results()
    for extent in approval.extents:
        console.print(
            f"axis {extent.axis}: {extent.low:.3f} … {extent.high:.3f} {extent.unit}, "
            f"{extent.speed:.1f} {extent.unit}/s"
        )
    for tool in approval.tools:
        low, high = (" ".join(f"{value:.3f}" for value in each) for each in (tool.low, tool.high))
        console.print(f"tip of tool {tool.tool}: {low} … {high} mm, {tool.speed:.1f} mm/s")
    if approval.clearance_mm is not None:
        console.print(f"least clearance {approval.clearance_mm:g} mm")
    for effect in approval.effects:
        console.print(f"it {effect}")
    ends = datetime.datetime.fromtimestamp(approval.until, datetime.UTC)
    console.print(
        f"{approval.duration_s:.3f} s, override up to {100 * approval.override:g} %, setpoints "
        f"{approval.setpoints[:12]}: signed by {by}, until {ends:%Y-%m-%d %H:%M} UTC: {output}",
        markup=False,
    )
