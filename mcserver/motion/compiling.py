"""What is told where the planner's loops have to be compiled first; light, for those who only wait for it."""

from __future__ import annotations

COMPILING = "compiling the planner for this computer: once, some 30 seconds …"
# A start from the cache is over before this [s].
PATIENCE_S = 3.0
