"""Pictures with matplotlib: arrays in, figure out. Nothing here computes a result or writes a file."""
