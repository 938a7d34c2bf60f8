"""The recorder: a black box of the last minutes, and longer recordings, as MCAP files."""
