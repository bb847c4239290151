"""`trackslip benchmark`: cases, groups of runs, rows."""
