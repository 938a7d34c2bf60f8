"""A machine that has CAN where this kernel has none: Debian's kernel in QEMU, on the host's files."""
