"""Recordings and live machines on Foxglove's well-known channels, which Foxglove and Rerun show in space."""
