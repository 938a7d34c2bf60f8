"""Tools and inverse kinematics, usable without the server."""
