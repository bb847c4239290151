"""`trackslip validate`: compare a simulated robot with theory."""
