"""Writes the message types and calls of the SDKs: ``python -m mcserver.contract.sdk clients``."""
