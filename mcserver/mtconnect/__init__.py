"""MTConnect: machines as devices of an agent, read-only (ANSI/MTC1.4; schemas of version 2.0)."""
