"""`trackslip wander`: simulated teleoperated drives, logged as real robots log them."""
