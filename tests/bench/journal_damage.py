"""Random damage to the files of a journal, then the start on it: ``python -m tests.bench.journal_damage``.

A journal of 20 programs in all states, with its write-ahead log in several stages, is damaged once and
opened as a server opens it. Every program has to be as it was, or to be named as set aside, or the start has
to be refused with MC520.
"""

from __future__ import annotations

import argparse
import queue
import random
import shutil
import sqlite3
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from mcserver.errors import ServiceError
from mcserver.service.journal import Journal
from mcserver.service.journal_reader import read_lines_near, read_programs
from mcserver.service.journal_repair import Damage, prepare_journal
from mcserver.service.reports import Fault, ProgramState
from tests.service.journal_rows import commands_in

PROGRAMS = 20
SUFFIXES = ("", "-wal", "-shm", "-commits")
STATES: tuple[ProgramState, ...] = ("finished", "aborted", "faulted", "rejected")


class Truth(msgspec.Struct, frozen=True):
    """What a sound journal says."""

    programs: dict[str, bytes]
    commands: list[bytes]


def say(path: Path) -> Truth:
    """Read everything of a journal that a client can be told."""
    told = {}
    for status in read_programs(path, limit=1000):
        lines = read_lines_near(path, status.program, 1, 10**6)
        told[status.program] = msgspec.msgpack.encode((status, lines))
    return Truth(told, [msgspec.msgpack.encode(each) for each in commands_in(path)])


class Writer:
    """A journal whose commits are waited for."""

    def __init__(self, path: Path, *, threaded: bool = True) -> None:
        self._calls: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self.failures: list[str] = []
        self.journal = Journal(
            path, call_soon=self._calls.put, on_failure=self.failures.append, threaded=threaded
        )
        self._threaded = threaded

    def settle(self) -> None:
        """Wait until everything so far is committed."""
        settled: list[bool] = []
        self.journal.after(partial(settled.append, True))
        if not self._threaded:
            self.journal.write_pending()
        while not settled:
            self._calls.get(timeout=10.0)()


def write_programs(writer: Writer, chance: random.Random, numbers: Sequence[int]) -> None:
    """Write programs of all kinds, in turns, as a server does; every fifth one has not ended."""
    journal = writer.journal
    accepted = dict.fromkeys(numbers, 0)
    for number in numbers:
        before = ["G90", "G01 X1 F100"] if number % 4 == 3 else []
        journal.program_opened(
            name_of(number),
            instance="6700000001abcdef",
            client=f"hmi-{number}",
            name=f"job {number}",
            axes=[number % 3, 3],
            start_line=len(before) + 1,
            on_disconnect="finish" if number % 2 else "stop",
            resume_of=name_of(number - 1) if before else None,
            at=1000.0 + number,
            before=before,
        )
        accepted[number] = len(before)
    for turn in range(5):
        for number in numbers:
            count = chance.randint(1, 60)
            lines = [f"G01 X{chance.uniform(-9, 9):.3f} (line {line})" for line in range(count)]
            journal.lines(name_of(number), accepted[number] + 1, lines)
            accepted[number] += count
            done = max(0, accepted[number] - chance.randint(0, 20))
            journal.progress(name_of(number), accepted[number], done)
        journal.command(1000.0 + turn, "hmi", "override", None, f"{turn} %")
        if chance.random() < 0.5:
            writer.settle()
    for number in numbers:
        if number % 5 == 4:
            continue
        state = STATES[number % len(STATES)]
        fault = Fault(code="MC407", message="too far", axis=2, line=7, program=name_of(number))
        if state == "faulted":
            journal.fault(fault, 1100.0)
        journal.program_ended(
            name_of(number), state, accepted[number], fault if state == "faulted" else None, 1100.0 + number
        )
    writer.settle()


def name_of(number: int) -> str:
    return f"6700000001abcdef-{number + 1}"


