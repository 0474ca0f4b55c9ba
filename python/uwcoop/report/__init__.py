"""Tables for the terminal, and the files that a run leaves."""
