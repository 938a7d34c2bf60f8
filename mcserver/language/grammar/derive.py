"""Derive random programs from a grammar."""

from __future__ import annotations

from random import Random

from mcserver.language.grammar.expressions import Chars, Choice, Expression, Grammar, Ref, Repeat, Seq, SomeOf

_MORE = 0.35  # probability of one more repetition: texts stay short
_TAKEN = 0.3  # probability of each of several words that may stand
_SHOWN = (*(chr(code) for code in range(0x20, 0x7F)), *"äß°µ中🙂")


def derive(grammar: Grammar, random: Random, rule: str | None = None) -> str:
    """Derive a text from a rule, the start rule by default; choices are equally likely."""
    pieces: list[str] = []
    waiting: list[Expression] = [Ref(grammar.start if rule is None else rule)]
    while waiting:
        match waiting.pop():
            case Chars() as chars:
                pieces.append(_character(chars, random))
            case Ref(name):
                waiting.append(grammar.rules[name])
            case Seq(parts):
                waiting.extend(reversed(parts))
            case SomeOf(parts):
                taken = [part for part in parts if random.random() < _TAKEN]
                waiting.extend(reversed(taken or [random.choice(parts)]))
            case Choice(parts):
                waiting.append(random.choice(parts))
            case Repeat(part, least, most):
                count = least
                while (most is None or count < most) and random.random() < _MORE:
                    count += 1
                waiting.extend([part] * count)
    return "".join(pieces)


def _character(chars: Chars, random: Random) -> str:
    if chars.negated:
        return str(random.choice([each for each in _SHOWN if chars.holds(each)]))
    first, last = random.choice(chars.ranges)
    return chr(random.randint(ord(first), ord(last)))
