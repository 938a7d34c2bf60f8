"""Simulated drives that are nodes on a CAN bus, as far as a master can see (CiA 301, CiA 402, Servosila)."""
