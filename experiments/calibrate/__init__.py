"""`trackslip calibrate`: a robot's parameters from its measured slips."""
