"""`trackslip reproduce`: reproduce the paper, from its runs to its figures."""
