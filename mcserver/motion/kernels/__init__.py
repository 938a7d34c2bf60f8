"""The loops of the lookahead, compiled by numba: numbers and arrays in, numbers and arrays out.

Each of them runs over all segments of a window, without an object a segment, and without holding the
interpreter's lock: the server's loop goes on beside it. ``NUMBA_DISABLE_JIT=1`` runs the same source as
Python.
"""
