"""`trackslip reproduce`: the paper from its first run to its last figure."""
