"""Distances between the bodies of a machine, of its tools and of what stands around it."""
