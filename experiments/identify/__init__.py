"""`trackslip identify`: fit slip laws to a log or to simulated runs."""
