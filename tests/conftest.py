"""What all tests share."""

from __future__ import annotations

# A command that runs in the tests' process must not choose plain Python for the rest of them: it does so
# only before the kernels are imported.
import mcserver.motion.kernels.compiled  # noqa: F401
