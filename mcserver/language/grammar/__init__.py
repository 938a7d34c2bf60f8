"""Grammars of the dialect, for a machine, in the notations that constrained decoders and parsers read."""
