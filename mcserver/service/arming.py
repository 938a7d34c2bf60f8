"""Requests for runs that an operator has to arm: one text, once, for a limited time.

A request moves nothing. It stores the text, the initial state of its simulation, and the envelope of the
simulated motion. An operator arms it by the text's hash; then the requesting client may start it once, with
the same text, before the time is over and from the same state; the executor enforces the envelope. Pure
bookkeeping: the clock is passed in.
"""

from __future__ import annotations

import enum
import hashlib
import itertools
from collections.abc import Callable, Mapping
from collections.abc import Set as AbstractSet

import msgspec

from mcserver.errors import Refused
from mcserver.executor.envelope_bounds import Envelope
from mcserver.planning.start_state import StartState
from mcserver.service.reports import WireDiagnostic

MAX_REQUESTS = 16  # waiting or armed at once, of all clients; the same number of past ones is shown
CLIENT_REQUESTS = 4
MAX_TEXT = 256 * 1024  # characters
WAIT_S = 3600.0  # a request that is not armed is removed after this time
MAX_ARMED_S = 3600.0
MAX_STANDING_S = 3600.0  # longest standing approval
WITHIN_S = 60.0  # time to start a run armed by a standing approval
SHOWN_REJECTED_S = 600.0  # time for which the client can read a rejection
LEAST_HASH = 8  # fewest hexadecimal digits that identify a text
MOST_NAMED = 8  # most changes that a refusal names
MOST_WARNINGS = 50  # most warnings shown to an operator
MAX_REASON = 500  # most characters of a rejection's reason


class RunState(enum.Enum):
    """State of a request."""

    WAITING = "waiting"
    ARMED = "armed"
    STARTED = "started"
    REJECTED = "rejected"


# states in which a run may still start
OPEN = frozenset({RunState.WAITING, RunState.ARMED})


class Extent(msgspec.Struct, frozen=True):
    """Least and greatest setpoint of an axis [mm or deg], and its greatest speed [mm/s or deg/s].

    Attributes:
        turns: the axis turns continuously at a speed (G1030): its positions are not bounded.
    """

    axis: int
    low: float
    high: float
    unit: str
    speed: float = 0.0
    turns: bool = False


class ToolExtent(msgspec.Struct, frozen=True):
    """Least and greatest X, Y and Z of a tool's tip in the base frame [mm], and its greatest speed [mm/s]."""

    tool: int
    low: list[float]
    high: list[float]
    speed: float


class ToolPath(msgspec.Struct, frozen=True):
    """Path of a tool; ``position``: lists of X, of Y and of Z at the moments of the `RunPath` [mm]."""

    tool: int
    position: list[list[float]]


class RunPath(msgspec.Struct, frozen=True):
    """Simulated path of a request, sampled at equal intervals, for a picture.

    Attributes:
        time_s: n moments after the start of the run [s]. positions: for each axis of the request n setpoints
            [mm or deg]. tools: paths of the tools that these axes move.
    """

    time_s: list[float]
    positions: list[list[float]]
    tools: list[ToolPath]


NO_PATH = RunPath([], [], [])


class RunRequest(msgspec.Struct, frozen=True):
    """A request for a run of one text.

    Attributes:
        client: requester, who alone may start the run. sha256: of the text in UTF-8.
        axes: axes that the run may move.
        start: initial state of the simulation. inputs: columns of the inputs that the run reads.
        duration_s, extents, tools: of the simulated motion, as shown to people. path: for a picture.
        until: end of the wait for an operator, or of the arming [s of the clock].
        override: greatest feed override, 1 as programmed. operator: who armed or rejected the run.
        number: of the request; when the same text is requested again, it gets another number.
        envelope: extents, speeds and duration of the simulated motion, without tolerances.
        effects: lasting changes that the run makes, in words.
        references: position less encoder reading of each axis at the request [m or rad].
        digest: SHA-256 over all inputs of the simulation.
        reason: of the rejection. outputs: least and greatest value of each output.
        certifiable: JSON that ``mcserver certify`` signs.
        approval: hash of the standing approval that armed the run. servo: the standing approval given with
            the run also covers streamed targets.
        beyond: what of the run exceeds the standing approval of its client, in words.
        warnings: of the check and the simulation, at most `MOST_WARNINGS`. unshown: count of further ones.
    """

    client: str
    sha256: str
    text: str
    name: str
    axes: tuple[int, ...]
    start: StartState
    duration_s: float
    extents: tuple[Extent, ...]
    until: float
    state: RunState = RunState.WAITING
    override: float = 1.0
    operator: str = ""
    number: int = 0
    path: RunPath = NO_PATH
    inputs: frozenset[int] = frozenset()
    envelope: Envelope | None = None
    effects: tuple[str, ...] = ()
    references: Mapping[int, float] = {}
    tools: tuple[ToolExtent, ...] = ()
    digest: str = ""
    reason: str = ""
    outputs: tuple[tuple[float, float], ...] = ()
    certifiable: str = ""
    approval: str = ""
    servo: bool = False
    beyond: tuple[str, ...] = ()
    warnings: tuple[WireDiagnostic, ...] = ()
    unshown: int = 0


