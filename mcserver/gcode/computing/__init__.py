"""Expressions, parameters and O-words of RS274/NGC: expand programs that compute to plain lines (D-80)."""
