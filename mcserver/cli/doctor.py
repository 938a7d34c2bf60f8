"""``mcserver doctor``: what this computer lacks, each line with its fix."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from mcserver.cli.console import json_answer_on_error, results, write_json
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import JsonOption, ZenohConfigOption
from mcserver.cli.terminal_console import TerminalConsole
from mcserver.doctor import Finding, State, examine, worst
from mcserver.doctor.finding import advice, good, missing
from mcserver.machine.machine_file import load_machine

MARKS = {
    State.OK: ("ok", "green"),
    State.ADVICE: ("advice", "yellow"),
    State.MISSING: ("missing", "bold red"),
}


def doctor(
    machine: Annotated[
        str | None,
        typer.Option(
            "--machine",
            "-m",
            metavar="M",
            help="Look at the CAN buses of this machine too: their load, and whether they are there.",
        ),
    ] = None,
    zenoh: ZenohConfigOption = None,
    json: JsonOption = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit code 1 where only advice is given, too.")
    ] = False,
) -> None:
    """Say what this computer lacks, each line with its fix. Exit code 1 where the server cannot run."""
    with json_answer_on_error(json):
        findings = examine(None if machine is None else load_machine(machine))
        if zenoh is not None:
            findings.append(_judge_certificates(zenoh))
    gravest = worst(findings)
    if json:
        write_json(
            {
                "ok": gravest is not State.MISSING,
                "findings": [
                    {
                        "area": each.area,
                        "title": each.title,
                        "state": each.state.value,
                        "found": each.found,
                        "fix": each.fix,
                    }
                    for each in findings
                ],
            }
        )
    else:
        print_findings(findings, results())
    if gravest is State.MISSING or (strict and gravest is State.ADVICE):
        raise typer.Exit(int(ExitCode.FAILED))


def _judge_certificates(file: Path) -> Finding:
    from mcserver.security.expiry import REMEDY, first_ending

    ending, now = first_ending(file), datetime.datetime.now(datetime.UTC)
    if ending is None:
        return good("service", "certificates", f"{file} has none")
    judge = missing if ending.ends <= now else advice
    if ending.is_near(now):
        return judge("service", "certificates", ending.said(now), REMEDY)
    return good("service", "certificates", ending.said(now))


def print_findings(findings: Sequence[Finding], console: TerminalConsole) -> None:
    """One line a finding, its fix below, and a closing count."""
    area = ""
    for finding in findings:
        if finding.area != area:
            area = finding.area
            console.print(Text(area, style="bold"))
        mark, colour = MARKS[finding.state]
        console.print(Text.assemble("  ", (f"{mark:<8}", colour), f"{finding.title}: {finding.found}"))
        if finding.fix:
            console.print(Text.assemble(" " * 10, ("fix", "bold"), f": {finding.fix}"))
    lacking = sum(finding.state is State.ADVICE for finding in findings)
    required = sum(finding.state is State.MISSING for finding in findings)
    console.print(f"{len(findings)} looked at, {lacking} with advice, {required} required and missing")
