"""Pictures of what a program does: the path, its speed, the limits, and the times asked and taken."""
