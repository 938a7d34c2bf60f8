"""The G-code dialect: from text to canonical motion, and diagnostics with columns."""
