"""RobStride's geared motors by their private protocol: a frame like MIT mode's, with extended identifiers."""
