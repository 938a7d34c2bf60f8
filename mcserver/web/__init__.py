"""The operator's page: a process of its own that is only a client of the motion servers it shows."""