# names what has changed since a run was simulated
Changes = Callable[[RunRequest], list[str]]
# names what of the second run exceeds the approval of the first
Beyond = Callable[[RunRequest, RunRequest], list[str]]


def hash_of(text: str) -> str:
    """Return the SHA-256 of a text in UTF-8, hexadecimal."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def user_of(client: str) -> str:
    """Return the user of a client id: the part before its first dot."""
    return client.partition(".")[0]


class Arming:
    """Requests for runs of one machine.

    Args:
        clock: monotonic [s].
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._requests: dict[str, RunRequest] = {}
        # by hash: standing approvals, with the run that the operator saw; until: end of the approval
        self._approvals: dict[str, RunRequest] = {}
        self._numbers = itertools.count(1)

    def requests(self) -> list[RunRequest]:
        """Return requests that wait, are armed, or have just been started; the oldest first."""
        self._forget()
        return list(self._requests.values())

    def approvals(self) -> list[RunRequest]:
        """Return the standing approvals; the oldest first."""
        self._forget()
        return list(self._approvals.values())

    def arm_within(self, request: RunRequest, beyond: Beyond) -> RunRequest:
        """Arm a request within a standing approval of its client; else note in it what exceeds the approval.

        Args:
            beyond: names what of a run exceeds the run of an approval.
        """
        self._forget()
        outside: list[str] = []
        for approval in self._approvals.values():
            if approval.client != request.client:
                continue
            outside = beyond(approval, request)
            if not outside:
                request = msgspec.structs.replace(
                    request,
                    state=RunState.ARMED,
                    operator=approval.operator,
                    override=approval.override,
                    until=min(self._clock() + WITHIN_S, approval.until),
                    approval=approval.sha256,
                )
                break
        request = msgspec.structs.replace(request, beyond=tuple(outside[:MOST_NAMED]))
        self._requests[request.sha256] = request
        return request

    def approved_targets(self, client: str, axes: AbstractSet[int]) -> RunRequest:
        """Return the standing approval of a client that covers streamed targets of these axes.

        Raises:
            ServiceError: MC608 no approval covers them.
        """
        for approval in self.approvals():
            if approval.servo and approval.client == client and axes <= set(approval.axes):
                return approval
        raise Refused(
            "MC608",
            "no operator has approved that these axes follow targets of this client",
            "request a run that goes as far and as fast; an operator arms it for a while, and for targets"
            " too: mcctl arm --standing 600 --servo",
        )

    def check_room(self, client: str, text: str) -> None:
        """Refuse a request beyond the limits of requests and of their texts.

        Raises:
            ServiceError: MC574 too many requests wait, or the text is too long.
        """
        self._forget()
        if len(text) > MAX_TEXT:
            raise Refused(
                "MC574", f"the text is longer than {MAX_TEXT} characters", "an operator runs it: mcctl run"
            )
        others = [each for sha, each in self._requests.items() if sha != hash_of(text) and each.state in OPEN]
        own = sum(each.client == client for each in others)
        if len(others) >= MAX_REQUESTS or own >= CLIENT_REQUESTS:
            raise Refused("MC574", "too many requests wait for an operator", "withdraw one, or wait")

    def request(self, wanted: RunRequest) -> RunRequest:
        """Add a new request; it replaces an earlier one for the same text, and waits for an operator.

        Raises:
            ServiceError: MC573 another client waits with the same text; MC574 as `check_room`.
        """
        self.check_room(wanted.client, wanted.text)
        before = self._requests.get(wanted.sha256)
        if before is not None and before.client != wanted.client:
            raise Refused("MC573", "another client waits with the same text", "that client may start it")
        kept = msgspec.structs.replace(
            wanted,
            until=self._clock() + WAIT_S,
            number=next(self._numbers),
        )
        self._requests[wanted.sha256] = kept
        ended = [sha for sha, each in self._requests.items() if each.state not in OPEN]
        for sha in ended[: max(0, len(ended) - MAX_REQUESTS)]:
            del self._requests[sha]
        return kept

    def find(self, sha256: str) -> RunRequest:
        """Return the request with this hash, in any state.

        Args:
            sha256: of the text, or at least its first 8 digits.

        Raises:
            ServiceError: MC570 no request matches, or more than one.
        """
        return _only(self._matching(sha256), sha256)

    def arm(
        self,
        operator: str,
        sha256: str,
        *,
        seconds: float,
        override: float,
        number: int | None = None,
        standing: float = 0.0,
        servo: bool = False,
        changes: Changes = lambda _run: [],
    ) -> RunRequest:
        """Arm a waiting request: its client may start the run once.

        Args:
            sha256: of the text, or at least its first 8 digits.
            seconds: time for the start.
            override: greatest feed override, 1 as programmed.
            number: of the request that the operator has reviewed; None: any.
            standing: duration of a standing approval [s] for further requests of the client that stay within
                the envelope of this run; 0: only this run, once.
            servo: the standing approval also covers streamed targets.
            changes: names what has changed since the simulation began.

        Raises:
            ServiceError: MC570 no request with this hash waits, or it was repeated after the review; MC572
                inputs of the simulation have changed; MC574 too many approvals; MC575 the operator is the
                requesting user.
        """
        self._forget()
        request = _only([each for each in self._matching(sha256) if each.state is RunState.WAITING], sha256)
        _refuse_other(request, number)
        if user_of(request.client) == user_of(operator):
            raise Refused("MC575", "who asks for a run may not arm it", "another person has to look at it")
        refuse_changed(changes(request))
        others = [each for sha, each in self._approvals.items() if sha != request.sha256]
        full = sum(each.client == request.client for each in others) >= CLIENT_REQUESTS
        if standing > 0.0 and (full or len(others) >= MAX_REQUESTS):
            raise Refused("MC574", "there are too many approvals for a while", "end one: mcctl arm --reject")
        armed = msgspec.structs.replace(
            request,
            state=RunState.ARMED,
            operator=operator,
            override=override,
            until=self._clock() + min(seconds, MAX_ARMED_S),
        )
        self._requests[request.sha256] = armed
        if standing > 0.0:
            until = self._clock() + min(standing, MAX_STANDING_S)
            self._approvals[request.sha256] = msgspec.structs.replace(armed, until=until, servo=servo)
        return armed

    def reject(self, operator: str, sha256: str, reason: str, *, number: int | None = None) -> RunRequest:
        """Reject a request that has not been started; its client can read the reason.

        A standing approval that was given with the request ends.

        Raises:
            ServiceError: MC570 no request with this hash waits, or it was repeated after the review.
        """
        request = self._end_approval(sha256) or self._undecided(sha256, number)
        rejected = msgspec.structs.replace(
            request,
            state=RunState.REJECTED,
            operator=operator,
            reason=reason,
            until=self._clock() + SHOWN_REJECTED_S,
        )
        self._requests[request.sha256] = rejected
        return rejected

    def withdraw(self, client: str, sha256: str) -> RunRequest:
        """Remove a request that has not been started; only the user who made it may.

        Raises:
            ServiceError: MC570 no request with this hash waits; MC573 another user made it.
        """
        request = self._undecided(sha256, None)
        if user_of(request.client) != user_of(client):
            raise Refused("MC573", "another client asked for this run", "an operator rejects it")
        self._end_approval(request.sha256)
        del self._requests[request.sha256]
        return request

    def _end_approval(self, sha256: str) -> RunRequest | None:
        """End the standing approval with this hash; requests that it has armed wait for an operator again."""
        found = [sha for sha in self._approvals if _is_hash_of(sha, sha256)]
        if len(found) != 1:
            return None
        for sha, request in self._requests.items():
            if request.state is RunState.ARMED and request.approval == found[0]:
                self._requests[sha] = msgspec.structs.replace(request, state=RunState.WAITING)
        return self._approvals.pop(found[0])

    def client_gone(self, client: str) -> list[RunRequest]:
        """Remove the requests of a client that has disappeared; return those that waited or were armed."""
        gone = [each for each in self._requests.values() if each.client == client]
        for each in gone:
            del self._requests[each.sha256]
        self._approvals = {sha: each for sha, each in self._approvals.items() if each.client != client}
        return [each for each in gone if each.state in OPEN]

    def disarm(self) -> None:
        """Revoke all armings and standing approvals, as after an emergency stop."""
        self._approvals.clear()
        for sha, request in self._requests.items():
            if request.state is RunState.ARMED:
                self._requests[sha] = msgspec.structs.replace(request, state=RunState.WAITING)

    def start(
        self,
        client: str,
        text: str,
        busy: AbstractSet[int],
        changes: Changes,
    ) -> RunRequest:
        """Mark an armed request as started, and return it; it cannot be started again.

        Args:
            busy: axes that another program moves.
            changes: names what has changed since the simulation began.

        Raises:
            ServiceError: MC571 the text is not armed, or no longer; MC572 inputs of the simulation have
                changed; MC573 another client requested the run; MC576 an operator has rejected it.
        """
        self._forget()
        request = self._requests.get(hash_of(text))
        if request is None:
            raise Refused(
                "MC571", "this very text is not armed", "ask with request_run; an operator arms it: mcctl arm"
            )
        if request.client != client:
            raise Refused("MC573", "another client asked for this run", "only who asked may start it")
        if request.state is RunState.REJECTED:
            raise Refused(
                "MC576",
                f"{request.operator} has rejected this run: {request.reason or 'no reason was given'}",
                "change the program, and request that run",
            )
        if request.state is not RunState.ARMED:
            what = "was started already" if request.state is RunState.STARTED else "waits for an operator"
            raise Refused("MC571", f"the program {what}", "an operator arms it, once: mcctl arm")
        taken = sorted(busy & set(request.axes))
        if taken:
            names = ", ".join(f"axis {each}" for each in taken)
            raise Refused("MC572", f"another program has {names}", "wait until it has ended")
        refuse_changed(changes(request))
        started = msgspec.structs.replace(request, state=RunState.STARTED)
        self._requests[request.sha256] = started
        return started

    def _undecided(self, sha256: str, number: int | None) -> RunRequest:
        """Return the request with this hash that waits or is armed."""
        request = _only([each for each in self._matching(sha256) if each.state in OPEN], sha256)
        _refuse_other(request, number)
        return request

    def _matching(self, sha256: str) -> list[RunRequest]:
        self._forget()
        return [each for each in self._requests.values() if _is_hash_of(each.sha256, sha256)]

    def _forget(self) -> None:
        """Remove requests and approvals whose time is over, so that no expired arming can be started."""
        now = self._clock()
        for kept in (self._requests, self._approvals):
            for sha in [sha for sha, request in kept.items() if now >= request.until]:
                del kept[sha]


def refuse_changed(changed: list[str]) -> None:
    """Refuse a run if inputs of its simulation have changed.

    Raises:
        Refused: MC572, with the changes.
    """
    if changed:
        raise Refused(
            "MC572",
            f"since it was simulated, {'; '.join(changed[:MOST_NAMED])}",
            "request the run again, so that it is looked at as it would be now",
        )


def _refuse_other(request: RunRequest, number: int | None) -> None:
    """Refuse a request that was repeated after the operator has reviewed it."""
    if number is not None and number != request.number:
        raise Refused("MC570", "the run was asked for anew, perhaps from elsewhere", "look at it again first")


def _is_hash_of(sha256: str, given: str) -> bool:
    """Return whether the given hash, or at least its first `LEAST_HASH` digits, is this one."""
    return len(given) >= LEAST_HASH and sha256.startswith(given.lower())


def _only(matching: list[RunRequest], sha256: str) -> RunRequest:
    if len(matching) != 1:
        raise Refused("MC570", f"no single program waits with the hash {sha256[:64]}", "see: mcctl arm")
    return matching[0]
