"""`trackslip calibrate`: fit a simulated robot to measured slips or to a log."""
