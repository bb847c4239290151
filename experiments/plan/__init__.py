"""`trackslip plan`: design the shortest drive that determines a law."""
