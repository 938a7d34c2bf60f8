"""Servosila's own drives: streamed commands and telemetry of floating-point numbers on CAN."""
