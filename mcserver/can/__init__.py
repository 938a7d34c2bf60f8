"""CAN: frames, addresses of buses and the ports on them; nothing of CANopen's state machines."""
