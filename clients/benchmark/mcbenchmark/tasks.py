"""Tasks of the benchmark: what is asked for in words, and what a simulation has to show."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Sequence
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Literal

import msgspec

from mcserver.errors import ConfigurationError

Range = tuple[float, float]
Place = dict[str, float]  # coordinate → mm or degrees
Box = dict[str, Range]

MAX_TASKS = 10_000
MAX_LIMIT_S = 600.0
MAX_TASK_FILE = 4 * 1024 * 1024  # bytes
_ID = re.compile(r"[a-z0-9][a-z0-9-]{0,39}")
_COORDINATE = re.compile(r"[XYZABC]|[0-9]{1,2}|T[0-9]{1,2}\.[XYZABC]")


class Leg(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One part of a path: from where the part before ended to a place.

    Attributes:
        to: the place; coordinates that it leaves out do not matter.
        by: ``any`` path, a straight ``line``, or an ``arc`` about ``center``.
        center: two coordinates; the turn counts from the first towards the second.
        turn: of an arc [deg], signed; 720 for two full turns. Further coordinates go linearly with it.
        tolerance: distance from the place, from the line and from the arc [mm or deg].
        duration_s: of this part, without the rest behind it. speed: its greatest [mm/s or deg/s]; it takes
            no longer than its length at the least of it, and the ramps.
        rest_s: how long the coordinates rest at its end; None: hardly.
        stops: True: they come to rest there; False: they pass without a stop.
        detour: of ``any`` path, coordinates may go farther than from where they are to the place.
    """

    to: Place
    by: Literal["any", "line", "arc"] = "any"
    center: Place = {}
    turn: float = 0.0
    tolerance: float = 0.05
    duration_s: Range | None = None
    speed: Range | None = None
    rest_s: Range | None = None
    stops: bool | None = None
    detour: bool = False


class Expectation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the simulation of an answer has to show.

    Attributes:
        path: legs in order; behind the last one its coordinates stay where they are. What a leg does not
            name rests. speed: of the legs that say none.
        free: coordinates that may move as they like.
        end: final setpoints. tolerance: of them [mm or deg].
        duration_s: of the whole run.
        avoid: boxes that the path never enters. within: a box that it never leaves.
        uses: codes, tools or alternatives such as ``G02|G03`` that occur in the code, not in comments.
        lacks: codes that do not occur.
        energized, released: axes that are so at the end.
        speeds: of axes at the end, by their encoders [mm/s or deg/s].
        max_lines: with code on them. clear_mm: least distance of the machine's bodies.
    """

    path: tuple[Leg, ...] = ()
    end: Place = {}
    tolerance: float = 0.05
    duration_s: Range | None = None
    avoid: tuple[Box, ...] = ()
    within: Box = {}
    uses: tuple[str, ...] = ()
    lacks: tuple[str, ...] = ()
    energized: tuple[int, ...] = ()
    released: tuple[int, ...] = ()
    speeds: dict[str, Range] = {}
    max_lines: int | None = None
    speed: Range | None = None
    free: tuple[str, ...] = ()
    clear_mm: float | None = None


class Task(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One task.

    Attributes:
        id: lower case, digits and hyphens; names the answer's file.
        machine: a built-in machine, or a machine file beside the task's.
        prompt: what to do, in words. faulty: a program to put right, shown with the prompt.
        start: positions of axes that differ from the machine's own start [mm or deg].
        solution: a program that passes.
        spoil: pairs of texts; the solution with the first occurrence of one replaced by the other fails.
        limit_s: simulated time after which an answer has failed.
    """

    id: str
    category: str
    machine: str
    prompt: str
    expect: Expectation
    solution: str
    spoil: tuple[tuple[str, str], ...]
    start: dict[str, float] = {}
    faulty: str = ""
    limit_s: float = 30.0


class TaskFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of a file: ``[[task]]`` tables."""

    task: tuple[Task, ...]


def shipped_tasks() -> tuple[Task, ...]:
    """Return the tasks that come with the package, in the order of their files."""
    return tuple(_read_all(resources.files("mcbenchmark").joinpath("tasks")))


def load_tasks(folder: Path) -> tuple[Task, ...]:
    """Read the tasks of a folder's TOML files.

    Raises:
        ConfigurationError: MC080 a file cannot be read, or has a task that does not fit the schema.
    """
    tasks = tuple(_read_all(folder))
    if not tasks:
        raise ConfigurationError(
            "MC080", f"{folder} has no tasks", "name a folder of .toml files with [[task]]"
        )
    return tasks


def _read_all(folder: Traversable) -> Iterator[Task]:
    seen: dict[str, str] = {}
    try:
        files = sorted(
            (each for each in folder.iterdir() if each.name.endswith(".toml")), key=lambda file: file.name
        )
    except OSError as error:
        raise _unreadable(str(folder), error.strerror or str(error)) from error
    for file in files:
        beside = Path(str(file)).parent
        for task in _read(file):
            if task.id in seen:
                raise _unreadable(file.name, f"the task {task.id} stands in {seen[task.id]} already")
            seen[task.id] = file.name
            if len(seen) > MAX_TASKS:
                raise _unreadable(file.name, f"there are more than {MAX_TASKS} tasks")
            if task.machine.endswith(".toml"):
                yield msgspec.structs.replace(task, machine=str(beside / task.machine))
            else:
                yield task


def _read(file: Traversable) -> Sequence[Task]:
    try:
        with file.open("rb") as stream:
            raw = stream.read(MAX_TASK_FILE + 1)
        if len(raw) > MAX_TASK_FILE:
            raise _unreadable(file.name, f"it has more than {MAX_TASK_FILE} bytes")
        described = tomllib.loads(raw.decode("utf-8"))
        tasks: tuple[Task, ...] = msgspec.convert(described, TaskFile).task
    except OSError as error:
        raise _unreadable(file.name, error.strerror or str(error)) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError, msgspec.ValidationError) as error:
        raise _unreadable(file.name, str(error)) from error
    for task in tasks:
        wrong = mistake(task)
        if wrong:
            raise _unreadable(file.name, f"{task.id[:40]!r}: {wrong}")
    return tasks


def mistake(task: Task) -> str:
    """Return what of a task the schema's types cannot show, or an empty text."""
    if not _ID.fullmatch(task.id):
        return "an id has lower-case letters, digits and hyphens"
    expect = task.expect
    names = [name for leg in expect.path for name in (*leg.to, *leg.center)]
    names += [name for box in (*expect.avoid, expect.within) for name in box]
    names += [*expect.end, *expect.free]
    axes = [*task.start, *expect.speeds]
    if any("." in name or not _COORDINATE.fullmatch(name) for name in axes):
        return "start and speeds are of axes, such as X or 7"
    for name in names:
        if not _COORDINATE.fullmatch(name):
            return f"{name!r} is no coordinate: they are such as X, 7 or T3.X"
    for leg in expect.path:
        if not leg.to or leg.tolerance <= 0:
            return "a leg has a place and a tolerance above zero"
        if leg.by == "arc" and (len(leg.center) != 2 or not leg.turn):
            return "an arc has two coordinates of its center, and a turn"
        if leg.by != "arc" and (leg.center or leg.turn):
            return "only an arc has a center and a turn"
        if leg.detour and leg.by != "any":
            return "only a leg by any path makes a detour"
    for low, high in _ranges(expect):
        if not low <= high:
            return f"{low} to {high} is an empty range"
    if not task.spoil:
        return "a task has at least one spoiled form of its solution"
    for old, new in task.spoil:
        if old not in task.solution or old == new:
            return f"{old!r} is not in the solution, or is replaced by itself"
    if not 0 < task.limit_s <= MAX_LIMIT_S:
        return f"limit_s is above 0 and at most {MAX_LIMIT_S:g}"
    return ""


def spoiled(task: Task) -> list[str]:
    """Return the spoiled forms of a task's solution, all of which fail."""
    return [task.solution.replace(old, new, 1) for old, new in task.spoil]


def _ranges(expect: Expectation) -> Iterator[Range]:
    for bounds in (expect.duration_s, expect.speed):
        if bounds is not None:
            yield bounds
    for box in (*expect.avoid, expect.within):
        yield from box.values()
    yield from expect.speeds.values()
    for leg in expect.path:
        yield from (each for each in (leg.duration_s, leg.speed, leg.rest_s) if each is not None)


def _unreadable(name: str, why: str) -> ConfigurationError:
    return ConfigurationError(
        "MC080", f"the tasks of {name} cannot be used: {why}", "docs/benchmark.md has the schema"
    )
