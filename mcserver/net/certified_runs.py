"""Approvals as signed files: what is certified of a simulated run, and how a run differs from it."""

from __future__ import annotations

from mcserver.errors import Refused
from mcserver.planning.start_state import StartState
from mcserver.service.approval_basis import ApprovalBasis, extents_of, tools_of
from mcserver.service.arming import hash_of
from mcserver.service.run_certificate import Approval
from mcserver.simulation.preview import Preview

RECERTIFY = "certify it for this version and machine file: mcserver certify"
SHOWN_DIGEST = 12


def approval_of(
    basis: ApprovalBasis, text: str, axes: tuple[int, ...], start: StartState, seen: Preview
) -> Approval:
    """Return the approval to certify, for a run simulated without a fault; it expires at once."""
    assert seen.envelope is not None, "a run with faults is not approved"
    digest, version = basis.unchanging
    return Approval(
        sha256=hash_of(text),
        axes=axes,
        start=start,
        machine=digest,
        version=version,
        digest=basis.digest(text, axes, start),
        setpoints=seen.setpoints,
        duration_s=seen.report["duration_s"],
        extents=extents_of(basis.machine, seen.envelope, axes),
        tools=tools_of(seen.envelope),
        effects=seen.effects,
        clearance_mm=(seen.report.get("clearance") or {"least_mm": None})["least_mm"],
        override=1.0,
        until=0.0,
    )


def refuse_other_run(basis: ApprovalBasis, approval: Approval, text: str, axes: tuple[int, ...]) -> None:
    """Refuse a run other than the approved one: another text, machine file, version, or other axes.

    Raises:
        Refused: MC579 it is another run.
    """
    digest, version = basis.unchanging
    same = {
        "text": approval.sha256 == hash_of(text),
        "machine file": approval.machine == digest,
        f"version ({approval.version}, this is {version})": approval.version == version,
        "set of axes": approval.axes == axes,
    }
    other = [what for what, is_same in same.items() if not is_same]
    if other:
        raise Refused("MC579", f"the certificate is of another {', another '.join(other)}", RECERTIFY)
    if approval.digest != basis.digest(text, axes, approval.start):
        raise Refused("MC579", "the certificate contradicts itself: its digest is of another run", RECERTIFY)


def refuse_other_motion(approval: Approval, seen: Preview) -> None:
    """Refuse a run that this computer plans differently from the certified one.

    Raises:
        Refused: MC579 a setpoint differs in any bit.
    """
    if seen.setpoints != approval.setpoints:
        raise Refused(
            "MC579",
            f"this computer plans other setpoints: {seen.setpoints[:SHOWN_DIGEST]} in "
            f"{seen.report['duration_s']:.6f} s, certified are {approval.setpoints[:SHOWN_DIGEST]} in "
            f"{approval.duration_s:.6f} s",
            "certify it with this computer's kind of processor and version of numpy: docs/wire/arming.md",
        )
