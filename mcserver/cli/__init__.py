"""The commands of ``mcserver``, one file each."""
