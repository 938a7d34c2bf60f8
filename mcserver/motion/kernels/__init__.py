"""The loops of the lookahead, compiled by numba: numbers and arrays in, numbers and arrays out.

Each runs over all segments of a window, without a Python object per segment and without the interpreter's
lock, so other threads go on. ``NUMBA_DISABLE_JIT=1`` runs the same source as Python.
"""
