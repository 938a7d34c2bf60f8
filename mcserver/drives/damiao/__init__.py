"""Damiao's geared motors in MIT mode: position, velocity, stiffness, damping and torque in one CAN frame."""
