"""Limits of speed, acceleration and jerk along a path, from the limits of the axes."""
