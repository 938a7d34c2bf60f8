"""A release: one version for every package, built from a commit, with what it is made of, and signed."""
