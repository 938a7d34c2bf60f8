"""What the machine files of tests with homing share: an axis with a home switch, and a touch probe."""

from __future__ import annotations

# Travel in mm; the probe meets the work at X10. `initial_position` follows: it belongs to [axis.drive].
HOMED_AXIS = """
[[input]]
number = 4
name = "touch"
[probe]
input = 4
simulated_at = { X = 10.0 }
[[axis]]
index = 0
type = "linear"
max_velocity = 200.0
max_acceleration = 2000.0
min_position = 0.0
max_position = 300.0
[axis.homing]
method = "switch"
velocity = 50.0
latch_velocity = 5.0
position = -2.0
then_move_to = 5.0
[axis.drive]
home_switch = [-1000.0, -10.0]
"""