def make_journals(folder: Path, seed: int) -> list[Path]:
    """Make journals as a kill leaves them, with all, a part and nothing in the log, and as a stop does."""
    made = []
    for stage, in_log in enumerate((PROGRAMS, PROGRAMS // 2, 0)):
        live, path = folder / f"live-{stage}.db", folder / f"journal-{stage}.db"
        chance = random.Random(seed + stage)
        writer = Writer(live)
        writer.journal.server_started("6700000001abcdef", 999.0)
        write_programs(writer, chance, range(PROGRAMS - in_log))
        if in_log < PROGRAMS:
            with sqlite3.connect(live) as connection:
                connection.execute("PRAGMA wal_checkpoint(PASSIVE)")
            connection.close()
        if in_log:
            write_programs(writer, chance, range(PROGRAMS - in_log, PROGRAMS))
        else:
            # one that lost its heartbeat with all of it in the database: the log is there, and empty of news
            writer.settle()
        for suffix in SUFFIXES:
            shutil.copy2(f"{live}{suffix}", f"{path}{suffix}")
        writer.journal.close()
        made.append(path)
    stopped = folder / "journal-stopped.db"
    shutil.copy2(folder / "live-0.db", stopped)
    shutil.copy2(f"{folder / 'live-0.db'}-commits", f"{stopped}-commits")
    return [*made, stopped]


# ---------------------------------------------------------------- damage


def _flip(content: bytearray, chance: random.Random) -> None:
    content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)


def _zero(content: bytearray, chance: random.Random) -> None:
    at = chance.randrange(len(content))
    count = min(chance.choice((1, 8, 64, 512)), len(content) - at)
    content[at : at + count] = bytes(count)


def _zero_page(content: bytearray, chance: random.Random) -> None:
    at = chance.randrange(len(content)) // 1024 * 1024
    content[at : at + 1024] = bytes(len(content[at : at + 1024]))


def _truncate(content: bytearray, chance: random.Random) -> None:
    del content[chance.randrange(len(content)) :]


def _overwrite(content: bytearray, chance: random.Random) -> None:
    at = chance.randrange(len(content))
    count = min(chance.choice((4, 32, 256, 2048, 8192)), len(content) - at)
    content[at : at + count] = chance.randbytes(count)


def _swap(content: bytearray, chance: random.Random) -> None:
    size = chance.choice((512, 1024, 1048))
    pages = len(content) // size
    if pages < 2:
        return
    first, second = (number * size for number in chance.sample(range(pages), 2))
    one, other = content[first : first + size], content[second : second + size]
    content[first : first + size], content[second : second + size] = other, one


def _copy_page(content: bytearray, chance: random.Random) -> None:
    pages = len(content) // 1024
    if pages < 2:
        return
    source, target = (number * 1024 for number in chance.sample(range(pages), 2))
    content[target : target + 1024] = content[source : source + 1024]


DAMAGES = (_flip, _flip, _flip, _zero, _zero_page, _truncate, _overwrite, _swap, _copy_page)


def damage_files(path: Path, chance: random.Random) -> str:
    """Damage one of the files, or remove some; returns what was done."""
    if chance.random() < 0.05:
        gone = chance.choice((("-wal",), ("-shm",), ("-wal", "-shm"), ("-commits",), ("",)))
        for suffix in gone:
            Path(f"{path}{suffix}").unlink(missing_ok=True)
        return f"removed {gone}"
    there = [suffix for suffix in SUFFIXES if Path(f"{path}{suffix}").exists()]
    suffix = chance.choice([*there, "", "-wal" if "-wal" in there else ""])
    file = Path(f"{path}{suffix}")
    content = bytearray(file.read_bytes())
    if not content:
        return "nothing"
    how = chance.choice(DAMAGES)
    how(content, chance)
    file.write_bytes(content)
    return f"{how.__name__} {suffix or 'database'}"


# ---------------------------------------------------------------- the start


def start_on(path: Path) -> tuple[Damage | None, Truth]:
    """Start as a server does, and say what it would say.

    Raises:
        ServiceError: the start is refused.
    """
    damage = prepare_journal(path)
    writer = Writer(path, threaded=False)
    try:
        writer.journal.server_started("6700000002abcdef", 2000.0)
        writer.settle()
        return damage, say(path)
    finally:
        writer.journal.close()


def judge(path: Path, truth: Truth) -> tuple[str, str]:
    """Start on a journal; returns a verdict, and what is wrong."""
    try:
        damage, said = start_on(path)
    except ServiceError as error:
        return ("refused", "") if error.code == "MC520" else ("wrong", f"refused by {error.code}")
    except Exception:
        return "unexpected", traceback.format_exc()
    for program, told in said.programs.items():
        if told != truth.programs.get(program):
            return "wrong", f"{program} is not as it was, {damage}"
    missing = set(truth.programs) - set(said.programs)
    if damage is None:
        if missing or said.commands != truth.commands:
            return "wrong", f"lost without a word: {sorted(missing)}"
        return "harmless", ""
    if missing - set(damage.lost):
        return "wrong", f"not named: {sorted(missing - set(damage.lost))}, {damage.message}"
    return ("set aside" if missing else "repaired"), ""


def run(count: int, seed: int, *, report: Callable[[str], Any] = lambda _: None) -> Counter[str]:
    """Damage a journal ``count`` times; returns how often each verdict came."""
    verdicts: Counter[str] = Counter()
    base = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory(dir=base) as name:
        folder = Path(name)
        journals = make_journals(folder, seed)
        truths = {}
        for source in journals:
            truths[source] = start_on(_copied(source, folder / "sound"))[1]
            assert len(truths[source].programs) == PROGRAMS
        for number in range(seed, seed + count):
            chance = random.Random(number)
            source = chance.choice(journals)
            path = _copied(source, folder / "damaged")
            how = damage_files(path, chance)
            verdict, why = judge(path, truths[source])
            verdicts[verdict] += 1
            if verdict in ("wrong", "unexpected"):
                report(f"seed {number}: {source.name}, {how}: {verdict}: {why}")
    return verdicts


def _copied(source: Path, folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for suffix in SUFFIXES:
        if Path(f"{source}{suffix}").exists():
            shutil.copyfile(f"{source}{suffix}", f"{folder / 'journal.db'}{suffix}")
    return folder / "journal.db"


def main() -> int:
    """Run as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    verdicts = run(given.count, given.seed, report=print)
    for name in ("harmless", "repaired", "set aside", "refused", "wrong", "unexpected"):
        print(f"{name:<12} {verdicts[name]:>7}")
    return int(bool(verdicts["wrong"] or verdicts["unexpected"]))


if __name__ == "__main__":
    sys.exit(main())
