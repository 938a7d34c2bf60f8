"""Drives: the seam to the executor, ideal and simulated ones, and what makes them from a machine file."""
