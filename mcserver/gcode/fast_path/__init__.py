"""Faster readings of the commonest lines, equal bit for bit to the block interpreter.

Four readings of a ``G01`` exist, because each is several times as fast as the next
(`tests/bench/parsing.py`, lines a second on one core): runs of equal words in columns, about a million; runs
of lines and arcs with whatever words each has, 240 000 to 380 000 on a busy computer; simple blocks, 65 000;
the block interpreter, which knows the whole dialect, 25 000. Arcs one by one: 60 000 against 17 000. Property
tests compare values, state and faults with those of the block interpreter.
"""
