"""The cards of a machine's page, one file each."""
