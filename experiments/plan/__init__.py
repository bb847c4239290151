"""`trackslip plan`: the shortest drive that determines a law."""
