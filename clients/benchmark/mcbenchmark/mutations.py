"""Wrong answers by the thousand, made of right ones: what a judge that lets one pass is worth is seen."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from random import Random

import msgspec

from mcbenchmark.tasks import Task

_NUMBER = r"-?\d+(?:\.\d+)?"
_WORD = re.compile(rf"(?P<name>[XYZABCUVWIJKR]|\[\d+\])(?P<value>{_NUMBER})")
_FEED = re.compile(rf"F({_NUMBER})")
_MOVE = re.compile(r"\bG0?[123]\b|^(?:[XYZABCUVW]|\[\d+\])", re.MULTILINE)
_ARC = re.compile(r"\bG0?([23])\b")
_PLUNGE_MM = -100.0
_MOST_TRIES = 50


class Mutant(msgspec.Struct, frozen=True):
    """A wrong answer: its ``kind``, and the program."""

    kind: str
    text: str


def mutants(task: Task, random: Random) -> Iterator[Mutant]:
    """Make wrong answers of a task's solution, without end, each different from the solution.

    Each kind is wrong whatever the task is: places, ways, speeds that are asked for, strange motion, faults.
    """
    while True:
        for _ in range(_MOST_TRIES):
            kind = random.choice(sorted(_KINDS))
            text = _KINDS[kind](task, random)
            if text and text.strip() != task.solution.strip():
                yield Mutant(kind, text)
                break
        else:
            return


def _another_place(task: Task, random: Random) -> str | None:
    """Move one coordinate of one line by far more than any tolerance."""
    found = [each for each in _WORD.finditer(task.solution) if each["name"] != "R"]
    if not found or _may_go_around(task):
        return None
    word = random.choice(found)
    off = random.choice([-1, 1]) * random.uniform(3.0, 12.0)
    return _put(task.solution, word, f"{word['name']}{float(word['value']) + off:.3f}")


def _another_sign(task: Task, random: Random) -> str | None:
    found = [each for each in _WORD.finditer(task.solution) if abs(float(each["value"])) >= 1.0]
    if not found:
        return None
    word = random.choice(found)
    return _put(task.solution, word, f"{word['name']}{-float(word['value']):g}")


def _line_left_out(task: Task, random: Random) -> str | None:
    """Leave out a line that moves."""
    lines = task.solution.strip().split("\n")
    moving = [at for at, line in enumerate(lines) if _WORD.search(line)]
    if not moving or _may_go_around(task):
        return None
    at = random.choice(moving)
    return "\n".join([*lines[:at], *lines[at + 1 :], ""])


def _other_speed(task: Task, random: Random) -> str | None:
    """Change one F by half or more; a time of G93 likewise."""
    found = list(_FEED.finditer(task.solution))
    if not found or not _has_speeds(task):
        return None
    feed = random.choice(found)
    return _put(task.solution, feed, f"F{float(feed[1]) * random.choice([0.02, 0.5, 0.7, 1.5, 3.0]):.6g}")


def _crawl_on_the_way(task: Task, random: Random) -> str | None:
    """Go at 2 mm/s from the middle of the program on."""
    lines = task.solution.strip().split("\n")
    moving = [at for at, line in enumerate(lines) if _MOVE.search(line) and "," not in line]
    if not moving or "G94" not in task.solution or _FEED.search(lines[moving[-1]]):
        return None
    at = random.choice(moving)
    return "\n".join([*lines[:at], "F120", *lines[at:], ""])


def _strange_motion(task: Task, random: Random) -> str | None:
    """Let an axis that nobody asked for make a way of its own, there and back or for good."""
    used = {each["name"] for each in _WORD.finditer(task.solution)}
    spare = (
        [name for name in ("X", "Y", "Z", "[0]", "[1]", "[2]") if name not in used]
        if _has_no_tool(task)
        else []
    )
    spare += [name for name in ("[7]", "[8]") if name not in used and task.machine == "cartesian"]
    if not spare:
        return None
    axis, far = random.choice(spare), random.choice([-1, 1]) * random.uniform(2.0, 60.0)
    back = [f"G00 {axis}0"] if random.random() < 0.5 else []
    return _insert(task.solution, [f"G00 {axis}{far:.3f}", *back], random)


def _plunge(task: Task, random: Random) -> str | None:
    """Go down by 100 mm on the way, and up again."""
    if not _has_no_tool(task):
        return None
    return _insert(task.solution, [f"G91 G00 Z{_PLUNGE_MM:g}", f"G00 Z{-_PLUNGE_MM:g}", "G90"], random)


def _detour(task: Task, random: Random) -> str | None:
    """Go aside along an axis that the program moves, and back."""
    names = sorted({each["name"] for each in _WORD.finditer(task.solution) if each["name"] in "XYZ"})
    if not names or not _has_no_tool(task) or _may_go_around(task):
        return None
    axis, far = random.choice(names), random.choice([-1, 1]) * random.uniform(5.0, 50.0)
    return _insert(task.solution, [f"G91 G00 {axis}{far:.3f}", f"G00 {axis}{-far:.3f}", "G90"], random)


def _other_turn(task: Task, random: Random) -> str | None:
    """Go around an arc the other way, or once more."""
    found = list(_ARC.finditer(task.solution))
    if not found:
        return None
    arc = random.choice(found)
    if random.random() < 0.5:
        return _put(task.solution, arc, f"G0{5 - int(arc[1])}")
    end = task.solution.find("\n", arc.end())
    line = task.solution[arc.start() : end]
    if re.search(r"\bP\d", line):
        return None
    return task.solution[:end] + " P3" + task.solution[end:] if "G01" not in line else None


def _dwell(task: Task, random: Random) -> str | None:
    """Rest in the middle for a second that nobody asked for."""
    return _insert(task.solution, ["G04 P1"], random)


def _fault(task: Task, random: Random) -> str | None:
    """Write something that cannot be read, or asks for what the machine lacks."""
    return _insert(
        task.solution, [random.choice(["G01 X1O", "G77 X1", "G01 [77]1", "G00 X1e9", "GO1 X5"])], random
    )


_KINDS: dict[str, Callable[[Task, Random], str | None]] = {
    "another place": _another_place,
    "another sign": _another_sign,
    "line left out": _line_left_out,
    "other speed": _other_speed,
    "crawl": _crawl_on_the_way,
    "strange motion": _strange_motion,
    "plunge": _plunge,
    "detour": _detour,
    "other turn": _other_turn,
    "dwell": _dwell,
    "fault": _fault,
}


def _has_no_tool(task: Task) -> bool:
    return not re.search(r"\bT\d", task.solution)


def _may_go_around(task: Task) -> bool:
    """Return True if a task leaves the way open: another place may be right too."""
    return any(leg.detour for leg in task.expect.path)


def _has_speeds(task: Task) -> bool:
    return task.expect.speed is not None or all(leg.speed or leg.duration_s for leg in task.expect.path)


def _put(text: str, found: re.Match[str], new: str) -> str:
    return text[: found.start()] + new + text[found.end() :]


def _insert(text: str, lines: list[str], random: Random) -> str:
    """Insert lines behind the first line or a later one, before the end of the program."""
    program = text.strip().split("\n")
    at = random.randint(1, len(program))
    if program[-1] in ("M30", "M02", "M2", "G1011"):
        at = min(at, len(program) - 1)
    return "\n".join([*program[:at], *lines, *program[at:], ""])
