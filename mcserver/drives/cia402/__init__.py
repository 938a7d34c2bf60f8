"""CiA 402 servo drives on CANopen (IEC 61800-7-201)."""
