"""Speed, acceleration and jerk that the axes leave along the segments of a path."""
