"""Expressions, parameters and O-words of RS274/NGC: programs that compute become plain lines (D-80)."""
